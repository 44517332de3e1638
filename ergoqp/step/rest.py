"""When the object rests: hysteresis on the predicted gain, and the trial of a guide.

Rest with hysteresis: the object stops when moving gains too little. It stays at rest until the
predicted gain is clearly large enough again.

The trial of a guide: when the object is drawn to it, and the cost that was found there.

The step first goes by descent, which finds only what lies downhill. Where descent comes to rest,
and the guide promises to be clearly better than here, the object travels there and rests until the
person rests. If the place is as good as promised, the trial ends. If not, descent continues from
there, because the place is the optimum of a model, and the person may differ from it. If that ends
worse than the place where the journey began, or if the way there costs the person too much, the
object goes back. The cost found at the place is stored, so that the place is not tried again in
vain.

The object does not go to the guide at once. This would be faster, but people who differ from the
model then end worse more often than after a descent first.

Travelling changes only the objective of the QP. Rows, certification and braking are those of every
step.
"""

from __future__ import annotations

from typing import Any, Final

import casadi as ca

from ergoqp.expressions import is_set

STATES: Final = 6
"""Size of the state of rest.

Its entries are: at rest (0 or 1); seconds for which the gain has asked for a change; filtered gain;
filtered cost; lowest filtered cost since the object moves; seconds since that improved. All are
zero at the start; the filters start with the first frame.
"""

HUNTING: Final = 2.0
"""After this many times `Control.stall_after` the object rests even if not at its lowest cost."""


HESITATES: Final = 0.25
"""Effort grows after this many times `Control.stall_after` without an improvement.

After the same time again it is doubled. Without this, an object that always moves at the same speed
would oscillate about a step of the cost, because the person follows late.
"""


def stalled(rest: Any) -> Any:
    """Return for how long the object has moved without an improvement [s], 0 at rest.

    The argument is the state of rest, see `STATES`.
    """
    return rest[5] * (1 - is_set(rest[0]))


def rest_update(
    control: Any,
    rest: ca.SX,
    gain: ca.SX,
    value: ca.SX,
    must_move: ca.SX,
    dt: ca.SX,
    counts: ca.SX,
) -> ca.SX:
    """Return the next rest state (6,).

    The object comes to rest when the predicted gain is small for some time, or when moving has not
    improved the cost for some seconds, because noisy angles always promise gains. It moves again
    when the gain is large for some time.

    Args:
        control: thresholds and times of `ergoqp.Control`, as numbers or symbols.
        rest: state of rest, see `STATES` (6,).
        gain: predicted improvement of this frame, within one second at full speed [points].
        value: cost of this frame [points].
        must_move: 1 if a limit asks to come back.
        dt: period [s].
        counts: 0 if this step has no gain; the state then stays.
    """
    still, timer = is_set(rest[0]), rest[1]
    begun = rest[3] > 0
    share = ca.if_else(begun, ca.fmin(1, dt / control.rest_filter), 1)
    filtered = rest[2] + share * (gain - rest[2])
    cost = rest[3] + share * (value - rest[3])
    better = ca.logic_or(ca.logic_not(begun), cost < rest[4] - control.stall_gain)
    lowest = ca.if_else(better, cost, rest[4])
    unimproved = ca.if_else(better, 0, rest[5] + dt)

    asks = ca.if_else(still, filtered > control.move_above, filtered < control.rest_below)
    asks = ca.if_else(must_move, still, asks)
    timer = ca.if_else(asks, timer + dt, 0)
    patience = ca.if_else(still, control.move_after, control.rest_after)
    near_lowest = cost <= lowest + control.stall_gain
    enough = ca.if_else(near_lowest, control.stall_after, HUNTING * control.stall_after)
    gives_up = ca.logic_and(ca.logic_not(ca.logic_or(still, must_move)), unimproved >= enough)
    changes = ca.logic_or(ca.logic_and(asks, timer >= patience - 1e-12), gives_up)
    state = ca.if_else(changes, ca.logic_not(still), still)
    # Each motion is judged separately.
    starts = ca.logic_and(changes, still)
    after = ca.vertcat(
        state,
        ca.if_else(changes, 0, timer),
        filtered,
        cost,
        ca.if_else(starts, cost, lowest),
        ca.if_else(starts, 0, unimproved),
    )
    return ca.if_else(counts, after, rest)


TRIAL: Final = 13
"""Size of the state of the trial.

Its entries are: phase; whether the place was tried; cost found there; cost where the journey began;
distance to go when it last clearly decreased [s]; seconds since then, or since the phase began;
filtered cost; position and tool axis where the journey began (6,). All are zero at the start.
"""

DESCENT, THERE, LOOK, AFTER, BACK = range(5)
"""Phases: descent, travel to the place, rest there, descent from there, travel back.

The rest there lasts until the person is at rest too.
"""

UNKNOWN: Final = -1e9
"""Promise of a place of which nothing is known: it is always tried."""

FIRM: Final = -2e9
"""Promise of a place that the caller judges: the object stays there, whatever the cost."""

_ARRIVED: Final = 0.05
"""Distance that counts as arrived, in seconds at full speed."""

_CLOSER: Final = 0.02
"""Smallest progress that counts, in seconds at full speed."""

_STUCK: Final = 1.5
"""A journey without progress for this long ends [s]."""

_SETTLING: Final = 1.0
"""Time at rest at the place before its cost is judged [s]."""

_SAME: Final = 0.1
"""Costs that differ by less count as equal [points]."""


def place_of(pose: ca.SX) -> ca.SX:
    """Return position and tool axis (6,) of a pose (4, 4), which define a place."""
    return ca.vertcat(pose[:3, 3], pose[:3, 0])


def is_journey(phase: ca.SX) -> ca.SX:
    """Return whether the object travels in a phase, there or back."""
    return ca.logic_or(phase == THERE, phase == BACK)


def trial_update(
    control: Any,
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
        control: thresholds and times of `ergoqp.Control`, as numbers or symbols.
        trial: state, see `TRIAL`.
        rest: next rest state of descent alone, see `ergoqp.step.rest.STATES`.
        pose: contact frame (4, 4).
        distance: distance to the present goal [s].
        on: 1 if there is a usable guide; without one the trial is reset.
        promise: cost at the place [points].
        points: cost of this frame [points].
        dt: period [s].
        counts: 0 if this step judges nothing; the state then stays.
    """
    phase, tried, worth, before, closest, waited, cost = (trial[i] for i in range(7))
    share = ca.if_else(cost > 0, ca.fmin(1, dt / control.rest_filter), 1)
    cost = cost + share * (points - cost)
    expected = ca.if_else(is_set(tried), worth, promise) + control.guide_gain
    # A limit that asks to come back prevents rest, but descent may be stuck there too.
    ended = ca.logic_or(is_set(rest[0]), stalled(rest) >= control.stall_after)
    leaves = ca.logic_and(ca.logic_and(phase == DESCENT, ended), cost > expected)

    travels = is_journey(phase)
    closer = ca.logic_and(travels, distance < closest - _CLOSER)
    waited = ca.if_else(closer, 0, waited + dt)
    arrives = ca.logic_and(travels, ca.logic_or(distance < _ARRIVED, waited > _STUCK))

    seen = ca.logic_and(phase == LOOK, waited > _SETTLING)
    kept = ca.logic_and(seen, cost <= expected)
    # A person who gets that much worse on the way may be unable to reach the place.
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
    # The object does not rest on a journey, and rests at its end. What follows is judged anew.
    still = ca.logic_or(after == LOOK, ca.logic_and(arrives, phase == BACK))
    moving = ca.logic_or(is_journey(after), ca.logic_and(seen, after == AFTER))
    afresh = ca.vertcat(still, 0, rest[2], rest[3], rest[3], 0)
    following = ca.if_else(on, ca.if_else(counts, following, trial), ca.SX(TRIAL, 1))
    takes_over = ca.logic_and(ca.logic_and(on, counts), ca.logic_or(still, moving))
    return following, ca.if_else(takes_over, afresh, rest)
