"""Closed loops of problems whose state the robot itself moves, such as ``forearm``.

There is no person, no delay and no noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ergoqp.arguments import check_kind, check_number, read_array
from ergoqp.errors import InputError
from ergoqp.problem.problem import Problem
from ergoqp.responses import LinearResponse
from ergoqp.simulation.check import Checker
from ergoqp.simulation.loop import LONGEST
from ergoqp.step.stepper import Stepper


@dataclass(frozen=True, eq=False)
class PointsRun:
    """Result of one loop.

    Attributes:
        dt: period [s].
        states: state before each step and after the last one (n + 1, N).
        twists: sent twists (n, 6).
        statuses: status of each step (n,).
        cost: V before each step (n,) [points].
        violations: number of steps that broke a limit, per limit, by the independent checker.
        max_violation: largest violation of each limit.
    """

    dt: float
    states: NDArray[np.float64]
    twists: NDArray[np.float64]
    statuses: tuple[str, ...]
    cost: NDArray[np.float64]
    violations: dict[str, int]
    max_violation: dict[str, float]


def run_points(
    problem: Problem,
    start: ArrayLike,
    duration: float = 20.0,
    *,
    stepper: Stepper | None = None,
    stop_when_still: float | None = 0.5,
) -> PointsRun:
    """Run the loop from a state. The sent twists are executed exactly.

    Args:
        problem: its response must be a `LinearResponse`.
        start: state at time 0 (N,).
        duration: longest time [s].
        stepper: a stepper of this problem, which is reset; None: a new one.
        stop_when_still: end early after a rest of this length [s]; None: never.

    Raises:
        InputError: if the response is of another type, or the start has a wrong size.
    """
    check_kind("problem", problem, Problem, "a Problem, such as ergoqp.load_problem gives")
    if not isinstance(problem.response, LinearResponse):
        raise InputError(
            f"problem {problem.name}: got a {type(problem.response).__name__}, allowed"
            " LinearResponse"
        )
    n = len(problem.coordinates)
    state = read_array("start", start, (n,), f"{n} finite numbers")
    check_number("duration", duration, problem.dt, LONGEST, "s")
    if stop_when_still is not None:
        check_number("stop_when_still", stop_when_still, 0.0, LONGEST, "s")
    stepper = stepper or Stepper(problem, compiled=False)
    stepper.reset()
    checker, matrix, dt = Checker(problem), np.asarray(problem.response.matrix), stepper.dt
    states, twists, statuses, cost = [state], [], [], []
    previous, still = np.zeros(6), 0.0
    for _ in range(round(duration / dt)):
        step = stepper.step(state)
        checker.check(
            step.twist, previous, np.eye(4), state, step.posture_rate, dt, gave_way=step.slack
        )
        state, previous = state + matrix @ step.twist * dt, step.twist
        states.append(state)
        twists.append(step.twist)
        statuses.append(step.status)
        cost.append(step.cost)
        still = still + dt if step.status == "settled" and not step.twist.any() else 0.0
        if stop_when_still is not None and still >= stop_when_still:
            break
    found = (dict(checker.violations), dict(checker.max_violation))
    return PointsRun(
        dt, np.array(states), np.array(twists), tuple(statuses), np.array(cost), *found
    )
