"""The data set of the forearm: elbow and wrist of random postures, clustered.

Of each cluster only the points with the lowest score are kept.

The score of a posture has causes that elbow and wrist do not show, for example a bent neck or
the other arm. The EPFL report (section 4.2.3) therefore clusters the points and keeps those
with the lowest score of their cluster. Their score is due to the forearm.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ergoqp.arguments import LARGEST_SEED, check_whole
from ergoqp.coordinates import FOREARM
from ergoqp.datasets.cache import cached_data
from ergoqp.datasets.data import DataSet
from ergoqp.datasets.postures import MOST_PER_SCORE
from ergoqp.datasets.sampler import balanced_postures
from ergoqp.human import Body
from ergoqp.human.forearm import forearm_length, forearm_points, read_points
from ergoqp.learning.pipelines import sklearn
from ergoqp.progress import Progress

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

    asked = {
        "version": 2,
        "per_score": per_score,
        "seed": seed,
        "clusters": clusters,
        "empty": empty,
    }
    data = (
        cached_data("forearm", {**asked, "lengths": dict(body.lengths)}, make) if cache else make()
    )
    progress(1.0)
    return data


def nearest_sample_cost(points: ArrayLike, data: DataSet) -> Array:
    """Return the label (n,) of the nearest data point to each point.

    The EPFL report judges the end of a descent in this way.

    Args:
        points: shape (n, 6) [m].
        data: data with the same coordinates.
    """
    rows = read_points(points)
    squares = (data.points**2).sum(axis=1)
    parts = [squares - 2 * rows[i : i + 256] @ data.points.T for i in range(0, len(rows), 256)]
    return (
        data.labels[np.concatenate([np.argmin(part, axis=1) for part in parts])]
        if parts
        else np.empty(0)
    )


def _make(
    per_score: int, seed: int, clusters: int, body: Body, empty: int, progress: Progress
) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    postures, scores = balanced_postures(per_score, rng, scores=SCORES)
    progress(0.1)
    blocks = range(0, len(postures), _BLOCK)
    points = np.concatenate([forearm_points(postures[i : i + _BLOCK], body) for i in blocks])
    progress(0.2)
    cluster = _cluster(points, clusters, seed)
    progress(0.9)
    lowest = np.full(clusters, np.iinfo(scores.dtype).max)
    np.minimum.at(lowest, cluster, scores)
    kept = scores == lowest[cluster]
    gaps, gap_labels = _empty_points(points, empty, forearm_length(body), rng)
    labels = np.concatenate([scores[kept].astype(float), gap_labels])
    order = rng.permutation(len(labels))
    return np.concatenate([points[kept], gaps])[order], labels[order]


def _cluster(points: Array, clusters: int, seed: int) -> NDArray[np.int32]:
    # With a few points per cluster random starts are good enough. All columns are in metres,
    # so nothing is scaled.
    means = sklearn("cluster", "the forearm's data set").KMeans(
        clusters, init="random", n_init=1, max_iter=20, random_state=seed
    )
    return means.fit(points).labels_


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
        drawn = np.hstack(
            [elbow, elbow + length * way / np.linalg.norm(way, axis=1, keepdims=True)]
        )
        apart = tree.query(drawn)[0][:, 0]
        far = apart > EMPTY_DISTANCE
        found, distance = (
            np.concatenate([found, drawn[far]]),
            np.concatenate([distance, apart[far]]),
        )
    return found[:count], SCORES[-1] + EMPTY_SLOPE * (distance[:count] - EMPTY_DISTANCE)
