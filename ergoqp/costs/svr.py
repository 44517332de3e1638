"""Support vector regression of the score, and fewer kernels in place of thousands.

Fewer kernels: a sum of hundreds of kernels that replaces one of thousands. The difference is
measured and kept with the cost.

Each control step evaluates every centre, so time grows with their number. Nearby centres are
nearly redundant. So some centres are selected, or replaced by the middles of groups. The
weights are then fitted to the values of the full sum, by least squares with a small ridge (the
subset of regressors that belongs to the Nystroem approximation).

This regression is the second surrogate of the EPFL report.

With radial kernels the metric is what matters. Three things are fitted to the data before the
regression itself: soft steps where the effect of each joint on the score changes
(`ergoqp.learning.kernels`), a length scale per feature (`ergoqp.learning.pipelines`), and
which features are left out because they do not matter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal, Self, TypeVar, get_args

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ergoqp.arguments import (
    LARGEST_SEED,
    Progress,
    check_kind,
    check_number,
    check_whole,
    check_word,
    numbers_of,
    part_of,
    unseen,
)
from ergoqp.costs.cost import Arrays, LearnedCost, Settings
from ergoqp.datasets.data import DataSet
from ergoqp.errors import ModelError
from ergoqp.learning.kernels import Columns, Kernel, KernelSum, Steps, features_from
from ergoqp.learning.pipelines import dense, relevance, sklearn

Array = NDArray[np.float64]

Method = Literal["clusters", "largest"]
"""How centres are chosen: middles of groups of centres, or the centres with the largest weights.

The groups are found by k-means, weighted by the absolute weights. Keeping the largest weights
is pruning.
"""

_RIDGE: Final = 1e-7
"""Ridge of the least squares, relative to the mean diagonal."""

_CHUNK: Final = 2000
"""Number of points whose kernels are in memory at once."""


@dataclass(frozen=True)
class Reduction:
    """Difference between a reduced sum and the full one, on the points of the fit.

    Attributes:
        method: how the centres were chosen.
        centres: number of centres that are left.
        of: number of centres of the full sum.
        rms: root mean square of the difference [points].
        largest: largest difference [points].
        points: number of points on which it was measured.
    """

    method: str
    centres: int
    of: int
    rms: float
    largest: float
    points: int

    def __str__(self) -> str:
        """Return the difference as one line."""
        return (
            f"{self.centres} of {self.of} kernels ({self.method}): "
            f"{self.rms:.3g} points rms, {self.largest:.3g} at most, on {self.points} points"
        )


class KernelCost(LearnedCost):
    """A cost that may be one sum of kernels of some features.

    Attributes:
        model: the sum, or another model.
        reduction: how a reduced set of kernels differs from the full one; None for a full set.
    """

    def __init__(
        self,
        model: Any,
        coordinates: Sequence[str],
        minimum: float,
        reduction: Reduction | None = None,
    ) -> None:
        """Keep the model."""
        super().__init__(coordinates, minimum)
        self.model, self.reduction = model, reduction

    def seen(self, points: Array) -> Array:
        """Return the features (n, m) of inputs (n, d) that the model uses: the inputs."""
        return points

    def predict(self, points: Array) -> Array:
        """Return V (n,) of inputs (n, d)."""
        return self.model.values(self.seen(points))

    def with_model(self, model: KernelSum, reduction: Reduction) -> Self:
        """Return the same cost with another sum of kernels."""
        (settings, arrays), (kernels, centres) = self.parts(), model.parts()
        settings |= {**kernels, "reduction": asdict(reduction)}
        names = self.coordinates.names
        return self.from_parts(settings, arrays | centres, names, self.minimum)


Kind = TypeVar("Kind", bound=KernelCost)


def reduced(
    cost: Kind, count: int, data: DataSet, seed: int = 0, method: Method = "clusters"
) -> tuple[Kind, Reduction]:
    """Replace the sum of kernels of a cost by a smaller one.

    Args:
        cost: `Svr`, or `SklearnCost` of one sum of kernels.
        count: centres to keep.
        data: points at which the two should agree, at least as many as centres; labels are not
            used.
        seed: seed of the groups.
        method: how the centres are chosen.

    Returns:
        (smaller cost, its difference from `cost`, which it keeps and saves).

    Raises:
        ModelError: if the cost is not a sum of kernels, has no more than `count` centres, or
            there are too few points.
        MissingExtraError: if scikit-learn is not installed.
    """
    full = getattr(cost, "model", None)
    if not isinstance(full, KernelSum):
        raise ModelError(
            f"reduce: got a {type(cost).__name__}, allowed a cost that is a sum of kernels"
        )
    if method not in get_args(Method):
        raise ModelError(
            f"reduce: got the method {method!r}, allowed {', '.join(get_args(Method))}"
        )
    if not 1 <= count < len(full):
        raise ModelError(
            f"reduce: got {count} centres, allowed at least 1 and fewer than the {len(full)} that"
            " the cost has"
        )
    if len(data) < count:
        raise ModelError(
            f"reduce: got {len(data)} points, allowed at least {count}, one per centre"
        )
    points = cost.seen(data.points)
    target = full.values(points)
    if method == "clusters":
        means = sklearn("cluster", "reducing a kernel cost").MiniBatchKMeans(
            count, random_state=seed, n_init=1, batch_size=4096, max_iter=20
        )
        centres = means.fit(full.centres, sample_weight=np.abs(full.weights)).cluster_centers_
    else:
        centres = full.centres[np.argsort(-np.abs(full.weights))[:count]]
    basis = KernelSum(full.kernel, centres, np.ones(count), 0.0, full.mean, full.scale)
    weights, bias = _least_squares(basis, points, target)
    small = KernelSum(full.kernel, centres, weights, bias, full.mean, full.scale)
    error = small.values(points) - target
    difference = Reduction(
        method,
        count,
        len(full),
        float(np.sqrt(np.mean(error**2))),
        float(np.abs(error).max()),
        len(data),
    )
    return cost.with_model(small, difference), difference


def _least_squares(basis: KernelSum, points: Array, target: Array) -> tuple[Array, float]:
    """Return (weights, bias) of kernels at the centres of `basis`, in chunks of points."""
    count, middle = len(basis), float(target.mean())
    gram, right = np.zeros((count + 1, count + 1)), np.zeros(count + 1)
    for start in range(0, len(points), _CHUNK):
        features = basis.features(points[start : start + _CHUNK])
        features = np.column_stack([features, np.ones(len(features))])
        gram += features.T @ features
        right += features.T @ (target[start : start + _CHUNK] - middle)
    ridge = _RIDGE * np.trace(gram[:count, :count]) / count
    gram[np.diag_indices(count)] += ridge
    solution = np.asarray(np.linalg.solve(gram, right), dtype=float)
    return solution[:count], float(solution[count]) + middle


Choice = Literal["auto", "steps", "plain"]
"""Inputs of the kernels: soft steps, the plain inputs, or whichever makes the data more likely."""

_LEAST_NUMBER: Final = 1e-9
_LARGEST_NUMBER: Final = 1e9
"""Range of penalties and scales with which the solver of the fit works."""

_MEASURED: Final = 0.98
"""Share of the work of a fit that finding the features takes, roughly."""
_LEAST: Final = 20
"""Least number of points for a fit."""

_SILENT: Final = 0.02
"""Features that change the label by less than this share are left out.

The change is that over one standard deviation of the feature. The share is relative to the
standard deviation of the label.
"""

_CACHE_MB: Final = 500
"""Memory that the fit may use for kernel values [MB]."""


class Svr(KernelCost):
    """V(q) by support vector regression with radial kernels.

    Attributes:
        features: maps the inputs to the features that the kernels use.
        model: the sum of kernels of the features.
        coordinates: names of the inputs.
        minimum: V_min, the lowest score of the data [points].
        reduction: how a reduced set differs from the full one; None for a full set.

    Source:
        EPFL semester report, "Learning ergonomic human-robot interaction", its second
        surrogate.

    Example:
        >>> import numpy as np
        >>> from ergoqp.costs.svr import Svr
        >>> from ergoqp.datasets.data import DataSet
        >>> x = np.linspace(-1, 1, 41)[:, None]
        >>> data = DataSet(x, 1 + 4 * x[:, 0] ** 2, ("trunk_flexion",))
        >>> cost = Svr.fit(data, epsilon=0.1, features="plain")
        >>> bool(np.abs(cost.predict(data.points) - data.labels).max() < 0.3)
        True
    """

    name = "svr"

    def __init__(
        self,
        features: Columns | Steps,
        model: KernelSum,
        coordinates: Sequence[str],
        minimum: float,
        reduction: Reduction | None = None,
    ) -> None:
        """Keep the parts. They are described at the attributes.

        Raises:
            ModelError: if the number of features is not the number that the kernels need.
        """
        super().__init__(model, coordinates, minimum, reduction)
        self.features = features
        if len(features) != len(model.scale):
            raise ModelError(
                f"svr: got {len(features)} features, allowed {len(model.scale)}, as many as the"
                " kernels see"
            )

    @classmethod
    def fit(
        cls,
        data: DataSet,
        C: float = 3.0,
        epsilon: float = 0.3,
        gamma: float = 3.0,
        seed: int = 0,
        max_vectors: int | None = None,
        features: Choice = "auto",
        widths: Sequence[float] = (0.05, 1.0),
        shares: Sequence[float] = (0.3, 0.7),
        progress: Progress = unseen,
    ) -> Self:
        """Fit to labelled points.

        Args:
            data: at least 20 points.
            C: penalty of an error outside the tube [points].
            epsilon: half the width of the tube [points]. Half of this value gives twice as
                many support vectors.
            gamma: gamma of the kernel, in units of the fitted relevances. A support vector
                machine needs narrower kernels than the Gaussian process that the relevances
                come from.
            seed: seed of the random part of the data that the length scales are fitted to, and
                of the reduced set.
            max_vectors: largest number of support vectors. If there are more, they are reduced
                to this number, see `ergoqp.costs.svr`.
            features: inputs of the kernels, see `Choice`.
            widths: widths of the soft steps, in standard deviations of the input
                (dimensionless). Narrow steps alone predict best, but between two of them the
                cost is flat and has no useful gradient. The default was chosen by where plain
                descent ends.
            shares: share of each width; the sum must be 1.
            progress: called with the share that is done.

        Raises:
            ModelError: if there are too few points, all labels are the same, or a number is
                out of its range.
            MissingExtraError: if scikit-learn is not installed.
        """
        check_kind("data", data, DataSet, "a DataSet, see ergoqp.datasets.data", ModelError)
        data.require(_LEAST, "svr")
        for what, value, low in (
            ("C", C, _LEAST_NUMBER),
            ("epsilon", epsilon, 0.0),
            ("gamma", gamma, _LEAST_NUMBER),
        ):
            check_number(f"svr {what}", value, low, _LARGEST_NUMBER, error=ModelError)
        check_whole("svr seed", seed, 0, LARGEST_SEED, ModelError)
        if max_vectors is not None:
            check_whole("svr max_vectors", max_vectors, 1, error=ModelError)
        check_word("svr features", features, get_args(Choice), ModelError)
        widths = numbers_of("svr widths", widths, _LEAST_NUMBER, _LARGEST_NUMBER, ModelError)
        shares = numbers_of("svr shares", shares, 0.0, 1.0, ModelError)
        choices = _candidates(data, features, widths, shares)
        best, scale = _metric(choices, data, seed, part_of(progress, 0.0, _MEASURED))
        seen = best.values(data.points)
        mean = seen.mean(axis=0)
        svr = sklearn("svm", "fitting a kernel cost").SVR(
            C=C, epsilon=epsilon, gamma=gamma, cache_size=_CACHE_MB
        )
        svr.fit((seen - mean) / scale, data.labels)
        centres, weights = dense(svr.support_vectors_), dense(svr.dual_coef_).ravel()
        if not len(weights):
            raise ModelError(
                f"svr: no label is further than epsilon {epsilon:g} from all others; use a"
                " smaller epsilon"
            )
        model = KernelSum(
            Kernel("rbf", gamma), centres, weights, float(svr.intercept_[0]), mean, scale
        )
        cost = cls(best, model, data.coordinates, float(data.labels.min()))
        progress(1.0)
        if max_vectors is None or len(model) <= max_vectors:
            return cost
        return reduced(cost, max_vectors, data, seed)[0]

    def seen(self, points: Array) -> Array:
        """Return the features (n, m) of inputs (n, d)."""
        return self.features.values(points)

    def value(self, x: ca.MX) -> ca.MX:
        """Return V, an expression of the inputs (d,)."""
        return self.model.expression(self.features.expression(x))

    def values(self, x: ca.MX) -> ca.MX:
        """Return V (1, k) of k columns of inputs (d, k), an expression."""
        return self.model.expression(
            ca.horzcat(*(self.features.expression(column) for column in ca.horzsplit(x)))
        )

    def slope(self, x: ca.MX) -> ca.MX:
        """Return dV/dx (d,), an expression: the slope of the kernels, through the features."""
        seen = self.features.expression(x)
        return ca.jtimes(seen, x, self.model.value_and_slope(seen)[1], True)

    def parts(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Return (settings, arrays)."""
        settings, arrays = self.model.parts()
        of_features, more = self.features.parts()
        settings["features"] = of_features
        settings["reduction"] = self.reduction and asdict(self.reduction)
        return settings, arrays | more

    @classmethod
    def from_parts(
        cls, settings: Settings, arrays: Arrays, coordinates: Sequence[str], minimum: float
    ) -> Self:
        """Return the cost with these `parts`. The arrays must have the same shapes."""
        features = features_from(settings["features"], arrays)
        model = KernelSum.from_parts(settings, arrays)
        reduction = settings["reduction"] and Reduction(**settings["reduction"])
        return cls(features, model, coordinates, minimum, reduction)


def _candidates(
    data: DataSet, choice: Choice, widths: Sequence[float], shares: Sequence[float]
) -> list[Columns | Steps]:
    """Return the sets of features to choose from."""
    varied = tuple(np.flatnonzero(np.ptp(data.points, axis=0) > 0).tolist())
    if not varied:
        raise ModelError("svr: got the same point everywhere, allowed different points")
    if choice == "plain":
        return [Columns(varied)]
    steps = Steps.fit(data.points, data.labels, widths, shares)
    if choice == "auto" and not len(steps):
        return [Columns(varied)]
    if not len(steps):
        raise ModelError(
            "svr: no input has a step in its effect on the label; use features: plain or auto"
        )
    return [steps] if choice == "steps" else [steps, Columns(varied)]


def _metric(
    candidates: Sequence[Columns | Steps], data: DataSet, seed: int, progress: Progress
) -> tuple[Columns | Steps, Array]:
    """Return the features that make the data most likely, and the scale of each.

    Features that do not matter are left out.
    """
    best, scale, lowest = candidates[0], np.empty(0), np.inf
    for number, features in enumerate(candidates, 1):
        seen = features.values(data.points)
        spread = seen.std(axis=0)
        part = part_of(progress, (number - 1) / len(candidates), number / len(candidates))
        unit = (seen - seen.mean(axis=0)) / spread
        factors, slopes, cost = relevance(unit, data.labels, seed, progress=part)
        kept = slopes >= min(_SILENT * data.labels.std(), slopes.max())
        if cost < lowest:
            best, lowest = features.part(np.flatnonzero(kept).tolist()), cost
            scale = (spread / np.sqrt(factors))[kept]
    return best, scale
