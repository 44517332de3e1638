"""The sheet learned by a small network from millions of labelled postures, the idea of DULA and DEBA (Yazdani et al., 2022).

A score is constant between band ends, and a band end belongs to one joint. So the first layer looks at each joint alone, with
a few soft steps tanh(a (x - c)) whose places c and sharpness a are learned; dense layers combine them; the last one gives a
probability p_i of each score i. The value is the expected score, sum_i i p_i, which is smooth and never beyond the scores seen.
Nothing of the sheet is built in: the steps start evenly spread.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, Self

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ergoqp.costs.data import DataSet
from ergoqp.costs.learned import LearnedCost
from ergoqp.costs.neural_training import Network, train
from ergoqp.errors import ModelError

_MOST_SCORES: Final = 30
_CHUNK: Final = 4096
"""Rows that are predicted at once."""


class Neural(LearnedCost):
    """V(q) as the expected score of a network that gives each score a probability.

    Attributes:
        scores: the scores that the network knows (s,) [points].
        network: its parameters; training is in single precision, everything else in double.
        temperature: divides the last layer; above 1 the steps between scores are softer and lead from farther away.
    """

    name = "neural"

    def __init__(
        self, network: Network, scores: Sequence[float], coordinates: Sequence[str], minimum: float, temperature: float = 1.0
    ) -> None:
        """Keep the parameters.

        Raises:
            ModelError: if the network is not of these coordinates and scores, or the temperature is not positive.
        """
        super().__init__(coordinates, minimum)
        self.network = {name: np.asarray(values, dtype=np.float64) for name, values in network.items()}
        self.scores = np.asarray(scores, dtype=float)
        if len(self.network["places"]) != len(self.coordinates) or self.network[f"b{self._layers}"].shape != self.scores.shape:
            raise ModelError("neural: got a network of other inputs or outputs, allowed one of these coordinates and scores")
        if not 0 < temperature < np.inf:
            raise ModelError(f"neural: got the temperature {temperature!r}, allowed a positive number")
        self.temperature = float(temperature)

    @property
    def _layers(self) -> int:
        return sum(name.startswith("W") for name in self.network)

    @classmethod
    def fit(
        cls,
        data: DataSet,
        steps: int = 16,
        hidden: Sequence[int] = (128, 64),
        epochs: int = 6,
        batch: int = 1024,
        rate: float = 0.003,
        temperature: float = 1.0,
        seed: int = 0,
        progress: Callable[[float], None] | None = None,
    ) -> Self:
        """Train on labelled points by Adam with a cosine schedule, cross-entropy of the scores.

        Args:
            data: points and whole-numbered labels; the more the better, hundreds of thousands.
            steps: soft steps per input.
            hidden: sizes of the dense layers.
            epochs: passes over the data.
            batch: points per update.
            rate: largest step of Adam.
            temperature: of the result, see the class.
            seed: of start and order.
            progress: told the share that is done.

        Raises:
            ModelError: for too little data, or labels that are not a few whole numbers.
        """
        data.require(4 * batch if len(data) > batch else batch, "neural")
        scores, classes = np.unique(data.labels, return_inverse=True)
        if len(scores) > _MOST_SCORES or (scores != np.round(scores)).any():
            raise ModelError(f"neural: got {len(scores)} different labels, allowed at most {_MOST_SCORES} whole numbers")
        if min(steps, epochs, batch, *hidden) < 1 or not hidden:
            raise ModelError("neural: got a size of 0 among steps, hidden, epochs and batch, allowed 1 or more")
        network = train(data.points, classes, len(scores), steps, hidden, epochs, batch, rate, seed, progress)
        return cls(network, scores.tolist(), data.coordinates, float(scores[0]), temperature)

    def predict(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the expected score (n,) of inputs (n, d)."""
        parts = [self._expected(points[i : i + _CHUNK]) for i in range(0, len(points), _CHUNK)]
        return np.concatenate([*parts, np.empty(0)])

    def _expected(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        net = self.network
        h = np.tanh((points[:, :, np.newaxis] - net["places"]) * net["sharpness"]).reshape(len(points), -1)
        for layer in range(1, self._layers):
            h = np.tanh(h @ net[f"W{layer}"] + net[f"b{layer}"])
        z = (h @ net[f"W{self._layers}"] + net[f"b{self._layers}"]) / self.temperature
        share = np.exp(z - z.max(axis=1, keepdims=True))
        return share @ self.scores / share.sum(axis=1)

    def value(self, x: ca.MX) -> ca.MX:
        """Return the expected score, a scalar expression of the inputs (d,)."""
        return self._last(self._first(x)[-1])

    def _first(self, x: ca.MX) -> list[ca.MX]:
        """Outputs of the layers before the last one, the soft steps first."""
        net = self.network
        steps = net["places"].shape[1]
        spread = ca.vec(ca.repmat(x.T, steps, 1))
        outputs = [ca.tanh((spread - ca.DM(net["places"].ravel())) * ca.DM(net["sharpness"].ravel()))]
        for layer in range(1, self._layers):
            outputs.append(ca.tanh(_matrix(net[f"W{layer}"]) @ outputs[-1] + ca.DM(net[f"b{layer}"])))
        return outputs

    def _last(self, h: ca.MX) -> ca.MX:
        net = self.network
        z = (_matrix(net[f"W{self._layers}"]) @ h + ca.DM(net[f"b{self._layers}"])) / self.temperature
        share = ca.exp(z - ca.mmax(z))
        return ca.dot(ca.DM(self.scores), share) / ca.sum1(share)

    def parts(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Return settings and arrays, in single precision: that is what training gives."""
        settings = {"scores": self.scores.tolist(), "temperature": self.temperature}
        return settings, {name: values.astype(np.float32) for name, values in self.network.items()}

    @classmethod
    def from_parts(
        cls, settings: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], coordinates: Sequence[str], minimum: float
    ) -> Self:
        """Return the cost that `parts` came from."""
        return cls(dict(arrays), settings["scores"], coordinates, minimum, settings["temperature"])


def _matrix(weights: NDArray[np.float64]) -> ca.MX:
    """Weights (m, n) as the matrix (n, m) that maps a column."""
    return ca.MX(ca.DM(weights.T))
