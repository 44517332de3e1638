"""Every cost against the sheet on postures that it has not seen.

Run ``python -m benchmarks.surrogates``.

All costs of a run are fitted to the same balanced sheet-labelled postures of 20 joints, 1000 of
each score, and judged on others from another seed. ``--quick`` judges on fewer, fits the costs of
the `interval` labels to fewer, and leaves out the large network and the learning curve.

- ``<cost>.mae``: mean error of the value against the sheet [points]; ``.exact``, ``.within1``:
  share whose rounded value is the score, or at most one off; ``.spearman``: rank correlation;
  ``.worst``: largest error [points].
- ``<cost>.us``: median time of value and gradient through the function's buffers; ``.size``: of the
  saved model [kB].
- ``<cost>_interval.*``: the same cost fitted to, and judged by, the simplified labels behind the
  EPFL report's data; ``<cost>_interval.sheet_mae``, ``.sheet_exact``: the same fit judged by the
  sheet, on the postures of the first kind, whose joints range further than those data.
- ``svr_<n>.mae``, ``.exact``: fitted to n postures. ``.vectors``: how many it keeps.
- ``neural``: the shipped model of 22 joints, on unseen postures of these. ``neural_<n>``: fitted to
  the n postures of the run. ``neural_full``: trained here on a stream of 20 million, with a larger
  network; ``.fit_s`` its training time.
- ``neural.mae_near``, ``.exact_near``: of the postures with a joint within 0.2 deg of a band end,
  ``.share_near`` of all.

The costs: ``constant`` (the median label), ``quadratic``, ``gmr``, ``gmr_joint`` (the EPFL report's
kind), ``svr``, ``svr_default`` (scikit-learn's own settings), ``one_class_ladder``, ``neural``;
beside them the sheet's own smooth reading, ``smooth_reba`` as the controller uses it and
``smooth_reba_sharp`` at 0.25 deg.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Report, run
from ergoqp.coordinates import SCORED_JOINTS, Coordinates
from ergoqp.costs.cost import LearnedCost
from ergoqp.costs.from_sklearn import from_sklearn
from ergoqp.costs.gmr import Gmr
from ergoqp.costs.load import evaluation_time, load_cost, quality_of
from ergoqp.costs.neural import Neural
from ergoqp.costs.one_class_ladder import OneClassLadder
from ergoqp.costs.quadratic import Quadratic
from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.costs.svr import Svr
from ergoqp.datasets.data import DataSet
from ergoqp.datasets.postures import posture_data
from ergoqp.joints import SIDES
from ergoqp.registry import data_folder
from ergoqp.sheets.options import Method, sheet_of

SEED, UNSEEN = 0, 2024
"""Seeds of the postures that costs are fitted to, and of those that judge them."""

NEAR_DEG = 0.2
FULL_COUNT = 20_000_000
CURVE = (1000, 2000, 5000, 10_000, 20_000, 50_000)
"""Numbers of postures of the learning curve."""


def svr_default(data: DataSet) -> LearnedCost:
    """Fit scikit-learn's support vector regression as it comes."""
    from sklearn.svm import SVR

    return from_sklearn(SVR().fit(data.points, data.labels), data.coordinates)


def gmr_joint(data: DataSet) -> LearnedCost:
    """Fit one mixture over posture and score, as the EPFL report does."""
    return Gmr.fit(data, variant="joint")


FITS: dict[str, Callable[[DataSet], LearnedCost]] = {
    "quadratic": Quadratic.fit,
    "gmr": Gmr.fit,
    "gmr_joint": gmr_joint,
    "svr": Svr.fit,
    "svr_default": svr_default,
    "one_class_ladder": OneClassLadder.fit,
    "neural": Neural.fit,
}


def judge(report: Report, name: str, cost: Any, data: DataSet) -> NDArray[np.float64]:
    """Report all figures of a cost on unseen data, and return its values."""
    states = Coordinates(data.coordinates).spread(data.points)
    values = cost(states)
    report_quality(report, name, values, data)
    report.figure(
        f"{name}.us", evaluation_time(cost.value_and_gradient, states, 300), "value and gradient"
    )
    if isinstance(cost, LearnedCost):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "model.npz"
            cost.save(path)
            report.figure(f"{name}.size", path.stat().st_size / 1e3, "kB")
    return values


def report_quality(report: Report, name: str, values: NDArray[np.float64], data: DataSet) -> None:
    """Report how well values agree with labels."""
    for measure, value in quality_of(values, data.labels).as_dict().items():
        report.figure(f"{name}.{measure}", value)


def fitted(report: Report, kind: str, data: DataSet) -> LearnedCost:
    """Fit a cost and say how long it took."""
    start = time.perf_counter()
    cost = FITS[kind](data)
    report.say(
        f"{kind}: fitted to {len(data)} postures in {time.perf_counter() - start:.1f} s"
        f" ({data.source})"
    )
    return cost


def near_band_end(data: DataSet) -> NDArray[np.bool_]:
    """Return which points (n,) have a joint within `NEAR_DEG` of an end of its bands."""
    near = np.zeros(len(data), dtype=bool)
    for segment in sheet_of(Method()).segments.values():
        for step in segment.steps:
            for side in SIDES:
                joint = Coordinates(data.coordinates).state[segment.joint(step, side)]
                if joint in data.coordinates:
                    angles = data.points[:, data.coordinates.index(joint), np.newaxis]
                    near |= (np.abs(angles - np.array(step.edges)) < np.radians(NEAR_DEG)).any(
                        axis=1
                    )
    return near


def shipped(report: Report, per_score: int) -> None:
    """Judge the network that comes with the package, also close to band ends."""
    data = posture_data(per_score, seed=UNSEEN, joints=SCORED_JOINTS)
    values = judge(report, "neural", load_cost(data_folder("models") / "neural_sheet.npz"), data)
    near = near_band_end(data)
    close = quality_of(values[near], data.labels[near])
    report.figure(
        "neural.share_near", near.mean(), f"with a joint within {NEAR_DEG:g} deg of a band end"
    )
    report.figure("neural.mae_near", close.mae, "of these")
    report.figure("neural.exact_near", close.exact, "of these")


def trained(report: Report, unseen: DataSet) -> None:
    """Train a larger network for longer."""
    start = time.perf_counter()
    cost = Neural.fit_sheet(FULL_COUNT, unseen.coordinates, hidden=(128, 64), steps=16, seed=SEED)
    report.figure("neural_full.fit_s", time.perf_counter() - start, f"for {FULL_COUNT:,} postures")
    judge(report, "neural_full", cost, unseen)


def learning_curve(report: Report, unseen: DataSet) -> None:
    """Fit support vector machines to more and more postures."""
    for count in CURVE:
        cost = Svr.fit(posture_data(count // 10, seed=SEED + 1))
        quality = quality_of(cost.predict(unseen.points), unseen.labels)
        report.figure(f"svr_{count}.mae", quality.mae)
        report.figure(f"svr_{count}.exact", quality.exact)
        report.figure(f"svr_{count}.vectors", len(cost.model))


def measure(report: Report) -> None:
    """Fit and judge every cost."""
    judged, simplified = report.pick((300, 150), (2000, 1000))
    data, unseen = posture_data(1000, seed=SEED), posture_data(judged, seed=UNSEEN)
    report_quality(report, "constant", np.full(len(unseen), np.median(data.labels)), unseen)
    judge(report, "smooth_reba", SmoothReba(), unseen)
    judge(report, "smooth_reba_sharp", SmoothReba((0.25,), (1.0,)), unseen)
    shipped(report, judged)
    for kind in FITS:
        judge(
            report,
            f"neural_{len(data)}" if kind == "neural" else kind,
            fitted(report, kind, data),
            unseen,
        )
    data, simple = (
        posture_data(n, "interval", seed=seed) for n, seed in ((simplified, SEED), (judged, UNSEEN))
    )
    report_quality(
        report, "constant_interval", np.full(len(simple), np.median(data.labels)), simple
    )
    for kind in FITS:
        name = f"neural_{len(data)}_interval" if kind == "neural" else f"{kind}_interval"
        cost = fitted(report, kind, data)
        judge(report, name, cost, simple)
        by_sheet = quality_of(cost.predict(unseen.points), unseen.labels)
        report.figure(f"{name}.sheet_mae", by_sheet.mae, "against the sheet")
        report.figure(f"{name}.sheet_exact", by_sheet.exact)
    if report.full:
        trained(report, unseen)
        learning_curve(report, unseen)


if __name__ == "__main__":
    run(measure, "Every cost against the sheet on unseen postures.")
