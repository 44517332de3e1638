"""Where a led forearm ends, judged by truth: the report's ways and the constraints.

Run ``python -m benchmarks.forearm``.

Starts are unseen points of every true cost that there is inside the boundary; ``true`` is the
lowest sheet score of any whole-body posture whose elbow and wrist are there
(`ergoqp.lab.forearm.true_cost`), 0 if there is none, and such an end counts as failed and as
worse.

Methods: ``gmr``, ``svr`` (plain gradient of the report's machine), ``svr_length`` (length
maintained), ``svr_added`` (the gradient of the one-class SVM added), ``svr_report_constraints``
(the report's machine, but length and boundary as rows of the control step), ``svr_constraints``
(the same rows; the machine has also seen where nobody is), ``svr_without_boundary`` (the same
machine without the row of the boundary: what the data do by themselves), ``ladder_gradients`` (the
report's best way) and ``ladder_constraints``. The baselines stop where the estimated cost is 1, as
in the report.

- ``<method>.share_at_1``: ends at true cost 1. ``.worse_than_start``: true cost above the start's,
  or unreachable.
- ``.nearest_at_1``: the same by the report's judge, the label of the nearest sample of its data.
- ``.max_length_error`` [m], ``.min_margin``: over every step of every run. ``.seconds``: median
  duration, constrained ones.
- ``starts``, ``mean_start``; ``back_inside_s``: longest time until a run from outside is inside the
  boundary, of ``outside`` starts up to 0.1 m away, and ``outside_min_margin``: the least margin
  after that.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Report, run
from ergoqp.costs.cost import LearnedCost
from ergoqp.costs.gmr import Gmr
from ergoqp.datasets.data import DataSet
from ergoqp.datasets.postures import balanced_postures
from ergoqp.human.forearm import forearm_length, forearm_points
from ergoqp.lab.forearm import forearm_data, nearest_sample_cost, true_cost
from ergoqp.lab.forearm_models import (
    ForearmModels,
    added,
    descend,
    fit_forearm_models,
    slope_of,
    toward_class_below,
)
from ergoqp.limits import ArmLength, OneClassBoundary
from ergoqp.problem.load import load_problem
from ergoqp.problem.problem import Problem
from ergoqp.simulation.points import run_points
from ergoqp.step.stepper import Stepper

Array = NDArray[np.float64]

ADDED = 1.0
"""Weight of the added gradient [points per unit of the margin]."""
STEPS = 800
"""Steps of the report's descents."""
LONGEST = 20.0
"""Longest run of a constrained one [s]."""


def draw_starts(
    models: ForearmModels, each: int, pool: int, hard: int
) -> tuple[Array, NDArray[np.int64]]:
    """Return unseen points inside the boundary, at most `each` per true cost, and their true costs.

    High true costs are rare, and the choice of each cluster's lowest label thins them out once
    more, so that what the data set lacks is looked for among random postures of the highest label.

    Args:
        models: have the boundary.
        each: most starts of a true cost.
        pool: postures per score of the unseen data set.
        hard: postures of the highest label.
    """
    data = forearm_data(pool, seed=1)
    postures, _ = balanced_postures(hard, np.random.default_rng(8), scores=[10])
    points = ArmLength(forearm_length()).project(
        np.concatenate([data.points, forearm_points(postures)])
    )
    inside = models.boundary.margin(points) > 0
    order = np.random.default_rng(7).permutation(len(data))
    first, second = order[inside[order]], len(data) + np.flatnonzero(inside[len(data) :])
    rows = np.concatenate([first, second])
    with _processes() as processes:
        scores = np.concatenate(list(processes.map(true_cost, np.array_split(points[rows], 64))))
    chosen = np.concatenate(
        [np.flatnonzero(scores == score)[:each] for score in range(1, int(scores.max()) + 1)]
    )
    return points[rows[chosen]], scores[chosen]


def _processes() -> ProcessPoolExecutor:
    return ProcessPoolExecutor(min(2, os.cpu_count() or 1), mp_context=get_context("fork"))


def constrained(problem: Problem, starts: Array) -> tuple[Array, list[Array], float]:
    """Return where the control step leads from each start.

    Also return all states on the way, and the median duration [s].
    """
    stepper = Stepper(problem)
    runs = [run_points(problem, start, LONGEST, stepper=stepper) for start in starts]
    seconds = float(np.median([len(one.twists) * one.dt for one in runs]))
    return np.array([one.states[-1] for one in runs]), [one.states for one in runs], seconds


def problem_with(models: ForearmModels, cost: LearnedCost, bounded: bool = True) -> Problem:
    """Return the problem ``forearm`` with these models, with or without the boundary as a limit."""
    plain = load_problem("forearm")
    limits = [limit for limit in plain.limits if not isinstance(limit, OneClassBoundary)]
    boundary = [OneClassBoundary(models.boundary, hard=True)] if bounded else []
    return plain.replace(cost=cost, limits=[*limits, *boundary])


def report_ways(models: ForearmModels, data: DataSet) -> dict[str, Callable[[Array], Array]]:
    """Return the descents of the report: starts -> all points on the way (steps + 1, n, 6)."""
    length = forearm_length()
    gmr = slope_of(Gmr.fit(data, variant="joint").value_and_gradient)
    svr, margin = (
        slope_of(models.report_svr.value_and_gradient),
        slope_of(models.boundary.margin_and_slope),
    )
    rungs = toward_class_below(
        [slope_of(rung.margin_and_slope) for rung in models.ladder.rungs],
        models.ladder.scores.tolist(),
    )

    def way(slope: Any, **options: Any) -> Callable[[Array], Array]:
        return lambda starts: descend(slope, starts, steps=STEPS, **options).path

    return {
        "gmr": way(gmr, length=length),
        "svr": way(svr),
        "svr_length": way(svr, length=length),
        "svr_added": way(added(svr, margin, ADDED), length=length),
        "ladder_gradients": way(rungs, length=length, stop_at=None),
    }


_PROBLEMS: dict[str, Problem] = {}
"""For the processes, which inherit it: expressions cannot be sent."""


def _constrained(name: str, starts: Array) -> tuple[Array, list[Array], float]:
    return constrained(_PROBLEMS[name], starts)


def measure(report: Report) -> None:
    """Fit the models, run every method, judge by truth."""
    per_score, each, pool, hard = report.pick((1000, 6, 100, 300), (3000, 100, 1500, 14_000))
    models = fit_forearm_models(per_score=per_score)
    data = forearm_data(1000)
    starts, scores = draw_starts(models, each, pool, hard)
    report.figure(
        "starts",
        len(starts),
        f"of true cost {', '.join(f'{s}: {(scores == s).sum()}' for s in np.unique(scores))}",
    )
    report.figure("mean_start", scores.mean())
    for name, way in report_ways(models, data).items():
        path = way(starts)
        _judge(report, name, models, data, starts, scores, path[-1], path.reshape(-1, 6))
    costs = {
        "svr_report_constraints": models.report_svr,
        "svr_constraints": models.svr,
        "svr_without_boundary": models.svr,
        "ladder_constraints": models.ladder,
    }
    outside = _outside(models, report.pick(6, 60))
    _PROBLEMS.update(
        {name: problem_with(models, cost, "without" not in name) for name, cost in costs.items()}
    )
    with _processes() as processes:
        for name in costs:
            found = list(processes.map(_constrained, [name] * 2, np.array_split(starts, 2)))
            ends = np.concatenate([part[0] for part in found])
            path = np.concatenate([states for part in found for states in part[1]])
            _judge(report, name, models, data, starts, scores, ends, path)
            report.figure(
                f"{name}.seconds", sum(part[2] for part in found) / len(found), "median duration"
            )
    _back_inside(report, problem_with(models, models.svr), models, outside)


def _judge(
    report: Report,
    name: str,
    models: ForearmModels,
    data: DataSet,
    starts: Array,
    scores: NDArray[np.int64],
    ends: Array,
    path: Array,
) -> None:
    truth = true_cost(_near_length(ends))
    error = np.abs(np.linalg.norm(path[:, 3:] - path[:, :3], axis=1) - forearm_length())
    report.figure(f"{name}.share_at_1", (truth == 1).mean())
    report.figure(f"{name}.worse_than_start", ((truth > scores) | (truth == 0)).mean())
    report.figure(f"{name}.unreachable", (truth == 0).mean())
    report.figure(f"{name}.nearest_at_1", (nearest_sample_cost(ends, data) == 1).mean())
    report.figure(f"{name}.max_length_error", error.max(), "m")
    report.figure(f"{name}.min_margin", models.boundary.margin(path).min())


def _near_length(points: Array) -> Array:
    """Remove rounding of the length from points.

    A wrong length stays wrong, and out of reach.
    """
    right = np.abs(np.linalg.norm(points[:, 3:] - points[:, :3], axis=1) - forearm_length()) < 1e-9
    points = points.copy()
    points[right] = ArmLength(forearm_length()).project(points[right])
    return points


def _outside(models: ForearmModels, count: int) -> Array:
    rng, limit = np.random.default_rng(5), ArmLength(forearm_length())
    data = forearm_data(1000, seed=1).points
    around = limit.project(
        data[rng.permutation(len(data))[:2000]] + rng.uniform(-0.1, 0.1, (2000, 6))
    )
    return around[models.boundary.margin(around) < -0.01][:count]


def _back_inside(report: Report, problem: Problem, models: ForearmModels, starts: Array) -> None:
    _, paths, _ = constrained(problem, starts)
    times, least = [], np.inf
    for states in paths:
        margin = models.boundary.margin(states)
        first = int(np.argmax(margin >= 0)) if (margin >= 0).any() else None
        times.append(np.inf if first is None else first * problem.dt)
        if first is not None:
            least = min(least, float(margin[first:].min()))
    report.figure("outside", len(starts), "starts outside the boundary")
    report.figure("back_inside_s", max(times), "longest, s")
    report.figure("outside_min_margin", least, "after it was inside")


if __name__ == "__main__":
    run(measure, "Where a led forearm ends, judged by truth.")
