"""The learned models of the problem ``forearm``: two costs and the boundary of their data.

This module made the files that come with the package.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ergoqp.costs.ladder import OneClassLadder
from ergoqp.costs.learned import LearnedCost
from ergoqp.costs.reduce import reduced
from ergoqp.costs.svr import Svr
from ergoqp.datasets.data import DataSet
from ergoqp.learning.features import Columns
from ergoqp.learning.kernels import Kernel, KernelSum
from ergoqp.learning.one_class import OneClass
from ergoqp.learning.pipelines import sklearn
from ergoqp.progress import Progress
from ergoqp.studies.forearm.data import forearm_data

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
    machine = sklearn("svm", "fitting a kernel cost").SVR(
        C=10.0, gamma=0.25, epsilon=1.0, cache_size=500
    )
    machine.fit((data.points - mean) / scale, data.labels)
    centres, weights = machine.support_vectors_, machine.dual_coef_.ravel()
    model = KernelSum(
        Kernel("rbf", 0.25), centres, weights, float(machine.intercept_[0]), mean, scale
    )
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
    lowest = float(scores[0])
    terms = (
        fitted.rungs,
        fitted.scores.tolist(),
        data.coordinates,
        lowest,
        fitted.steepness,
        fitted.pull,
    )
    return OneClassLadder(*terms, reach=fitted.reach, offset=lowest, height=1.0)
