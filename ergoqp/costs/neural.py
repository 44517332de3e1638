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

from collections.abc import Callable, Iterator, Sequence
from itertools import chain, islice, pairwise
from typing import Any, Final, Self, Unpack

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.special import softmax

from ergoqp.arguments import MOST_WHOLE, check_kind, check_number, check_whole, shown
from ergoqp.coordinates import SCORED_JOINTS
from ergoqp.costs.cost import Arrays, LearnedCost, Settings
from ergoqp.datasets.data import DataSet
from ergoqp.datasets.postures import posture_stream
from ergoqp.errors import ModelError
from ergoqp.sheets.options import Method, TaskOptions, read_method

Network = dict[str, NDArray]
"""Parameters of a network by name.

``places`` and ``sharpness`` (d, k): the soft steps of each input. ``mixing`` (d, k, m): makes
m curves of each input from its steps. ``W1``, ``b1``, ...: the dense layers, inputs first, the
last one to the classes.
"""

Batches = Iterator[tuple[NDArray, NDArray]]
"""Points (n, d) and the numbers of their classes (n,), counted from 0, for one update each."""

_WARM_UP = 300
"""Number of updates over which the rate grows to its full size."""

_FIRST, _SECOND, _TINY = 0.9, 0.999, 1e-8
"""Adam's decay rates of the gradient and its square, and the term that avoids division by zero.

The values are those of Kingma and Ba, 2015.
"""


def depth(net: Network) -> int:
    """Return the number of dense layers."""
    return sum(name.startswith("W") for name in net)


def start(
    points: NDArray,
    count: int,
    steps: int,
    curves: int,
    hidden: Sequence[int],
    rng: np.random.Generator,
) -> Network:
    """Return an untrained network.

    Its steps are evenly spread over the range of each input. All weights are small and random.

    Args:
        points: inputs (n, d), for their ranges.
        count: number of classes.
        steps: number of soft steps per input.
        curves: number of curves made from the steps of each input.
        hidden: sizes of the dense layers.
        rng: source of randomness.
    """
    low, high = points.min(axis=0).astype(float), points.max(axis=0).astype(float)
    wide = np.maximum(high - low, 1e-6)[:, np.newaxis]
    net = {
        "places": low[:, np.newaxis] + wide * np.arange(1, steps + 1) / (steps + 1),
        "sharpness": np.repeat(2 * (steps + 1) / wide, steps, axis=1),
        "mixing": rng.normal(size=(len(wide), steps, curves)) / np.sqrt(steps),
    }
    for layer, (rows, columns) in enumerate(
        pairwise([len(wide) * curves, *hidden, count]), start=1
    ):
        net[f"W{layer}"] = rng.normal(size=(rows, columns)) / np.sqrt(rows)
        net[f"b{layer}"] = np.zeros(columns)
    return net


def shuffled(points: NDArray, classes: NDArray, batch: int, rng: np.random.Generator) -> Batches:
    """Yield batches of the same data endlessly, in a new order in each pass."""
    while True:
        order = rng.permutation(len(points))
        for first in range(0, len(order) - batch + 1, batch):
            rows = order[first : first + batch]
            yield points[rows], classes[rows]


def fresh(blocks: Iterator[tuple[NDArray, NDArray]], labels: NDArray, batch: int) -> Batches:
    """Yield batches from blocks of points and labels, each used once. `labels` are the classes."""
    for points, given in blocks:
        # The rest of a block is dropped, because new points are cheap.
        classes = np.searchsorted(labels, given)
        for first in range(0, len(points) - batch + 1, batch):
            yield points[first : first + batch], classes[first : first + batch]


def train(
    net: Network,
    batches: Batches,
    updates: int,
    rate: float,
    decay: float = 0.0,
    progress: Callable[[float], None] | None = None,
) -> Network:
    """Return the network with parameters trained by cross-entropy, in float32.

    Args:
        net: network from `start`.
        batches: at least as many as updates.
        updates: number of updates.
        rate: largest step of Adam; it grows from zero and falls to zero along half a cosine.
        decay: weight decay, as a share of the rate (Loshchilov and Hutter, 2019); steps have
            none.
        progress: called with the share that is done.
    """
    # All parameters are in one array, so that an update is a few operations. The names are
    # views of it. The logarithm of the sharpness is trained, so the sharpness stays positive.
    begun = {**net, "sharpness": np.log(net["sharpness"])}
    row = np.concatenate([values.ravel() for values in begun.values()]).astype(np.float32)
    ends = np.cumsum([values.size for values in begun.values()])
    views = {
        n: v.reshape(begun[n].shape) for n, v in zip(begun, np.split(row, ends[:-1]), strict=True)
    }
    mean, square = np.zeros_like(row), np.zeros_like(row)
    weights = row[begun["places"].size + begun["sharpness"].size :]
    for done, (points, classes) in enumerate(islice(batches, updates), start=1):
        current = {**views, "sharpness": np.exp(views["sharpness"])}
        slopes = _slopes(current, points.astype(np.float32), classes)
        slope = np.concatenate([slopes[name].ravel() for name in views])
        pace = rate * min(1.0, done / _WARM_UP) * 0.5 * (1 + np.cos(np.pi * done / updates))
        mean += np.float32(1 - _FIRST) * (slope - mean)
        square += np.float32(1 - _SECOND) * (slope * slope - square)
        size = np.sqrt(square / np.float32(1 - _SECOND**done)) + np.float32(_TINY)
        row -= np.float32(pace / (1 - _FIRST**done)) * mean / size
        weights *= np.float32(1 - pace * decay)
        if progress is not None and (done % 100 == 0 or done == updates):
            progress(done / updates)
    return {**views, "sharpness": np.exp(views["sharpness"])}


def steps_of(net: Network, points: NDArray) -> NDArray:
    """Return the soft steps (d, n, k) of points (n, d)."""
    return np.tanh(
        (points.T[:, :, np.newaxis] - net["places"][:, np.newaxis])
        * net["sharpness"][:, np.newaxis]
    )


def layers_of(net: Network, steps: NDArray) -> list[NDArray]:
    """Return the input of each dense layer, and at the end the log class weights (n, classes)."""
    curves = np.matmul(steps, net["mixing"])
    values = [np.ascontiguousarray(curves.transpose(1, 0, 2)).reshape(steps.shape[1], -1)]
    for layer in range(1, depth(net) + 1):
        z = values[-1] @ net[f"W{layer}"] + net[f"b{layer}"]
        values.append(z if layer == depth(net) else np.tanh(z, out=z))
    return values


def _slopes(net: Network, points: NDArray, classes: NDArray) -> Network:
    """Return the derivative of the mean cross-entropy with respect to every parameter.

    For the sharpness it is the derivative with respect to the logarithm.
    """
    steps = steps_of(net, points)
    values = layers_of(net, steps)
    back = softmax(values.pop(), axis=1)
    back[np.arange(len(back)), classes] -= 1
    back /= np.float32(len(back))
    slopes: Network = {}
    for layer in range(depth(net), 0, -1):
        value = values[layer - 1]
        slopes[f"W{layer}"], slopes[f"b{layer}"] = value.T @ back, back.sum(axis=0)
        back = back @ net[f"W{layer}"].T
        if layer > 1:
            back *= 1 - value * value
    joints, _, curves = net["mixing"].shape
    back = np.ascontiguousarray(back.reshape(len(points), joints, curves).transpose(1, 0, 2))
    slopes["mixing"] = np.matmul(steps.transpose(0, 2, 1), back)
    back = np.matmul(back, net["mixing"].transpose(0, 2, 1))
    back *= 1 - steps * steps
    # The argument of a step is a (x - c). Its derivatives with respect to c and log a are -a
    # and a (x - c), summed over the points.
    by_place = back.sum(axis=1) * net["sharpness"]
    by_input = np.matmul(points.T[:, np.newaxis], back)[:, 0] * net["sharpness"]
    slopes["places"], slopes["sharpness"] = -by_place, by_input - net["places"] * by_place
    return slopes


def soft_steps(net: Network, x: ca.MX) -> ca.MX:
    """Return the soft steps of the first layer for k columns of inputs (d, k)."""
    places, sharpness = net["places"], net["sharpness"]
    shift = ca.DM((places * sharpness).ravel())
    return ca.tanh(ca.MX(_blocks(sharpness[..., np.newaxis])) @ x - ca.repmat(shift, 1, x.shape[1]))


def dense_layers(net: Network, steps: ca.MX) -> list[ca.MX]:
    """Return the curves that are made from the steps, and the output of each dense layer."""
    values = [ca.MX(_blocks(net["mixing"].transpose(0, 2, 1))) @ steps]
    for layer in range(1, depth(net) + 1):
        bias = ca.repmat(ca.DM(net[f"b{layer}"]), 1, steps.shape[1])
        z = ca.MX(ca.DM(net[f"W{layer}"].T)) @ values[-1] + bias
        values.append(z if layer == depth(net) else ca.tanh(z))
    return values


def led_back(net: Network, steps: ca.MX, values: list[ca.MX], slope: ca.MX) -> ca.MX:
    """Return the slope with respect to the inputs (d,), from that with respect to the last layer.

    Args:
        net: the network.
        steps: result of `soft_steps`.
        values: result of `dense_layers`.
        slope: slope with respect to the last of `values`.
    """
    for layer in range(depth(net), 0, -1):
        slope = ca.MX(ca.DM(net[f"W{layer}"])) @ slope
        if layer > 1:
            slope *= 1 - values[layer - 1] ** 2
    return ca.MX(_blocks(net["sharpness"][:, np.newaxis])) @ (
        (ca.MX(_blocks(net["mixing"])) @ slope) * (1 - steps**2)
    )


def _blocks(blocks: NDArray) -> ca.DM:
    """Return the sparse matrix (d a, d b) with the diagonal blocks (d, a, b)."""
    count, rows, columns = blocks.shape
    full = np.zeros((count, rows, count, columns))
    full[np.arange(count), :, np.arange(count), :] = blocks
    return ca.sparsify(ca.DM(full.reshape(count * rows, count * columns)))


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
        network: parameters, see :data:`ergoqp.costs.neural.Network`.
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
        return softmax(z / self.temperature, axis=1) @ self.scores

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
        cls, settings: Settings, arrays: Arrays, coordinates: Sequence[str], minimum: float
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
