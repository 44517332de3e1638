"""How long a joint outside a range that the user narrowed asks to come back.

It asks for at most twice the time that the return should take.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from ergoqp.expressions.linear import largest
from ergoqp.limits import Limit
from ergoqp.step.program.bounds import STEADY_RETURN, limit_values


def still_asks(asked: ca.MX) -> ca.MX:
    """Return 1 while rows of the posture may ask to come back.

    The state `asked` (2,) holds the seconds asked for so far and the seconds allowed.
    """
    return asked[0] <= asked[1]


def asked_update(limits: Sequence[Limit], asked: ca.MX, margins: ca.MX, dt: ca.MX) -> ca.MX:
    """Return the next state of asking (2,).

    A row that was given up may ask again once no row is outside.

    The predicted time follows from the speed at which rows come back, see
    `ergoqp.step.program.bounds`.

    Args:
        limits: limits that have rows.
        asked: seconds for which a row asked to come back, and twice the seconds that it should take
            [s].
        margins: present margins of all rows (r,).
        dt: period [s].
    """
    soft = limit_values(limits, "returns") * (1 - limit_values(limits, "hard"))
    time, tolerance = (
        ca.DM(limit_values(limits, "recovery_time")),
        ca.DM(limit_values(limits, "tolerance")),
    )
    away = ca.if_else(margins < -tolerance, -margins, 0) * ca.DM(soft)
    steady = STEADY_RETURN * time
    fading = time * (ca.log(ca.fmax(away / steady, 1)) + 1)
    longest = largest(ca.if_else(away > steady, fading, away / STEADY_RETURN))
    waiting = ca.vertcat(asked[0] + dt, ca.fmax(asked[1], 2 * longest))
    return ca.if_else(longest > 0, waiting, ca.MX(ca.DM.zeros(2)))
