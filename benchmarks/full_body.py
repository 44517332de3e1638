"""Learned costs in whole closed loops, beside the sheet's own smooth reading.

Run ``python -m benchmarks.full_body``.

Every cost runs the problem ``screwing`` from the same starts, with the same people
(`benchmarks.closed_loop` says how they are drawn). The learned costs read the 22 joints that the
sheet reads, are fitted to balanced sheet-labelled postures, and run with the one-class boundary of
the same postures as a limit. ``--quick`` fits them to fewer postures.

- ``<cost>.mean_after``: mean exact score of the rest posture where the object came to rest.
- ``<cost>.share_at_best``: share that reaches the lowest score found anywhere by brute force.
- ``<cost>.worse_than_start``, ``<cost>.violations``: as in `benchmarks.closed_loop`.
  ``<cost>.boundary_outside``: share of the steps at which the person's own posture was outside the
  boundary.
- ``<cost>.step_us``: median time of a step.
- ``upright``: the control, a cost that knows no sheet: the squared distance from standing with
  hanging arms. ``mean_still``: of the rest postures had the object stayed. A learned cost that ends
  no lower than these shows nothing of what it learned.
- ``svr_default`` is scikit-learn's machine with its own settings, of standardised angles; ``svr``
  is `ergoqp.costs.svr.Svr`.
- ``mean_start``, ``mean_best``, ``runs``: of all.
"""

from __future__ import annotations

import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import cache

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmarks.loops import ABOVE, DURATION, STILL, draw_starts, end_score
from benchmarks.report import Report, run
from ergoqp.coordinates import SCORED_JOINTS
from ergoqp.costs.cost import LearnedCost
from ergoqp.costs.load import load_cost
from ergoqp.datasets.postures import posture_data
from ergoqp.learning.one_class import OneClass
from ergoqp.limits import OneClassBoundary
from ergoqp.problem.load import load_problem
from ergoqp.problem.problem import Problem
from ergoqp.registry import data_folder
from ergoqp.rest.best_place import workspace_map
from ergoqp.rest.model_person import sample_person
from ergoqp.simulation.check import Checker
from ergoqp.simulation.loop import run_loop
from ergoqp.step.stepper import Stepper

PROBLEM = "screwing"
COSTS = (
    "smooth_reba",
    "upright",
    "quadratic",
    "gmr",
    "svr_default",
    "svr",
    "one_class_ladder",
    "neural",
)


class Upright:
    """The squared distance from the posture of zero angles, one point per radian squared."""

    name, minimum = "upright", 0.0

    def expression(self, q: ca.MX) -> ca.MX:
        """Return V(q)."""
        return ca.sumsqr(q)

    def __call__(self, postures: ArrayLike) -> NDArray[np.float64]:
        """Return V of each posture."""
        return np.square(np.atleast_2d(postures)).sum(axis=1)


@dataclass
class Found:
    """Numbers of the loops of one cost, one entry per loop."""

    start: list[int] = field(default_factory=list)
    best: list[int] = field(default_factory=list)
    end: list[int] = field(default_factory=list)
    still: list[int] = field(default_factory=list)
    violations: list[int] = field(default_factory=list)
    outside: list[float] = field(default_factory=list)
    step_us: list[float] = field(default_factory=list)

    def add(self, other: Found) -> None:
        """Append another's entries."""
        for name, value in vars(other).items():
            setattr(self, name, getattr(self, name) + value)


@cache
def boundary(per_score: int) -> OneClass:
    """Fit the boundary of the postures that the learned costs are fitted to."""
    data = posture_data(per_score, joints=SCORED_JOINTS)
    return OneClass.fit(data.points, data.coordinates, nu=0.02)


def problem_with(cost: str, per_score: int) -> Problem:
    """Return the problem with a cost, and with the boundary where the cost is learned."""
    problem = load_problem(PROBLEM)
    if cost == "smooth_reba":
        return problem
    if cost == "upright":
        return problem.replace(cost=Upright())
    limits = [
        *problem.limits,
        OneClassBoundary(boundary(per_score), tolerance=0.05, recovery_time=1.0),
    ]
    return problem.replace(cost=_fitted(cost, per_score), limits=limits)


def _fitted(cost: str, per_score: int) -> LearnedCost:
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler
    from sklearn.svm import SVR

    from ergoqp.costs.from_sklearn import from_sklearn
    from ergoqp.costs.gmr import Gmr
    from ergoqp.costs.one_class_ladder import OneClassLadder
    from ergoqp.costs.quadratic import Quadratic
    from ergoqp.costs.svr import Svr

    if cost == "neural":
        return load_cost(data_folder("models") / "neural_sheet.npz")
    data = posture_data(per_score, joints=SCORED_JOINTS)
    if cost == "svr_default":
        return from_sklearn(
            make_pipeline(StandardScaler(), SVR()).fit(data.points, data.labels), data.coordinates
        )
    kinds = {"quadratic": Quadratic, "gmr": Gmr, "svr": Svr, "one_class_ladder": OneClassLadder}
    return kinds[cost].fit(data)


def loops(cost: str, per_score: int, people: int, starts: int) -> tuple[str, Found]:
    """Run all loops of one cost."""
    problem = problem_with(cost, per_score)
    plain = load_problem(PROBLEM)
    stepper, found = Stepper(problem), Found()
    for seed in range(people):
        person = sample_person(plain, seed)
        best = workspace_map(plain, person).best
        for number, start in enumerate(draw_starts(plain, person, starts, seed, best + ABOVE)):
            checker = Checker(problem)
            trace = run_loop(
                problem,
                person.holding(start),
                duration=DURATION,
                seed=1000 * seed + number,
                controller=stepper,
                checker=checker,
                stop_when_still=STILL,
            )
            postures = np.array(trace.postures)
            found.start.append(int(plain.assess(start.posture).final[0]))
            found.best.append(best)
            found.end.append(end_score(plain, person, start, postures[-1], trace.poses[-1]))
            found.still.append(end_score(plain, person, start, start.posture, start.pose))
            found.violations.append(sum(checker.violations.values()))
            limit = problem.limit_of(OneClassBoundary)
            outside = 0.0
            if limit is not None:
                outside = float(
                    (limit.model.margin(limit.model.coordinates.read(postures)) < 0).mean()
                )
            found.outside.append(outside)
            found.step_us.append(float(np.median(trace.step_time)) * 1e6)
    return cost, found


def measure(report: Report) -> None:
    """Run every cost, two at a time."""
    per_score, people, starts = report.pick((150, 1, 2), (1000, 3, 8))
    jobs = [(cost, per_score, people, starts) for cost in COSTS]
    every: dict[str, Found] = {}
    with ProcessPoolExecutor(min(2, os.cpu_count() or 1)) as pool:
        for cost, found in pool.map(loops, *zip(*jobs, strict=True)):
            every[cost] = found
            report.say(f"{cost}: {len(found.end)} loops")
    first = every[COSTS[0]]
    report.figure("runs", len(first.end), "per cost")
    report.figure("mean_start", float(np.mean(first.start)))
    report.figure("mean_still", float(np.mean(first.still)))
    report.figure("mean_best", float(np.mean(first.best)))
    for cost, found in every.items():
        end, best, start = np.array(found.end), np.array(found.best), np.array(found.start)
        report.figure(f"{cost}.mean_after", end.mean())
        report.figure(f"{cost}.share_at_best", (end <= best).mean())
        report.figure(f"{cost}.worse_than_start", (end > start).mean())
        report.figure(f"{cost}.violations", sum(found.violations))
        if cost not in ("smooth_reba", "upright"):
            report.figure(
                f"{cost}.boundary_outside", float(np.mean(found.outside)), "share of the steps"
            )
        report.figure(f"{cost}.step_us", float(np.median(found.step_us)), "median")


if __name__ == "__main__":
    run(measure, "Learned costs with the boundary in whole closed loops.")
