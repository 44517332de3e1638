"""One smooth cost from one one-class SVM per score.

It is the EPFL report's last and best idea (its figures 24 and 25).

In the report, a posture of class i follows the gradient of the one-class SVM of class i - 1,
then that of the next lower class, and so on, like the rungs of a ladder. The gradient jumps at
every rung. This module writes the same ladder as one smooth function that counts the rungs
that are still below. Let g_j be the margin of class j (`ergoqp.learning.one_class`: positive
inside). The set of all classes up to i has the margin

    m_i = log sum_{j <= i} exp g_j        (a smooth maximum),

and with the scores s_1 < s_2 < ... the rungs below are

    r = sum_i (s_{i+1} - s_i) ((1 - pull) sigma(z_i) + pull softplus(z_i) / reach),   z_i =
    -steepness m_i - log 9,

where sigma is the logistic function. At its own boundary a rung counts as a tenth. Inside
class i, all m from i on are positive. What remains are the rungs below, and the nearest of
them gives the slope. The second term gives a slope where the logistic functions are flat.
`reach` scales it so that it counts as much as the first term at the far data. The classes of
high scores are wide and far from the low ones, so r grows faster than the score. The value
corrects this:

    V = offset + height log(1 + curve r) / curve,

with offset, height and curve fitted to the labels. This changes how fast the value falls, but
not the direction.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import Any, Final, Self

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ergoqp.arguments import Progress, check_kind, check_number, unseen
from ergoqp.costs.cost import Arrays, LearnedCost, Settings
from ergoqp.datasets.data import DataSet
from ergoqp.errors import ModelError
from ergoqp.learning.one_class import OneClass

Array = NDArray[np.float64]

_LEAST: Final = 10
"""Least number of points of a rung."""

_MOST: Final = 30
"""Largest number of rungs."""

_FAR: Final = 90.0
"""Percentile of the data that counts as far."""

_CURVES: Final = (0.0, *np.geomspace(0.03, 3, 11).tolist())
"""Values of `curve` to choose from."""

_EDGE: Final = float(np.log(9))
"""With this offset a rung counts as a tenth at its edge."""


_RUNG_ARRAYS: Final = ("mean", "scale", "centres", "weights")
"""The arrays of a rung in a file, each with the number of the rung."""


class OneClassLadder(LearnedCost):
    """V(q) from the number of one-class SVMs that the posture is still outside of.

    Attributes:
        rungs: one boundary per score, in ascending order.
        scores: scores of the rungs [points].
        coordinates: names of the inputs.
        minimum: V_min, the lowest score of the data [points].
        steepness: steepness of the logistic function, per unit of the margins.
        pull: share of the term that gives a slope far away.
        reach: value of the softplus at the far data (dimensionless).
        offset: value where every rung is reached [points].
        height: height of the lowest rung, per point of its score [points].
        curve: how much less the higher rungs count than the lowest; 0: all count the same
            (dimensionless).

    Source:
        EPFL semester report, "Learning ergonomic human-robot interaction", figures 24 and 25.

    Example:
        >>> import numpy as np
        >>> from ergoqp.costs.one_class_ladder import OneClassLadder
        >>> from ergoqp.datasets.data import DataSet
        >>> rng = np.random.default_rng(0)
        >>> x = np.concatenate([rng.normal(0, 0.1, (40, 1)), rng.normal(1, 0.2, (40, 1))])
        >>> cost = OneClassLadder.fit(DataSet(x, np.repeat([1.0, 2.0], 40), ("trunk_flexion",)))
        >>> low, high = cost.predict(np.array([[0.0], [1.0]]))
        >>> bool(low < high)
        True
    """

    name = "one_class_ladder"

    def __init__(
        self,
        rungs: Sequence[OneClass],
        scores: Sequence[float],
        coordinates: Sequence[str],
        minimum: float,
        steepness: float = 6.0,
        pull: float = 0.3,
        *,
        reach: float = 1.0,
        offset: float = 1.0,
        height: float = 1.0,
        curve: float = 0.0,
    ) -> None:
        """Keep the rungs.

        Raises:
            ModelError: if there are fewer than two rungs, scores and rungs do not fit
                together, or a number is out of its range.
        """
        super().__init__(coordinates, minimum)
        self.rungs, self.scores = tuple(rungs), np.asarray(scores, dtype=float)
        if (
            len(self.rungs) < 2
            or len(self.scores) != len(self.rungs)
            or not (np.diff(self.scores) > 0).all()
        ):
            raise ModelError(
                f"ladder: got {len(self.rungs)} rungs and scores {self.scores}, allowed two or"
                " more, ascending"
            )
        if not (0 < steepness < np.inf and 0 <= pull < 1):
            raise ModelError(
                f"ladder: got steepness {steepness!r} and pull {pull!r}, allowed above 0, and from"
                " 0 to below 1"
            )
        self.steepness, self.pull = float(steepness), float(pull)
        if not 0 <= curve < np.inf:
            raise ModelError(f"ladder: got curve {curve!r}, allowed a number of at least 0")
        self.reach = float(reach)
        self.offset = float(offset)
        self.height = float(height)
        self.curve = float(curve)

    @classmethod
    def fit(
        cls,
        data: DataSet,
        nu: float = 0.05,
        gamma: float | None = None,
        steepness: float = 6.0,
        pull: float = 0.3,
        progress: Progress = unseen,
    ) -> Self:
        """Fit one boundary to the points of each label.

        Args:
            data: labelled points; at least 10 of each label.
            nu: upper bound of the share of a class's points that are outside its own boundary.
            gamma: gamma of the kernels, per squared scaled unit; None: 3 / d, or half or a
                quarter of it for a class with too few points for that.
            steepness: steepness of the logistic function, per unit of the margins.
            pull: share of the term that gives a slope far away.
            progress: called with the share that is done.

        Raises:
            ModelError: if a label has too few points, or there are too many labels.
            MissingExtraError: if scikit-learn is not installed.
        """
        check_kind("data", data, DataSet, "a DataSet, see ergoqp.datasets.data", ModelError)
        for what, value, ends in (
            ("nu", nu, (1e-6, 0.999)),
            ("steepness", steepness, (1e-6, 1e6)),
            ("pull", pull, (0.0, 0.999)),
        ):
            check_number(f"one_class_ladder {what}", value, *ends, error=ModelError)
        if gamma is not None:
            check_number("one_class_ladder gamma", gamma, 1e-9, 1e9, error=ModelError)
        data.require(2 * _LEAST, "one_class_ladder")
        scores, counts = np.unique(data.labels, return_counts=True)
        if len(scores) > _MOST or counts.min() < _LEAST:
            raise ModelError(
                f"one_class_ladder: got {len(scores)} labels with at least {counts.min()} points"
                f" each, allowed at most {_MOST} with at least {_LEAST}"
            )
        choices = (
            [3 / len(data.coordinates) / part for part in (1, 2, 4)] if gamma is None else [gamma]
        )
        rungs = []
        for number, score in enumerate(scores):
            rungs.append(_rung(data.part(data.labels == score), nu, choices))
            progress((number + 1) / len(scores))
        made = cls(rungs, scores.tolist(), data.coordinates, float(scores[0]), steepness, pull)
        made.reach = float(np.percentile(made._terms(data.points)[1], _FAR))
        made.curve, made.height, made.offset = _calibrated(made._below(data.points), data.labels)
        made.minimum = min(made.minimum, made.offset)
        return made

    def predict(self, points: Array) -> Array:
        """Return V (n,) of inputs (n, d)."""
        below = self._below(points)
        return self.offset + self.height * _bent(below, self.curve)

    def _below(self, points: Array) -> Array:
        """Return r (n,): the rungs that are still below, in points."""
        near, far = self._terms(points)
        return ((1 - self.pull) * near + self.pull / self.reach * far) @ np.diff(self.scores)

    def _terms(self, points: Array) -> tuple[Array, Array]:
        """Return the logistic and the softplus term of every rung except the last, each (n, k)."""
        margins = np.logaddexp.accumulate(
            np.stack([rung.margin(points) for rung in self.rungs[:-1]], axis=1), axis=1
        )
        z = -self.steepness * margins - _EDGE
        return np.exp(-np.logaddexp(0, -z)), np.logaddexp(0, z)

    def value(self, x: ca.MX) -> ca.MX:
        """Return V, a scalar expression of the inputs (d,)."""
        return self._both(x)[0]

    def slope(self, x: ca.MX) -> ca.MX:
        """Return dV/dx (d,), an expression: the weighted sum of the slopes of the margins."""
        return self._both(x)[1]

    def _both(self, x: ca.MX) -> tuple[ca.MX, ca.MX]:
        found = [rung.margin_and_slope(x) for rung in self.rungs[:-1]]
        weigh = self._weighed()
        value, weights = weigh(ca.vertcat(*(margin for margin, _ in found)))
        return value, ca.horzcat(*(slope for _, slope in found)) @ weights

    def _weighed(self) -> ca.Function:
        """Return ``margins (k,) -> V, dV/dmargins (k,)``, a Function of few scalars."""
        margins = ca.SX.sym("margins", len(self.rungs) - 1)
        below, merged = ca.SX(0), margins[0]
        for i, height in enumerate(np.diff(self.scores)):
            if i:
                merged = _softplus(margins[i] - merged) + merged
            z = -self.steepness * merged - _EDGE
            below += height * (
                (1 - self.pull) * ca.exp(-_softplus(-z)) + self.pull / self.reach * _softplus(z)
            )
        bent = ca.log1p(self.curve * below) / self.curve if self.curve else below
        value = self.offset + self.height * bent
        return ca.Function("weighed", [margins], ca.cse([value, ca.gradient(value, margins)]))

    def parts(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Return (settings, arrays)."""
        fitted = {name: getattr(self, name) for name in ("reach", "offset", "height", "curve")}
        settings = {
            "scores": self.scores.tolist(),
            "steepness": self.steepness,
            "pull": self.pull,
            "fitted": fitted,
            "gammas": [rung.gamma for rung in self.rungs],
            "log_rhos": [rung.log_rho for rung in self.rungs],
        }
        numbered = [(name, i) for i in range(len(self.rungs)) for name in _RUNG_ARRAYS]
        return settings, {f"{name}{i}": getattr(self.rungs[i], name) for name, i in numbered}

    @classmethod
    def from_parts(
        cls, settings: Settings, arrays: Arrays, coordinates: Sequence[str], minimum: float
    ) -> Self:
        """Return the cost with these `parts`. The arrays must have the same shapes."""
        rungs = []
        laws = zip(settings["gammas"], settings["log_rhos"], strict=True)
        for i, (gamma, log_rho) in enumerate(laws):
            own = {name: arrays[f"{name}{i}"] for name in _RUNG_ARRAYS}
            rungs.append(OneClass(coordinates, gamma, rho=float(np.exp(log_rho)), **own))
        terms = settings["scores"], coordinates, minimum, settings["steepness"], settings["pull"]
        return cls(rungs, *terms, **settings["fitted"])


def _calibrated(below: Array, labels: Array) -> tuple[float, float, float]:
    """Return the curve, height and offset that fit the labels best in the least-squares sense."""
    best, least = (0.0, 0.0, 0.0), np.inf
    for curve in _CURVES:
        bent = _bent(below, curve)
        height, offset = np.polyfit(bent, labels, 1)
        error = float(np.mean((offset + height * bent - labels) ** 2))
        if error < least:
            best, least = (curve, float(height), float(offset)), error
    return best


def _bent(below: Array, curve: float) -> Array:
    return np.log1p(curve * below) / curve if curve else below


def _rung(data: DataSet, nu: float, gammas: Sequence[float]) -> OneClass:
    """Return the one-class boundary with the first gamma for which the fit succeeds."""
    for gamma in gammas[:-1]:
        with suppress(ModelError):
            return OneClass.fit(data.points, data.coordinates, nu, gamma)
    return OneClass.fit(data.points, data.coordinates, nu, gammas[-1])


def _softplus(z: ca.SX) -> ca.SX:
    """Return log(1 + exp z) without overflow."""
    return ca.fmax(z, 0) + ca.log1p(ca.exp(-ca.fabs(z)))
