"""QP solvers on the QPs of real control steps. ``python -m benchmarks.solvers``.

The QPs are recorded from closed loops of all problems, every QP of every step
(`ergoqp.comparison.record`): twist QPs with six unknowns, and larger ones with a slack variable per
row where rows must give way. From the twist QPs near singular, nearly infeasible and infeasible
ones are made (`ergoqp.comparison.derive`). Every solver stays in memory from one QP to the next
where it can (quadprog, piqp and clarabel are called through qpsolvers, which sets them up anew), is
set to 1e-6, gets everything cold, and, if it can start warm, the recorded sequences warm too. Times
are of the call from Python, new data included, in one process, the lesser of two passes. What it
says is judged apart (`ergoqp.solvers.session`): primal residual, dual residual, gap and signs of
multipliers, absolute, in the infinity norm. ``--quick`` takes fewer steps, and shorter stretches of
them.

Per solver S, of those that are installed:

- ``S.success_1e-3``, ``S.success_1e-6``: share of the QPs with an answer that it solved to that,
  and said so.
- ``S.success_1e-9``: the same when it is set to 1e-9, cold, on a stretch of every sequence.
- ``S.wrong_flags``: how often what it said was not so: solved and not within 1e-6, infeasible and
  it is not, solved and it is infeasible. ``S.infeasible_named``: share of the infeasible QPs that
  it called so, and did not just give up.
- ``S.sgm_us``: shifted geometric mean of the cold times, a QP that was not solved counting 10 ms at
  least; ``S.sgm_time``: that over the best solver's. ``S.p50_us``, ``S.p99_us``, ``S.max_us``: the
  times as they were.
- ``S.farthest``: largest distance in any entry from the certified answer (DAQP's, every residual
  within 1e-9 by the judge), of the recorded QPs that it solved.
- ``S.warm_ratio``, ``S.warm_iterations_ratio``: warm over cold along the trajectories, of time and
  of the mean iterations; only for solvers that can start warm.

Of the control step itself:

- ``accepted``, ``accepted_above_1e-6``: answers that the step went on with in the loops, and those
  of them with a residual above 1e-6 by the judge, dual ones relative to 1 + max |g| as the step has
  it; ``accepted_worst``: the largest.
- ``derived_accepted_above_1e-6``: the same of the step's QP on the near singular and nearly
  infeasible ones; ``derived_refused``: those out of ``derived`` that it did not accept (the step
  brakes then).
- ``infeasible_accepted``: of ``infeasible`` QPs, those that the step's QP accepts.
- ``contradictory_steps``: steps of problems whose limits contradict each other.
  ``contradictory_unreported``: those of them that do not say so; ``contradictory_braking``: those
  that brake and say that no other twist keeps every limit. The rest name the limit that is broken.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

from benchmarks.report import Report, run
from ergoqp.comparison.compare import SolverTrial, figures_of, relatives, try_solver
from ergoqp.comparison.record import RecordedQps, record
from ergoqp.limits import WorkspaceBox
from ergoqp.problem.load import TASKS, load_problem
from ergoqp.problem.problem import Problem
from ergoqp.responses.ik import IkResponse
from ergoqp.solvers import SOLVERS, installed_solvers, solver_named
from ergoqp.solvers.session import Array, Qp, QpAnswer, QpSequence, judge
from ergoqp.solvers.solver import FREE
from ergoqp.step.qp import TOLERANCE, build_qp
from ergoqp.step.stepper import Stepper

PROBLEMS = (*TASKS, "screwing_learned", "forearm")
ACCURACY = 1e-6
HIGH = 1e-9
PASSES = 2

_SHOWN = (
    "success_1e-3",
    "success_1e-6",
    "wrong_flags",
    "infeasible_named",
    "farthest",
    "sgm_us",
    "p50_us",
    "p99_us",
    "max_us",
)


@dataclass(frozen=True)
class SecondBox(WorkspaceBox):
    """Another box for the contact point, under names of its own."""

    names = tuple(f"second workspace {axis}" for axis in "xyz")


@cache
def step_qp(m: int) -> ca.Function:
    """Return the step's own QP for `m` rows."""
    return build_qp(solver_named("daqp"), m)


def step_answer(qp: Qp) -> tuple[QpAnswer, bool]:
    """Return what the step's QP makes of a twist QP without slack, and whether it accepts it."""
    m = qp.size[1]
    lower, upper = np.maximum(qp.lbA, -FREE), np.minimum(qp.ubA, FREE)
    parts = step_qp(m)(qp.H, qp.g, qp.A, lower, upper, np.ones(m), np.zeros(m), qp.lb, qp.ub)
    x, _, rows, residual = (np.array(part).ravel() for part in parts)
    # The multipliers of the bounds are what is left for them; the judge then looks at their signs
    # and at the gap.
    box = -(qp.H @ x + qp.g + qp.A.T @ rows)
    return QpAnswer(x, rows, box, "solved"), bool(residual[0] < TOLERANCE)


def contradictory(problem: Problem) -> Problem:
    """Return the problem with a second workspace above the first.

    The object is outside one of them wherever it is.
    """
    box = problem.limit_of(WorkspaceBox)
    lower, upper = np.asarray(box.lower), np.asarray(box.upper)
    aside = np.array([0.0, 0.0, upper[2] - lower[2] + 0.05])
    return problem.replace(
        limits=[*problem.limits, SecondBox(tuple(lower + aside), tuple(upper + aside))]
    )


def contradicted_steps(problem: Problem, steps: int) -> tuple[int, int]:
    """Return how many steps of a contradictory problem do not report it.

    Also return how many brake with the reason for it.
    """
    response = problem.response
    assert isinstance(response, IkResponse)
    stepper, rng = Stepper(contradictory(problem)), np.random.default_rng(0)
    unreported = braking = 0
    for _ in range(steps):
        step = stepper.step(
            response.comfort + np.radians(4) * rng.normal(size=len(problem.coordinates))
        )
        named = step.status in ("recovering", "relaxed") and "workspace" in step.reason
        brakes = step.status == "braking" and "keeps every limit" in step.reason
        unreported += not (named or brakes)
        braking += brakes
    return unreported, braking


def measure(report: Report) -> None:
    """Record, derive, try every solver, and judge the step."""
    steps, derive, stretch, slack = report.pick((150, 5, 45, 12), (1000, 20, 200, 30))
    recordings: list[RecordedQps] = []
    for name in PROBLEMS:
        recordings += record(load_problem(name), steps)
    plain = [
        one.sequence.thinned(slack if one.sequence.name.endswith(".relaxed") else stretch)
        for one in recordings
    ]
    made = [one for recording in recordings for one in relatives(recording, derive, seed=0)]
    sequences = [*plain, *made]
    report.say(
        f"{len(PROBLEMS)} problems x {steps} steps: {sum(len(one.sequence) for one in recordings)}"
        " QPs recorded"
    )
    report.figure("recorded", sum(map(len, plain)), f"of them tried, in {len(plain)} sequences")
    _step_itself(report, recordings, made)
    _contradictions(report, report.pick(40, 400))
    _solvers(report, sequences, report.pick(4, 20))


def _step_itself(
    report: Report, recordings: Sequence[RecordedQps], made: Sequence[QpSequence]
) -> None:
    worst = [
        judge(qp, answer).relative(qp)
        for one in recordings
        for qp, answer, accepted in zip(one.sequence, one.answers, one.accepted, strict=True)
        if accepted
    ]
    report.figure("accepted", len(worst), "answers that the steps went on with")
    report.figure("accepted_above_1e-6", int(np.sum(~(np.array(worst) <= 1e-6))))
    report.figure("accepted_worst", max(worst))
    above = refused = derived = passed = infeasible = 0
    for sequence in made:
        for qp in sequence:
            answer, accepted = step_answer(qp)
            if sequence.feasible:
                derived += 1
                refused += not accepted
                above += accepted and not judge(qp, answer).relative(qp) <= 1e-6
            else:
                infeasible += 1
                passed += accepted
    report.figure(
        "derived", derived, "near singular and nearly infeasible QPs given to the step's QP"
    )
    report.figure("derived_accepted_above_1e-6", above)
    report.figure("derived_refused", refused)
    report.figure("infeasible", infeasible, "infeasible QPs given to the step's QP")
    report.figure("infeasible_accepted", passed)


def _contradictions(report: Report, steps: int) -> None:
    report.figure(
        "contradictory_steps",
        steps * len(TASKS),
        "steps of problems whose limits contradict each other",
    )
    counts = np.sum([contradicted_steps(load_problem(name), steps) for name in TASKS], axis=0)
    report.figure("contradictory_unreported", counts[0])
    report.figure("contradictory_braking", counts[1], "say that no other twist keeps every limit")


def _solvers(report: Report, sequences: Sequence[QpSequence], stretch: int) -> None:
    found: dict[str, dict[str, float]] = {}
    certified: dict[str, Array] = {}
    for name in installed_solvers():
        trials = _trials(name, sequences)
        high = [
            try_solver(name, one.thinned(stretch), False, HIGH) for one in sequences if one.feasible
        ]
        if name == "daqp":
            certified = {
                one.sequence.name: np.where(one.success(HIGH)[:, None], one.points, np.nan)
                for one in trials
            }
        found[name] = figures_of(trials, ACCURACY) | {
            "high": figures_of(high, HIGH)["success_1e-9"]
        }
        found[name]["farthest"] = max(
            _distance(one, certified) for one in trials if one.sequence.family == "recorded"
        )
        report.say(f"{name}: {found[name]['qps']:.0f} QPs, {solver_named(name).method}")
    best = min(one["sgm_us"] for one in found.values())
    for name, one in found.items():
        for figure in _SHOWN:
            report.figure(f"{name}.{figure}", one[figure])
        report.figure(f"{name}.success_1e-9", one["high"], "set to 1e-9")
        report.figure(f"{name}.sgm_time", one["sgm_us"] / best, "best = 1")
        for figure in ("warm_us", "warm_ratio", "warm_iterations_ratio"):
            if figure in one:
                report.figure(f"{name}.{figure}", one[figure])
    for name in SOLVERS:
        if name not in found:
            report.say(f"{name} (extra 'solvers') is absent")


def _distance(trial: SolverTrial, certified: Mapping[str, Array]) -> float:
    apart = np.abs(trial.points - certified[trial.sequence.name]).max(axis=1)
    return float(np.max(apart[trial.success(ACCURACY) & np.isfinite(apart)], initial=0.0))


def _trials(name: str, sequences: Sequence[QpSequence]) -> list[SolverTrial]:
    trials = []
    for one in sequences:
        trials.append(try_solver(name, one, False, ACCURACY, PASSES))
        if one.follows and solver_named(name).warm:
            trials.append(try_solver(name, one, True, ACCURACY, PASSES))
    return trials


if __name__ == "__main__":
    run(measure, "QP solvers on the QPs of real control steps.")
