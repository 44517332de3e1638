"""Rest with hysteresis: the object stops when moving gains too little.

It stays at rest until the predicted gain is clearly large enough again.
"""

from __future__ import annotations

from typing import Any, Final

import casadi as ca

from ergoqp.expressions.linear import is_set
from ergoqp.problem.control import Control

STATES: Final = 6
"""Size of the state of rest.

Its entries are: at rest (0 or 1); seconds for which the gain has asked for a change; filtered gain;
filtered cost; lowest filtered cost since the object moves; seconds since that improved. All are
zero at the start; the filters start with the first frame.
"""

HUNTING: Final = 2.0
"""After this many times `Control.stall_after` the object rests even if not at its lowest cost."""


def stalled(rest: Any) -> Any:
    """Return for how long the object has moved without an improvement [s], 0 at rest.

    The argument is the state of rest, see `STATES`.
    """
    return rest[5] * (1 - is_set(rest[0]))


def rest_update(
    control: Control,
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
        control: thresholds and times.
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
