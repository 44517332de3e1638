"""A small network that learns the sheet from millions of labelled postures.

The idea is that of DULA and DEBA (Yazdani et al., 2022).

A score is constant between band ends, and each band end belongs to one joint. So the first
layer reads each joint alone: a few soft steps tanh(a (x - c)) with learned places c and
sharpnesses a, mixed to a few curves. Dense layers combine the curves of all joints. The last
layer gives a probability p_i of each score i. The value is the expected score, sum_i i p_i. It
is smooth and always within the range of the scores of the data. The network contains nothing
of the sheet: the steps start evenly spread.

A network that is trained on exact scores is as flat between band ends as the sheet. A network
that is trained on the scores of postures with sensor noise (`taus_deg` of
:meth:`Neural.fit_sheet`) learns the expected score under that noise, which has a slope far
from the edges too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from typing import Any, Final, Self, Unpack

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ergoqp.arguments import MOST_WHOLE, check_kind, check_number, check_whole, shown
from ergoqp.coordinates import SCORED_JOINTS
from ergoqp.costs.learned import LearnedCost
from ergoqp.datasets.data import DataSet
from ergoqp.datasets.stream import posture_stream
from ergoqp.errors import ModelError
from ergoqp.learning.network import (
    Network,
    depth,
    fresh,
    layers_of,
    shares_of,
    shuffled,
    start,
    steps_of,
    train,
)
from ergoqp.learning.network_expression import dense_layers, led_back, soft_steps
from ergoqp.sheets.options import Method, read_method
from ergoqp.sheets.task import TaskOptions

_MOST_SCORES: Final = 30
_MOST_LAYERS: Final = 8
_WIDEST: Final = 4096
_LARGEST_SIZE: Final = {"steps": 256, "curves": 64, "batch": 1_000_000, "epochs": 1_000_000}
"""A size above these limits is taken for a mistake."""
_BATCH: Final = 512
_LEAST_BATCH: Final = 64
_LEAST_UPDATES: Final = 8000
_DECAY: Final = 1000.0
_CHUNK: Final = 4096
"""Number of rows that are predicted at once."""


class Neural(LearnedCost):
    """V(q) as the expected score of a network that gives the probability of each score.

    Args:
        network: parameters, see :data:`ergoqp.learning.network.Network`.
        scores: the scores of the network's outputs (s,) [points].
        coordinates: the inputs.
        minimum: V_min, the lowest score [points].
        temperature: divides the last layer (dimensionless). Above 1 the steps between scores
            are softer.

    Raises:
        ModelError: if the network does not fit these coordinates and scores, or the
            temperature is not positive.

    Source:
        The idea is that of DULA and DEBA (Yazdani et al., 2022).

    Example:
        >>> import numpy as np
        >>> from ergoqp.costs.neural import Neural
        >>> from ergoqp.datasets.data import DataSet
        >>> x = np.linspace(-1, 1, 400)[:, None]
        >>> data = DataSet(x, np.where(x[:, 0] > 0, 3.0, 1.0), ("trunk_flexion",))
        >>> cost = Neural.fit(data, steps=4, curves=2, hidden=(8,), epochs=60, rate=0.05, decay=0.0)
        >>> cost.predict(np.array([[-0.5], [0.5]])).round().tolist()
        [1.0, 3.0]
    """

    name = "neural"

    def __init__(
        self,
        network: Network,
        scores: Sequence[float],
        coordinates: Sequence[str],
        minimum: float,
        temperature: float = 1.0,
    ) -> None:
        """Keep the parameters. Training is in single precision, everything else in double."""
        super().__init__(coordinates, minimum)
        self.network = {
            name: np.asarray(values, dtype=np.float64) for name, values in network.items()
        }
        self.scores = np.asarray(scores, dtype=float)
        inputs, outputs = len(self.network["mixing"]), self.network[f"b{depth(self.network)}"].shape
        if inputs != len(self.coordinates) or outputs != self.scores.shape:
            raise ModelError(
                f"neural: got a network of {inputs} inputs and outputs of shape {outputs}, "
                f"allowed {len(self.coordinates)} coordinates and {self.scores.shape} scores"
            )
        if not 0 < temperature < np.inf:
            raise ModelError(
                f"neural: got the temperature {temperature!r}, allowed a positive number"
            )
        self.temperature = float(temperature)

    @classmethod
    def fit(
        cls,
        data: DataSet,
        steps: int = 12,
        curves: int = 3,
        hidden: Sequence[int] = (96, 48),
        epochs: int | None = None,
        batch: int | None = None,
        rate: float = 0.004,
        decay: float | None = None,
        temperature: float = 1.0,
        seed: int = 0,
        progress: Callable[[float], None] | None = None,
    ) -> Self:
        """Train on labelled points, by Adam with a cosine schedule and cross-entropy of the scores.

        Args:
            data: points and whole-numbered labels; the more the better.
            steps: number of soft steps per input.
            curves: number of curves made from the steps of each input.
            hidden: sizes of the dense layers.
            epochs: passes over the data; None: 4, or more for few data, until there are 8000
                updates.
            batch: points per update; None: the 150th part of the data, 64 to 512.
            rate: largest step of Adam (dimensionless).
            decay: weight decay (dimensionless), against overfitting of few data; None: 1000
                divided by the number of points.
            temperature: temperature of the result (dimensionless), see the class.
            seed: seed of the start and of the order.
            progress: called with the share that is done.

        Raises:
            ModelError: if there are too few points, or the labels are not a few whole numbers.
        """
        check_kind("data", data, DataSet, "a DataSet, see ergoqp.datasets.data", ModelError)
        batch = min(max(len(data) // 150, _LEAST_BATCH), _BATCH) if batch is None else batch
        decay = _DECAY / max(len(data), 1) if decay is None else decay
        _check(rate, hidden, seed, steps=steps, curves=curves, batch=batch)
        check_number("neural temperature", temperature, 1e-6, 1e6, error=ModelError)
        data.require(batch, "neural")
        per_epoch = len(data) // batch
        epochs = max(4, _LEAST_UPDATES // per_epoch) if epochs is None else epochs
        _check(rate, hidden, seed, epochs=epochs)
        check_number("neural decay", decay, 0.0, 1e9, error=ModelError)
        scores, classes = np.unique(data.labels, return_inverse=True)
        if len(scores) > _MOST_SCORES or (scores != np.round(scores)).any():
            raise ModelError(
                f"neural: got {len(scores)} different labels, allowed at most {_MOST_SCORES} whole"
                " numbers"
            )
        rng = np.random.default_rng(seed)
        begun = start(data.points, len(scores), steps, curves, hidden, rng)
        updates = epochs * per_epoch
        batches = shuffled(data.points.astype(np.float32), classes, batch, rng)
        network = train(begun, batches, updates, rate, decay, progress)
        return cls(network, scores.tolist(), data.coordinates, scores[0], temperature)

    @classmethod
    def fit_sheet(
        cls,
        count: int = 6_000_000,
        joints: Sequence[str] = SCORED_JOINTS,
        *,
        scores: Sequence[int] = range(1, 11),
        taus_deg: Sequence[float] = (),
        weights: Sequence[float] = (),
        steps: int = 12,
        curves: int = 3,
        hidden: Sequence[int] = (96, 48),
        batch: int = _BATCH,
        rate: float = 0.004,
        seed: int = 0,
        progress: Callable[[float], None] | None = None,
        method: Method | None = None,
        **task: Unpack[TaskOptions],
    ) -> Self:
        """Train on new postures that the sheet scores, each used once.

        No data are kept, so the network cannot overfit them.

        Args:
            count: number of postures, rounded down to whole updates.
            joints: the inputs; all other joints are at zero.
            scores: scores of the postures, with equally many postures of each.
            taus_deg: scales of the noise under which the expected score is learned [deg];
                none: the score itself is learned.
            weights: share of each scale.
            steps: as in :meth:`fit`, like the following.
            curves: number of curves made from the steps of each input.
            hidden: sizes of the dense layers.
            batch: postures per update.
            rate: largest step of Adam (dimensionless).
            seed: seed of the start and of the postures.
            progress: called with the share that is done.
            method: how the sheet is read; the default follows the publication.
            **task: options of the task, as in :func:`ergoqp.sheets.reba.assess`, one value for
                all postures.

        Raises:
            ModelError: if a size is not possible for a network.
            InputError: if a joint is unknown, no posture has one of the scores, or scales and
                weights do not fit together.
        """
        _check(rate, hidden, seed, steps=steps, curves=curves, batch=batch, count=count)
        check_whole("neural count", count, batch, error=ModelError)
        rng = np.random.default_rng(seed)
        per_score = max(2000, -(-batch // max(1, len(scores))))
        noise = {"taus_deg": taus_deg, "weights": weights}
        blocks = posture_stream(
            rng, joints=joints, scores=scores, per_score=per_score, **noise, method=method, **task
        )
        first = next(blocks)
        # With noise there are scores that no posture of the data has.
        known = (
            np.arange(1, read_method(method).final_max + 1) if len(taus_deg) else np.unique(scores)
        )
        begun = start(first[0], len(known), steps, curves, hidden, rng)
        network = train(
            begun,
            fresh(chain([first], blocks), known, batch),
            count // batch,
            rate,
            progress=progress,
        )
        return cls(network, known.tolist(), joints, known[0])

    def predict(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the expected score (n,) of inputs (n, d)."""
        parts = [self._expected(points[i : i + _CHUNK]) for i in range(0, len(points), _CHUNK)]
        return np.concatenate([*parts, np.empty(0)])

    def _expected(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        z = layers_of(self.network, steps_of(self.network, points))[-1]
        return shares_of(z / self.temperature) @ self.scores

    def value(self, x: ca.MX) -> ca.MX:
        """Return the expected score, a scalar expression of the inputs (d,)."""
        return ca.dot(ca.DM(self.scores), self._shares(self._layers(x)[-1]))

    def values(self, x: ca.MX) -> ca.MX:
        """Return V (1, k) of k columns of inputs (d, k), with the same products for all columns."""
        logarithms = ca.horzsplit(self._layers(x)[-1])
        return ca.horzcat(*(ca.dot(ca.DM(self.scores), self._shares(z)) for z in logarithms))

    def slope(self, x: ca.MX) -> ca.MX:
        """Return dV/dx (d,), by a backward pass through the layers.

        This avoids the transposed products that differentiation would form.
        """
        scores, steps = ca.DM(self.scores), soft_steps(self.network, x)
        values = dense_layers(self.network, steps)
        shares = self._shares(values[-1])
        back = shares * (scores - ca.dot(scores, shares)) / self.temperature
        return led_back(self.network, steps, values, back)

    def _layers(self, x: ca.MX) -> list[ca.MX]:
        return dense_layers(self.network, soft_steps(self.network, x))

    def _shares(self, z: ca.MX) -> ca.MX:
        weights = ca.exp((z - ca.mmax(z)) / self.temperature)
        return weights / ca.sum1(weights)

    def parts(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Return settings and arrays (rows, columns), the arrays in single precision as trained."""
        settings = {"scores": self.scores.tolist(), "temperature": self.temperature}
        return settings, {name: values.astype(np.float32) for name, values in self.network.items()}

    @classmethod
    def from_parts(
        cls,
        settings: Mapping[str, Any],
        arrays: Mapping[str, NDArray[Any]],
        coordinates: Sequence[str],
        minimum: float,
    ) -> Self:
        """Return the cost with these `parts`. The arrays must have the same shapes."""
        return cls(dict(arrays), settings["scores"], coordinates, minimum, settings["temperature"])


def _check(rate: float, hidden: Sequence[int], seed: int, **sizes: int) -> None:
    """Check the sizes of a network and of its training.

    Raises:
        ModelError: if one is wrong; the message names it.
    """
    layers = hidden if isinstance(hidden, Sequence) and not isinstance(hidden, str) else ()
    if not 1 <= len(layers) <= _MOST_LAYERS:
        raise ModelError(
            f"neural hidden: got {shown(hidden)}, allowed the sizes of 1 to {_MOST_LAYERS} layers"
        )
    for size in layers:
        check_whole("neural hidden", size, 1, _WIDEST, ModelError)
    for name, size in sizes.items():
        check_whole(f"neural {name}", size, 1, _LARGEST_SIZE.get(name, MOST_WHOLE), ModelError)
    check_whole("neural seed", seed, 0, error=ModelError)
    check_number("neural rate", rate, 1e-9, 1e3, error=ModelError)
