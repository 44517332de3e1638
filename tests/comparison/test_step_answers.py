"""What the control step accepts: no infeasible QP, nothing above its tolerance; contradictory
limits are named."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np
import pytest
from step_samples import comfort_of, problem_of

from ergoqp.comparison.compare import relatives
from ergoqp.comparison.record import RecordedQps, record
from ergoqp.limits import WorkspaceBox
from ergoqp.solvers import SOLVERS, solver_named
from ergoqp.solvers.session import QpAnswer, judge
from ergoqp.solvers.solver import FREE
from ergoqp.step.qp import TOLERANCE, build_qp
from ergoqp.step.stepper import Stepper


@cache
def recorded() -> tuple[RecordedQps, ...]:
    return tuple(record(problem_of("overhead"), 40))


@cache
def step_qp(solver: str, m: int) -> ca.Function:
    return build_qp(solver_named(solver), m)


@pytest.mark.parametrize("solver", SOLVERS)
def test_what_is_accepted_is_solved_and_what_is_infeasible_is_not_accepted(solver: str) -> None:
    counts = {True: 0, False: 0}
    for part in recorded():
        for sequence in (part.sequence.thinned(10), *relatives(part, 8, seed=1)):
            for qp in sequence:
                m = qp.size[1]
                ends = np.maximum(qp.lbA, -FREE), np.minimum(qp.ubA, FREE)
                parts = step_qp(solver, m)(
                    qp.H, qp.g, qp.A, *ends, np.ones(m), np.zeros(m), qp.lb, qp.ub
                )
                x, _, rows, residual = (np.array(one).ravel() for one in parts)
                accepted = residual[0] < TOLERANCE
                if not sequence.feasible:
                    assert not accepted
                    continue
                counts[accepted] += 1
                if accepted:
                    box = -(qp.H @ x + qp.g + qp.A.T @ rows)
                    assert judge(qp, QpAnswer(x, rows, box, "solved")).relative(qp) <= 2 * TOLERANCE
    # Not every solver is one for rows that nearly repeat or contradict each other.
    assert counts[True] > 0.6 * sum(counts.values())


@dataclass(frozen=True)
class OtherBox(WorkspaceBox):
    names = tuple(f"other workspace {axis}" for axis in "xyz")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["dentist", "desk", "low_bin", "overhead", "screwing"])
def test_limits_that_contradict_each_other_are_named_and_nothing_runs_away(name: str) -> None:
    problem = problem_of(name)
    box = problem.limit_of(WorkspaceBox)
    up = np.array([0.0, 0.0, box.upper[2] - box.lower[2] + 0.05])
    other = OtherBox(tuple(box.lower + up), tuple(box.upper + up))
    stepper = Stepper(problem.replace(limits=[*problem.limits, other]))
    posture, previous = comfort_of(name), np.zeros(6)
    for _ in range(150):
        step = stepper.step(posture)
        assert step.status in ("recovering", "relaxed", "braking")
        assert "workspace" in step.reason
        assert np.all(np.abs(step.twist) <= problem.twist_limit.speed + 1e-9)
        assert np.all(
            np.abs(step.twist - previous) <= problem.twist_limit.acceleration * problem.dt + 1e-9
        )
        previous = step.twist
