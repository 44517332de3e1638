"""Rest with hysteresis: the object stops when moving is not worth it, and stays stopped until it clearly is again."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca

if TYPE_CHECKING:
    from ergoqp.problem import Control


def rest_update(control: Control, rest: ca.SX, gain: ca.SX, must_move: ca.SX, dt: ca.SX, counts: ca.SX) -> ca.SX:
    """Return the next rest state.

    Args:
        control: thresholds and times.
        rest: (at rest 0 or 1, seconds for which the gain has asked for a change, the gain filtered) (3,).
        gain: predicted improvement of one second at full speed, as this frame has it [points].
        must_move: 1 when a limit asks to come back.
        dt: period [s].
        counts: 0 when this step has no gain to judge by; the state then stays.
    """
    still, timer = rest[0] > 0.5, rest[1]
    share = ca.fmin(1, dt / control.rest_filter)
    filtered = rest[2] + share * (gain - rest[2])
    asks = ca.if_else(still, filtered > control.move_above, filtered < control.rest_below)
    asks = ca.if_else(must_move, still, asks)
    timer = ca.if_else(asks, timer + dt, 0)
    patience = ca.if_else(still, control.move_after, control.rest_after)
    changes = timer >= patience - 1e-12
    state = ca.if_else(changes, ca.logic_not(still), still)
    return ca.if_else(counts, ca.vertcat(state, ca.if_else(changes, 0, timer), filtered), rest)
