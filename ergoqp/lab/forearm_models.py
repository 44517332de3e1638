"""The data set and the learned models of the problem ``forearm``, and its descent.

The data set of the forearm: elbow and wrist of random postures, clustered. Of each cluster only the
points with the lowest score are kept.

The score of a posture has causes that elbow and wrist do not show, for example a bent neck or
the other arm. The EPFL report (section 4.2.3) therefore clusters the points and keeps those
with the lowest score of their cluster. Their score is due to the forearm.

The learned models of the problem ``forearm``: two costs and the boundary of their data. This module
made the files that come with the package.

Gradient descent in the six coordinates, as in the EPFL report (section 4.2.3). It is the baseline
for the constraints of this package.

The variants of the report, in its order: the plain gradient, which changes the length of the
forearm (figure 20); the same with the length kept (21); with the gradient of a one-class SVM
added, to stay near the data (22, 23); and one one-class SVM per score, from class i toward the
class below (24, 25). Each is stopped where the estimated cost is 1.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ergoqp.arguments import LARGEST_SEED, Progress, check_whole
from ergoqp.coordinates import FOREARM, Coordinates
from ergoqp.costs.cost import LearnedCost
from ergoqp.costs.one_class_ladder import OneClassLadder
from ergoqp.costs.svr import Svr, reduced
from ergoqp.datasets.data import DataSet, cached_data
from ergoqp.datasets.postures import MOST_PER_SCORE, balanced_postures
from ergoqp.human import Body
from ergoqp.human.forearm import forearm_length, forearm_points
from ergoqp.learning.kernels import Columns, Kernel, KernelSum
from ergoqp.learning.one_class import OneClass
from ergoqp.learning.pipelines import sklearn

Array = NDArray[np.float64]

SCORES: Final = range(1, 11)
"""Scores of the base postures."""

EMPTY_DISTANCE: Final = 0.15
"""A point is empty if it is farther than this from every base posture [m].

It is the distance of both points together.
"""

EMPTY_SLOPE: Final = 10.0
"""Slope of the label of an empty point with the distance from the nearest posture [points/m].

The label starts at the highest score.
"""

_MARGIN: Final = 0.15
"""Empty points are drawn up to this distance around the elbows of the base postures [m]."""
_BLOCK: Final = 100_000
_MOST_EMPTY: Final = 1_000_000


def forearm_data(
    per_score: int = 1000,
    seed: int = 0,
    clusters: int | None = None,
    body: Body | None = None,
    *,
    empty: int = 0,
    cache: bool = True,
    progress: Progress | None = None,
) -> DataSet:
    """Return elbows and wrists of the right arm, labelled with sheet scores.

    Args:
        per_score: random postures of each score 1 to 10, before clustering.
        seed: seed of the random numbers.
        clusters: number of clusters of k-means in the six coordinates; None: one per four
            postures, which keeps about a third of them, as in the EPFL report (2281 of 10000).
        body: the person; default: the nominal one.
        empty: number of points to add where no base posture is near, because it is out of
            reach or rare. Their label is the highest score plus a term that grows with the
            distance. Without these points a regression may be low where there were no data,
            and a descent ends there. With one constant label it is flat there, and a descent
            does not leave.
        cache: keep the data set on disk, and read it from there when the arguments are the
            same again.
        progress: called from time to time with the share that is done.

    Returns:
        The data set, coordinates `ergoqp.coordinates.FOREARM` [m], in random order.

    Raises:
        InputError: if the number of postures, clusters or empty points is out of range.
        MissingExtraError: if scikit-learn is not installed.
    """
    check_whole("per_score", per_score, 1, MOST_PER_SCORE)
    check_whole("seed", seed, 0, LARGEST_SEED)
    base = per_score * len(SCORES)
    clusters = max(1, base // 4) if clusters is None else clusters
    check_whole("clusters", clusters, 1, base)
    check_whole("empty", empty, 0, _MOST_EMPTY)
    body, progress = body or Body(), progress or (lambda share: None)

    def make() -> DataSet:
        points, labels = _make(per_score, seed, clusters, body, empty, progress)
        source = (
            f"forearm, {per_score} postures per score, {clusters} clusters, {empty} empty points,"
            f" seed {seed}"
        )
        return DataSet(points, labels, FOREARM, source)

    asked = {"version": 2, "per_score": per_score, "seed": seed, "clusters": clusters}
    asked |= {"empty": empty, "lengths": dict(body.lengths)}
    data = cached_data("forearm", asked, make) if cache else make()
    progress(1.0)
    return data


def nearest_sample_cost(points: ArrayLike, data: DataSet) -> Array:
    """Return the label (n,) of the nearest data point to each point.

    The EPFL report judges the end of a descent in this way.

    Args:
        points: shape (n, 6) [m].
        data: data with the same coordinates.
    """
    rows = Coordinates(FOREARM).rows(points)
    squares, nearest = (data.points**2).sum(axis=1), np.empty(len(rows), dtype=int)
    for i in range(0, len(rows), 256):
        apart = squares - 2 * rows[i : i + 256] @ data.points.T
        nearest[i : i + 256] = np.argmin(apart, axis=1)
    return data.labels[nearest]


def _make(
    per_score: int, seed: int, clusters: int, body: Body, empty: int, progress: Progress
) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    postures, scores = balanced_postures(per_score, rng, scores=SCORES)
    progress(0.1)
    blocks = range(0, len(postures), _BLOCK)
    points = np.concatenate([forearm_points(postures[i : i + _BLOCK], body) for i in blocks])
    progress(0.2)
    # With a few points per cluster random starts are good enough. All columns are in metres,
    # so nothing is scaled.
    means = sklearn("cluster", "the forearm's data set").KMeans(
        clusters, init="random", n_init=1, max_iter=20, random_state=seed
    )
    cluster = means.fit(points).labels_
    progress(0.9)
    lowest = np.full(clusters, np.iinfo(scores.dtype).max)
    np.minimum.at(lowest, cluster, scores)
    kept = scores == lowest[cluster]
    gaps, gap_labels = _empty_points(points, empty, forearm_length(body), rng)
    labels = np.concatenate([scores[kept].astype(float), gap_labels])
    order = rng.permutation(len(labels))
    return np.concatenate([points[kept], gaps])[order], labels[order]


def _empty_points(
    points: Array, count: int, length: float, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Return pairs of points (count, 6) that are far from every posture's pair, and their labels.

    The labels have the shape (count,). The points of a pair are a forearm apart, in any
    direction.
    """
    low, high = points[:, :3].min(axis=0) - _MARGIN, points[:, :3].max(axis=0) + _MARGIN
    tree = sklearn("neighbors", "the forearm's data set").KDTree(points)
    found, distance = np.empty((0, 6)), np.empty(0)
    while len(found) < count:
        elbow, way = rng.uniform(low, high, (count, 3)), rng.normal(size=(count, 3))
        wrist = elbow + length * way / np.linalg.norm(way, axis=1, keepdims=True)
        drawn = np.hstack([elbow, wrist])
        apart = tree.query(drawn)[0][:, 0]
        far = apart > EMPTY_DISTANCE
        found, distance = np.concatenate([found, drawn[far]]), np.append(distance, apart[far])
    return found[:count], SCORES[-1] + EMPTY_SLOPE * (distance[:count] - EMPTY_DISTANCE)


KERNELS = 800
"""Support vectors that are kept of the regression. The ends of descents then stay the same."""

RUNG = 600
"""Largest number of points per score for the fit of its one-class SVM."""


@dataclass(frozen=True)
class ForearmModels:
    """The models that `fit_forearm_models` fits.

    Attributes:
        svr: the regression on data with empty places labelled as the worst.
        report_svr: the same regression without empty places, as in the EPFL report.
        ladder: one one-class SVM per score.
        boundary: boundary of all data.
    """

    svr: LearnedCost
    report_svr: LearnedCost
    ladder: OneClassLadder
    boundary: OneClass

    def save(self, folder: Path) -> None:
        """Write ``forearm_svr.npz``, ``forearm_ladder.npz`` and ``forearm_boundary.npz``.

        These are the files that the problem needs.
        """
        self.svr.save(folder / "forearm_svr.npz")
        self.ladder.save(folder / "forearm_ladder.npz")
        self.boundary.save(folder / "forearm_boundary.npz")


def fit_forearm_models(
    per_score: int = 3000, rows: int = 3000, seed: int = 0, progress: Progress | None = None
) -> ForearmModels:
    """Fit all models of the forearm.

    Args:
        per_score: base postures of each score, see `forearm_data`.
        rows: largest number of data points for the fit of each machine, and the number of
            empty places for the second one.
        seed: seed of the data.
        progress: called from time to time with the share that is done.

    Raises:
        MissingExtraError: if scikit-learn is not installed.
    """
    progress = progress or (lambda share: None)
    kept = forearm_data(per_score, seed)
    progress(0.3)
    filled = forearm_data(per_score, seed, empty=2 * rows)
    progress(0.6)
    rng = np.random.default_rng(seed)
    some = kept.part(rng.permutation(len(kept))[:rows])
    empty = filled.part(rng.permutation(np.flatnonzero(filled.labels > kept.labels.max()))[:rows])
    both = DataSet(
        np.vstack([some.points, empty.points]),
        np.concatenate([some.labels, empty.labels]),
        kept.coordinates,
    )
    report_svr, svr = _machine(some), _machine(both)
    progress(0.8)
    boundary = OneClass.fit(
        kept.points[rng.permutation(len(kept))[: 2 * rows]], kept.coordinates, nu=0.01, gamma=0.25
    )
    ladder = _ladder(kept, rng)
    progress(1.0)
    return ForearmModels(svr, report_svr, ladder, boundary)


def _machine(data: DataSet) -> LearnedCost:
    """Fit a regression with wide kernels.

    It must give a useful gradient, and the labels are noisy because of causes outside the
    forearm.
    """
    mean, scale = data.points.mean(axis=0), data.points.std(axis=0)
    regression = sklearn("svm", "fitting a kernel cost").SVR
    machine = regression(C=10.0, gamma=0.25, epsilon=1.0, cache_size=500)
    machine.fit((data.points - mean) / scale, data.labels)
    centres, weights = machine.support_vectors_, machine.dual_coef_.ravel()
    offset = float(machine.intercept_[0])
    model = KernelSum(Kernel("rbf", 0.25), centres, weights, offset, mean, scale)
    cost = Svr(Columns(tuple(range(len(mean)))), model, data.coordinates, float(data.labels.min()))
    return reduced(cost, KERNELS, data)[0] if len(model) > KERNELS else cost


def _ladder(data: DataSet, rng: np.random.Generator) -> OneClassLadder:
    """Fit a ladder to at most `RUNG` points of each score, without scores that have fewer than 20.

    Each rung is the core of its class, two thirds of it. A wider one also contains places that
    only neighbouring classes reach, or no posture. The calibration of the ladder is made for
    predictions. Here the classes overlap so much that it would flatten the ladder. For a
    descent each rung should count as much as its score.
    """
    scores, counts = np.unique(data.labels, return_counts=True)
    scores = scores[counts >= 20]
    chosen = [rng.permutation(np.flatnonzero(data.labels == score))[:RUNG] for score in scores]
    fitted = OneClassLadder.fit(data.part(np.concatenate(chosen)), nu=0.3, gamma=0.5)
    lowest, levels = float(scores[0]), fitted.scores.tolist()
    terms = (fitted.rungs, levels, data.coordinates, lowest, fitted.steepness, fitted.pull)
    return OneClassLadder(*terms, reach=fitted.reach, offset=lowest, height=1.0)


Slope = Callable[[Array], tuple[Array, Array]]
"""Points (n, 6) -> values (n,) and gradients (n, 6) of the function to descend."""


@dataclass(frozen=True, eq=False)
class Descent:
    """Many descents with the same number of steps.

    Attributes:
        path: all points on the way, shape (steps + 1, n, 6) [m]; a stopped descent stays where
            it is.
        values: values of the function along the way (steps + 1, n).
    """

    path: Array
    values: Array

    @property
    def ends(self) -> Array:
        """End of each descent (n, 6) [m]."""
        return self.path[-1]


def descend(
    slope: Slope,
    starts: Array,
    *,
    stop_at: float | None = 1.0,
    length: float | None = None,
    steps: int = 500,
    rate: float = 2e-3,
    longest: float = 0.01,
) -> Descent:
    """Follow the negative gradient from many starts at once.

    Args:
        slope: the function to descend.
        starts: shape (n, 6) [m].
        stop_at: a descent stops for good where the value is not above this; None: never.
        length: distance of elbow and wrist to keep [m]: after each step both points move along
            their line, each by half of the difference, which is the orthogonal projection;
            None: not kept.
        steps: number of steps.
        rate: step per gradient [m^2 per unit of the value].
        longest: largest length of a step, for both points together [m].
    """
    points = np.array(starts, dtype=float, ndmin=2)
    points = points if length is None else keep_length(points, length)
    value, gradient = slope(points)
    path, values = [points], [value]
    stopped = np.zeros(len(points), dtype=bool)
    for _ in range(steps):
        if stop_at is not None:
            stopped |= value <= stop_at
        step = -rate * gradient
        step *= np.minimum(
            1, longest / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-12)
        )
        step[stopped] = 0
        moved = points + step
        points = np.where(
            stopped[:, None], points, moved if length is None else keep_length(moved, length)
        )
        value, gradient = slope(points)
        path.append(points)
        values.append(value)
    return Descent(np.stack(path), np.stack(values))


def keep_length(points: Array, length: float) -> Array:
    """Return the nearest points (n, 6) to those given whose two ends are `length` apart [m]."""
    apart = points[:, 3:] - points[:, :3]
    distance = np.linalg.norm(apart, axis=1, keepdims=True)
    shift = apart * (length / distance - 1) / 2
    return points + np.hstack([-shift, shift])


def slope_of(function: ca.Function) -> Slope:
    """Return a CasADi function ``x (6,) -> value, gradient (6,)`` as a function of many points.

    An example is the `value_and_gradient` of a cost.
    """

    def slope(points: Array) -> tuple[Array, Array]:
        value, gradient = function.map(len(points))(points.T)
        return np.asarray(value).ravel(), np.asarray(gradient).T

    return slope


def added(cost: Slope, margin: Slope, weight: float) -> Slope:
    """Return the cost with the gradient of a one-class SVM added, which points inside.

    The value stays that of the cost.

    Args:
        cost: the cost to descend.
        margin: margin of the one-class SVM, positive inside.
        weight: weight of its gradient [points per unit of the margin].
    """

    def slope(points: Array) -> tuple[Array, Array]:
        value, gradient = cost(points)
        return value, gradient - weight * margin(points)[1]

    return slope


def toward_class_below(margins: Sequence[Slope], scores: Sequence[float]) -> Slope:
    """Return the slope that leads from class i into the one-class SVM of the class below.

    The class of a point is the lowest whose SVM contains it. If none does, it is the one with
    the largest margin. The value is the score of this class. In the lowest class the slope
    leads further into it.

    Args:
        margins: margins of the one-class SVMs, positive inside, by ascending score.
        scores: scores of the classes, ascending.
    """

    def slope(points: Array) -> tuple[Array, Array]:
        found = [margin(points) for margin in margins]
        values = np.stack([value for value, _ in found])
        inside = values >= 0
        current = np.where(inside.any(axis=0), inside.argmax(axis=0), values.argmax(axis=0))
        uphill = np.stack([gradient for _, gradient in found])[
            np.maximum(current - 1, 0), np.arange(len(points))
        ]
        return np.asarray(scores, dtype=float)[current], -uphill

    return slope
