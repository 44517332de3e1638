"""The trial of a given place: when the step is drawn toward it, and what it turned out to be.

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

from ergoqp.expressions.linear import is_set
from ergoqp.problem.control import Control
from ergoqp.step.rest import stalled

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

FIRM: Final = -2e9
"""Promise of a place that somebody else judges: the object stays there, whatever it costs."""

_ARRIVED: Final = 0.05
"""Distance that counts as none, in seconds at full speed."""

_CLOSER: Final = 0.02
"""Progress that counts as one, in seconds at full speed."""

_STUCK: Final = 1.5
"""A journey without progress for this long is over [s]."""

_SETTLING: Final = 1.0
"""For how long the object rests at the place before its cost is looked at [s]."""

_SAME: Final = 0.1
"""Costs that differ by less are taken to be the same [points]."""


def place_of(pose: ca.SX) -> ca.SX:
    """Return position and tool axis (6,) of a pose (4, 4): all that a place is."""
    return ca.vertcat(pose[:3, 3], pose[:3, 0])


def is_journey(phase: ca.SX) -> ca.SX:
    """Return whether the object travels, there or back, in a phase."""
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

    travels = is_journey(phase)
    closer = ca.logic_and(travels, distance < closest - _CLOSER)
    waited = ca.if_else(closer, 0, waited + dt)
    arrives = ca.logic_and(travels, ca.logic_or(distance < _ARRIVED, waited > _STUCK))

    seen = ca.logic_and(phase == LOOK, waited > _SETTLING)
    kept = ca.logic_and(seen, cost <= expected)
    # Whoever gets that much worse on the way there may be unable to reach it.
    suffers = ca.logic_and(
        ca.logic_or(phase == THERE, phase == LOOK), cost > before + control.guide_price
    )
    judged = ca.logic_or(ca.logic_or(kept, suffers), ca.logic_and(phase == AFTER, ended))
    own = ca.logic_or(suffers, promise > (UNKNOWN + FIRM) / 2)
    returns = ca.logic_and(ca.logic_and(judged, own), cost > before + _SAME)

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
    moving = ca.logic_or(is_journey(after), ca.logic_and(seen, after == AFTER))
    afresh = ca.vertcat(still, 0, rest[2], rest[3], rest[3], 0)
    following = ca.if_else(on, ca.if_else(counts, following, trial), ca.SX(TRIAL, 1))
    takes_over = ca.logic_and(ca.logic_and(on, counts), ca.logic_or(still, moving))
    return following, ca.if_else(takes_over, afresh, rest)
