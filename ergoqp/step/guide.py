"""The step drawn toward a given place.

It is drawn where descent alone came to rest, and the place promises to be clearly better.

Descent knows only what lies downhill. So the step goes by descent first; where that would come to
rest, and the given place is promised to be clearly better than here, the object travels there and
rests until the person does. If the place is worth what was promised, that is the end of it; if not,
descent takes over: the place is the optimum of a model, and the person is another. Where that ends
worse than where the journey began, or the way there costs the person too much, the object goes
back. What the place turned out to be worth is remembered, so that it is not tried again for
nothing.

It does not go there at once: that is quicker, but the place is the best one of a model, and people
who are not the model end worse more often than after a descent of their own.

Travelling changes the objective of the QP and nothing else, so that rows, certification and braking
are those of every step.
"""

from __future__ import annotations

from typing import Final

import casadi as ca
import numpy as np

from ergoqp.expressions.linear import is_set
from ergoqp.expressions.rigid import is_rigid, normalised
from ergoqp.problem.control import Control
from ergoqp.problem.problem import Problem
from ergoqp.step.rest import stalled

GUIDE_INPUTS: Final = ("guide", "guided", "promise")
"""The given place (4, 4), whether there is one (0 or 1), and the cost that it promises [points]."""

GUIDE_OUTPUTS: Final = ("drawn",)
"""Which phase drew this step's twist, 0 for none."""

TRIAL: Final = 13
"""Size of the trial's state.

Its entries are: phase; whether the place was tried; cost that it turned out to have; cost where the
journey began; distance to go when it last clearly shrank [s]; seconds since then, or since the
phase began; filtered cost; position and tool axis where the journey began (6,). All zero at the
start.
"""

DESCENT, THERE, LOOK, AFTER, BACK = range(5)
"""Phases: descent, travel to the place, rest there, descent from the place, travel back.

The rest there lasts until the person is at rest too.
"""

UNKNOWN: Final = -1e9
"""Promise of a place of which nothing is known: it is worth a trial."""

_APPROACH: Final = 0.3
"""Time constant of the last of the way [s]."""

_GENTLE: Final = 0.5
"""Share of the acceleration that the approach counts on."""

_ARRIVED: Final = 0.05
"""Distance that counts as none, in seconds at full speed."""

_CLOSER: Final = 0.02
"""Progress that counts as one, in seconds at full speed."""

_STUCK: Final = 1.5
"""A journey without progress for this long is over [s]."""

_SETTLING: Final = 1.0
"""For how long the object rests at the place before its cost is looked at [s]."""

_PRICE: Final = 1.5
"""How much worse than where it began a journey may make the person, for a while [points]."""

_SAME: Final = 0.1
"""Costs that differ by less are taken to be the same [points]."""


def guide_sizes() -> dict[str, tuple[int, int]]:
    """Return the shape of every input of `GUIDE_INPUTS`."""
    return {"guide": (4, 4), "guided": (1, 1), "promise": (1, 1)}


def pull_function(problem: Problem) -> ca.Function:
    """Return the function that gives what a guide adds to the objective.

    It is ``(pose, guide, guided, trial) -> (H (6, 6), g (6,), distance [s], on, drawn)``.

    On a journey 1/2 |xi - v|^2 in the norm of effort, times `Control.guide_weight`, where the
    velocity v leads to the place along a straight line: all axes arrive together, none is faster
    than its speed, and all slow down in time. Only position and the tool's axis are led; turning
    about the axis is nobody's business. H is positive semidefinite.

    `distance` is the time to the present goal at full speed, of the slowest axis; `on` is 1 if
    there is a place to be drawn to, and `drawn` the phase if it is a journey or the wait at its
    end, else 0.
    """
    control, limit = problem.control, problem.twist_limit
    pose, guide, guided = ca.SX.sym("pose", 4, 4), ca.SX.sym("guide", 4, 4), ca.SX.sym("guided")
    trial = ca.SX.sym("trial", TRIAL)
    on = ca.logic_and(is_set(guided), is_rigid(guide))
    # What cannot be used goes no further, or NaN would pass through a product with zero.
    goal = ca.if_else(on, place_of(normalised(guide)), place_of(pose))
    goal = ca.if_else(trial[0] == BACK, trial[7:], goal)
    free = (limit.speed > 0).astype(float)
    speed, gentle = ca.DM(np.where(free > 0, limit.speed, 1.0)), ca.DM(_GENTLE * limit.acceleration)
    way = ca.DM(free) * _way(pose, goal)
    far = ca.fabs(way)
    distance = ca.mmax(far / speed)
    slowing = ca.sqrt(ca.mmax(far / (2 * gentle)))
    velocity = way / ca.fmax(_APPROACH, ca.fmax(distance, slowing))
    axis = pose[:3, 0]
    turning = control.effort_angular * (ca.SX.eye(3) - axis @ axis.T)
    weight = control.guide_weight * ca.diagcat(control.effort_linear * ca.SX.eye(3), turning)
    travels = ca.logic_and(on, _travels(trial[0]))
    drawn = on * ca.logic_or(_travels(trial[0]), trial[0] == LOOK) * trial[0]
    outputs = [travels * weight, -(travels * (weight @ velocity)), distance, on, drawn]
    return ca.Function(
        "pull", [pose, guide, guided, trial], ca.cse([ca.densify(part) for part in outputs])
    )


def place_of(pose: ca.SX) -> ca.SX:
    """Return position and tool axis (6,) of a pose (4, 4): all that a place is."""
    return ca.vertcat(pose[:3, 3], pose[:3, 0])


def _way(pose: ca.SX, goal: ca.SX) -> ca.SX:
    """Displacement (6,) from a pose to a place: straight, the tool's axis turned the short way."""
    axis, wanted = pose[:3, 0], goal[3:]
    normal = ca.cross(axis, wanted)
    sine = ca.sqrt(ca.sumsqr(normal) + 1e-18)
    return ca.vertcat(goal[:3] - pose[:3, 3], normal / sine * ca.atan2(sine, ca.dot(axis, wanted)))


def _travels(phase: ca.SX) -> ca.SX:
    return ca.logic_or(phase == THERE, phase == BACK)


def trial_update(
    control: Control,
    trial: ca.SX,
    rest: ca.SX,
    pose: ca.SX,
    distance: ca.SX,
    on: ca.SX,
    promise: ca.SX,
    points: ca.SX,
    dt: ca.SX,
    counts: ca.SX,
) -> tuple[ca.SX, ca.SX]:
    """Return the next (trial (13,), rest (6,)).

    Args:
        control: thresholds and times.
        trial: state, see `TRIAL`.
        rest: next rest state as descent alone has it, see `ergoqp.step.rest.STATES`.
        pose: contact frame (4, 4).
        distance: to the present goal [s].
        on: 1 if there is a place to be drawn to; without one the trial is forgotten.
        promise: cost at the place [points].
        points: cost of this frame [points].
        dt: period [s].
        counts: 0 when this step judges nothing; the state then stays.
    """
    phase, tried, worth, before, closest, waited, cost = (trial[i] for i in range(7))
    share = ca.if_else(cost > 0, ca.fmin(1, dt / control.rest_filter), 1)
    cost = cost + share * (points - cost)
    expected = ca.if_else(is_set(tried), worth, promise) + control.guide_gain
    # A limit that asks to come back allows no rest, but descent may be stuck there all the same.
    ended = ca.logic_or(is_set(rest[0]), stalled(rest) >= control.stall_after)
    leaves = ca.logic_and(ca.logic_and(phase == DESCENT, ended), cost > expected)

    travels = _travels(phase)
    closer = ca.logic_and(travels, distance < closest - _CLOSER)
    waited = ca.if_else(closer, 0, waited + dt)
    arrives = ca.logic_and(travels, ca.logic_or(distance < _ARRIVED, waited > _STUCK))

    seen = ca.logic_and(phase == LOOK, waited > _SETTLING)
    kept = ca.logic_and(seen, cost <= expected)
    # Whoever gets that much worse on the way there may be unable to reach it.
    suffers = ca.logic_and(ca.logic_or(phase == THERE, phase == LOOK), cost > before + _PRICE)
    judged = ca.logic_or(ca.logic_or(kept, suffers), ca.logic_and(phase == AFTER, ended))
    returns = ca.logic_and(judged, cost > before + _SAME)

    after = ca.if_else(leaves, THERE, phase)
    after = ca.if_else(arrives, ca.if_else(phase == THERE, LOOK, DESCENT), after)
    after = ca.if_else(seen, AFTER, after)
    after = ca.if_else(judged, ca.if_else(returns, BACK, DESCENT), after)
    changes = after != phase
    following = ca.vertcat(
        after,
        ca.logic_or(tried, judged),
        ca.if_else(judged, cost, worth),
        ca.if_else(leaves, cost, before),
        ca.if_else(changes, 1e9, ca.if_else(closer, distance, closest)),
        ca.if_else(changes, 0, waited),
        cost,
        ca.if_else(leaves, place_of(pose), trial[7:]),
    )
    # On a journey there is no rest, at its end there is, and what comes after it is judged by
    # itself.
    still = ca.logic_or(after == LOOK, ca.logic_and(arrives, phase == BACK))
    moving = ca.logic_or(_travels(after), ca.logic_and(seen, after == AFTER))
    afresh = ca.vertcat(still, 0, rest[2], rest[3], rest[3], 0)
    following = ca.if_else(on, ca.if_else(counts, following, trial), ca.SX(TRIAL, 1))
    takes_over = ca.logic_and(ca.logic_and(on, counts), ca.logic_or(still, moving))
    return following, ca.if_else(takes_over, afresh, rest)
