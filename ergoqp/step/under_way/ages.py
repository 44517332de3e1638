"""Weights of the moving average, and of what a late robot has still to do.

They follow from the ages of the periods alone.
"""

from __future__ import annotations

from typing import Final

import casadi as ca

from ergoqp.expressions.linear import dense
from ergoqp.step.model import StepModel
from ergoqp.step.under_way.history import LONGEST_DT, SHORTEST_DT, remaining_seconds

_AT_ALL: Final = 1e-9
"""Durations below this count as zero [s]."""


def weights_function(model: StepModel) -> ca.Function:
    """Return the weights that follow from the ages alone, in scalars.

    Returns:
        Function ``(ages, idle, dt) -> (own, of_plan, present, remaining, period, dt_ok, aged,
        idled, fits, parked)``. `of_plan` (n, 2) holds the weights at the end of this period, and
        seconds. `present` (n,) holds the weights now. `remaining` (k,) holds the seconds for which
        each sent twist still acts. `aged` holds the ages at the end of this period.
    """
    problem, history = model.problem, model.history
    W, robot = problem.average, problem.robot
    ages, idle, given = ca.SX.sym("ages", history.ages), ca.SX.sym("idle"), ca.SX.sym("dt")
    dt_ok = ca.logic_and(given >= SHORTEST_DT, given <= LONGEST_DT)
    dt = ca.if_else(dt_ok, given, problem.dt)
    ends, n = ca.vertcat(0, ages), history.planned
    # Without averaging there are no weights, and without delay or lag no remaining seconds.
    own, of_plan, now, remaining = ca.SX(1), ca.SX(), ca.SX(), ca.SX()
    if W:
        own, weights, now, left = _mean(ends[:n], dt, W)
        of_plan = ca.horzcat(weights, left)
    if robot.owes:
        remaining = remaining_seconds(
            ends[: history.sent], ends[1 : history.sent + 1], robot.dead_time, robot.lag
        )
    parked = idle >= max(W, robot.dead_time, _AT_ALL)
    outputs = [own, of_plan, now, remaining, dt, dt_ok, (ages + dt)[: history.ages - 1], idle + dt]
    outputs += [_holds_all(model, ages, dt), parked]
    names = ["own", "of_plan", "present", "remaining", "period", "dt_ok", "aged", "idled"]
    names += ["fits", "parked"]
    inputs = ["ages", "idle", "dt"]
    return ca.Function("weights", [ages, idle, given], ca.cse(dense(outputs)), inputs, names)


def _mean(ages: ca.SX, dt: ca.SX, W: float) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """Return the mean of the plan over W seconds as weights of its twists.

    Returns:
        At the end of this period: the weight of the new twist, and those of the earlier ones (n,).
        Now: their weights (n,), and the seconds for which each of them still acts because it is not
        sent yet (n,), including the half of this period in which the plan leaves the last one.
    """
    n = ages.numel()
    length, share = _segments(ages + dt, W)
    far = length * share / 2
    # The oldest twist counts as having lasted for ever: before the first step the plan was at rest.
    rest = W - ca.fmin(ages[n - 1] + dt, W)
    first = ca.fmin(dt, W)
    own = first * (2 - first / dt) / (2 * W)
    before = ca.vertcat(first * (first / dt) / 2, ca.SX(n - 1, 1))
    weights = (before + ca.vertcat(length - far, rest) + ca.vertcat(0, far)) / W

    length, share = _segments(ages, W)
    far, before = length * share / 2, W - ca.fmin(ages[n - 1], W)
    present = (ca.vertcat(length - far, before) + ca.vertcat(0, far)) / W
    left = 1 - ca.fmin(ages, W) / W
    now, then, sixth = left[:-1], left[1:], length / 6
    later = sixth * share * (now + 2 * then)
    sooner = 3 * sixth * (now + then) - later
    oldest = before**2 / (2 * W)
    ahead = ca.vertcat(dt / 2, ca.SX(n - 1, 1)) + ca.vertcat(sooner, oldest) + ca.vertcat(0, later)
    return own, weights, present, ahead


def _segments(ages: ca.SX, W: float) -> tuple[ca.SX, ca.SX]:
    """Return the part of each segment between two ages below W [s], and its share."""
    ends = ca.fmin(ages, W)
    length = ends[1:] - ends[:-1]
    # Segments before the first step have zero length.
    return length, length / ca.fmax(ages[1:] - ages[:-1], _AT_ALL)


def _holds_all(model: StepModel, ages: ca.SX, dt: ca.SX) -> ca.SX:
    history, problem = model.history, model.problem
    needed = [(history.planned - 3, problem.average), (history.sent - 2, problem.robot.dead_time)]
    # A mean over a history that was too short a period ago has its jerk in this period.
    found = ages[history.planned - 2] >= problem.average if problem.average else ca.SX(1)
    for last, seconds in needed:
        if seconds:
            found = ca.logic_and(found, ages[last] + dt >= seconds)
    return found
