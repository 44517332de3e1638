"""What each row asks of the twist of this period: from margins to bounds.

From margins to bounds: what each row asks of the twist of this period. The bounds keep the whole
stop after this period inside.

The object stops along a straight line, see `ergoqp.limits.twist_and_stopping`. With the distance d
left, a row holds through the stop if A xi <= d / h, with h = dt + t_s / 2 for the longest stop t_s
that this period can cause.

This alone brakes too late. While another axis keeps t_s long, d / h falls at the rate v / h, but
the row can be slowed only by a = sum |A_i| a_i. So v = d / h holds up to v = a h, and farther away
its tangent parabola v^2 = 2 a d - a^2 h^2. While a hard row is approached at v, no axis may speed
up so much that the stop takes longer than 2 (d / v - dt).

How long a joint outside a range that the user narrowed asks to come back. It asks for at most twice
the time that the return should take.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from ergoqp.expressions import largest
from ergoqp.limits import Limit, LimitContext, Rows, TwistLimit
from ergoqp.limits.limit import Expression
from ergoqp.limits.twist_and_stopping import Braking, Stop
from ergoqp.solvers.solver import FREE

STEADY_RETURN = 0.01
"""Slowest speed of coming back from outside [m/s, rad/s]."""

_ROOM = 1.5
"""A bent row may come back at most this many times as fast as it is asked to."""

MOVES = 1e-4
"""A row that all axes together move less than this has no inward target [per unit of the twist].

The solver would see nothing but rounding errors.
"""

CLEARANCE = 1e-8
"""Rows stop this far before their end, so that rounding of a solver is no violation [m, rad]."""

ELBOW = 1e-6
"""Part of every cap that no row needs, so that the feasible set has an interior.

It has one even where only braking is left.
"""


def driven(limit: TwistLimit, matrix: ca.SX) -> ca.SX:
    """Return a row matrix (m, 6) without the columns of axes that the object cannot move."""
    kept = ca.SX(*matrix.shape)
    columns = np.flatnonzero(limit.speed > 0).tolist()
    kept[:, columns] = matrix[:, columns]
    return ca.sparsify(kept)


def patience(
    limits: Sequence[Limit], context: LimitContext, previous: ca.SX, dt: ca.SX, stop: Stop
) -> ca.SX:
    """Return the longest stop [s] for which the hard rows ahead still have room.

    If it is negative, only braking is left.
    """
    longest = ca.SX(FREE)
    for limit in limits:
        if limit.hard:
            rows = limit.rows(context)
            pace = stop.stretch * (rows.matrix @ previous)
            for distance, toward in ((rows.to_upper, pace), (rows.to_lower, -pace)):
                left = ca.fmin(ca.fmax(distance - CLEARANCE, 0), FREE)
                # Motion along a limit does not approach it.
                time = 2 * (left / ca.fmax(toward, 1e-5) - stop.share * dt - stop.held)
                time = ca.if_else(toward > 1e-5, time, FREE)
                longest = ca.fmin(longest, ca.mmin(time))
    return longest


def unhurried(brake: Braking, longest: ca.SX) -> Braking:
    """Return the same braking with bounds from which no stop takes longer than `longest` [s].

    The bounds are those of the twist, see `patience`.
    """
    most = brake.acceleration * ca.fmax(longest, 0)
    high = ca.fmax(ca.fmin(brake.high, most), brake.twist)
    low = ca.fmin(ca.fmax(brake.low, -most), brake.twist)
    return replace(brake, low=low, high=high)


def no_further(twist: TwistLimit, limit: Limit, rows: Rows, brake: Braking) -> Rows:
    """Return bent rows that are outside with the largest rate from which the object can still stop.

    It must stop before the turn that is nearest to the inside, because any further turn leads away
    again. Straight rows are returned unchanged.
    """
    bend = getattr(limit, "curvature", 0.0)
    if not bend:
        return rows
    most = _ROOM * rows.matrix**2 @ ca.DM(twist.speed > 0) / (bend * brake.slowest)
    outside = ca.fmin(rows.to_lower, rows.to_upper) < 0
    return replace(rows, rate=ca.if_else(outside, ca.fmin(rows.rate, most), rows.rate))


def movable_rows(twist: TwistLimit, limits: Sequence[Limit], context: LimitContext) -> list[int]:
    """Return the numbers, among all rows, of the rows that are not zero by structure."""
    numbers, start = [], 0
    for limit in limits:
        matrix = driven(twist, limit.rows(context).matrix)
        numbers += [start + row for row in range(matrix.shape[0]) if matrix[row, :].nnz()]
        start += matrix.shape[0]
    return numbers


def row_bounds(
    twist: TwistLimit,
    limits: Sequence[Limit],
    rows: Rows,
    kept: Sequence[int],
    away: Expression,
    brake: Braking,
    final: Expression,
    numbers: Mapping[str, Expression] | None = None,
) -> dict[str, Expression]:
    """Return the bounds of the movable rows, both ends of all rows at once, as vectors.

    Args:
        twist: limit with the axes that the object can move.
        limits: limits of the problem that have rows.
        rows: the movable rows of all limits, stacked.
        kept: their numbers among all rows, see `movable_rows`.
        away: how far each row is certainly outside (2 m,): first beyond the upper ends, then beyond
            the lower ones; 0 for rows that do not ask to come back.
        brake: braking of this period.
        final: 1 in the last pass, in which joints near their end no longer yield.
        numbers: ``rows_yield_zone`` and ``rows_recovery_time`` of all rows (r,). None: those of the
            limits.
    """
    m, kept = len(kept), list(kept)
    if not m:
        return {"A": rows.matrix} | dict.fromkeys(("lbA", "ubA", "side", "cap"), rows.to_lower)
    # An axis that the object must not move may still be coming to rest after a push. It counts
    # until then.
    at_braking = rows.matrix @ brake.twist
    upward, cap = _ends(twist, limits, rows, kept, away, at_braking, brake, final, numbers)
    upper, lower = ca.fmin(upward[:m], FREE), -upward[m:]
    # An inward target never exceeds what the other end allows, because the slack covers one side.
    lower = ca.fmax(lower, -FREE)
    upper = ca.if_else(away[:m] > 0, ca.fmax(upper, lower), upper)
    lower = ca.fmin(lower, upper)
    relaxes_up = ca.logic_and(cap[:m] > 0, at_braking >= lower)
    side, cap = 2 * relaxes_up - 1, ca.if_else(relaxes_up, cap[:m], cap[m:])
    equal = ca.DM(limit_values(limits, "equality")[kept])
    if equal.nnz() and ca.sum1(equal):
        # A surface is an equality, which braking keeps (`on_surface`).
        upper, lower, cap = (
            ca.if_else(equal, own, other)
            for own, other in ((at_braking, upper), (at_braking, lower), (0, cap))
        )
    return {"A": rows.matrix, "lbA": lower, "ubA": upper, "side": side, "cap": cap}


def _ends(
    twist: TwistLimit,
    limits: Sequence[Limit],
    rows: Rows,
    kept: list[int],
    away: Expression,
    at_braking: Expression,
    brake: Braking,
    final: Expression,
    numbers: Mapping[str, Expression] | None,
) -> tuple[Expression, Expression]:
    """Return (largest rate toward each end, allowed excess): upper ends first, then lower ones."""

    def constant(pick: str) -> Expression:
        if numbers is not None and f"rows_{pick}" in numbers:
            return numbers[f"rows_{pick}"][[*kept, *kept], 0]
        return ca.DM(np.tile(limit_values(limits, pick)[kept], 2))

    def twice(values: Expression) -> Expression:
        return ca.vertcat(values, values)

    free = ca.DM(twist.speed > 0)
    slowing = ca.fabs(rows.matrix) @ (brake.acceleration * free)
    distance = ca.fmin(ca.vertcat(rows.to_upper, rows.to_lower), FREE)
    # A row that no twist moves now (a locked joint) has no inward target: none can be reached.
    moves = ca.fabs(rows.matrix) @ free > MOVES
    rate, toward = twice(ca.if_else(moves, rows.rate, FREE)), ca.vertcat(at_braking, -at_braking)
    slower = twice(slowing)
    left = distance - twice(rows.curvature_margin + CLEARANCE)
    allowed = brake.fastest(left, slower, constant("hard"))
    allowed = ca.fmin(rate, allowed + twice(ca.if_else(moves, 0, FREE)))
    # In the yield zone, and beyond the end, the first passes do not bound the joint. If the QP
    # moves it outward, it is locked and the object goes on without it.
    if limit_values(limits, "yield_zone")[kept].any():
        zone = constant("yield_zone")
        inside = ca.logic_and(away <= 0, distance < ca.if_else(zone > 0, zone, -FREE))
        yields = ca.logic_and(inside, ca.logic_not(final))
        allowed = ca.if_else(yields, rate, allowed)
    # The curvature of a row must not carry it further out; on the object side not at all. A
    # straight row has none. Between two ends that are both within the noise of the pose, it stays
    # where it is.
    bent = rows.curvature_margin + ca.fmin(rows.curvature_margin, CLEARANCE)
    curving = twice(ca.if_else(moves, bent / brake.swing, 0))
    # A row that does not ask to come back is only stopped from going further out.
    allowed = ca.fmax(allowed, -constant("hard") * curving)
    # At distance / recovery_time the return would never end, so its last part has a constant speed.
    steady = ca.fmax(away * (1 / constant("recovery_time")), STEADY_RETURN)
    pace = ca.fmin(steady, away * (1 / brake.dt))
    # A bent row needs room between the rate asked for and its largest rate, or a solver finds no
    # solution.
    most = ca.DM(np.where(limit_values(limits, "curvature")[kept] > 0, 1 / _ROOM, 1.0))
    back = ca.fmin(rate * twice(most), ca.fmax(pace, curving)) * twice(moves)
    outside = ca.logic_and(away > 0, twice(moves))
    allowed = ca.if_else(outside, 0, allowed)
    bound = allowed - ca.if_else(outside, back, 0)
    least = allowed - ca.if_else(outside, curving, 0)
    beyond = toward - bound
    needed = ca.fmax(least - bound, beyond)
    return bound, ca.if_else(ca.fmax(needed, beyond + ELBOW) > 0, needed + ELBOW, 0)


def limit_values(limits: Sequence[Limit], pick: str) -> np.ndarray:
    """Return one number per row from the attribute `pick` of the limits, 0 where there is none.

    The attribute is one number for all rows of a limit, or one for each row.
    """
    rows = (np.broadcast_to(getattr(limit, pick, 0.0), len(limit.names)) for limit in limits)
    return np.array([value for each in rows for value in each], dtype=float)


def update_recovery_timer(
    limits: Sequence[Limit],
    asked: ca.MX,
    margins: ca.MX,
    dt: ca.MX,
    numbers: tuple[Expression, Expression] | None = None,
) -> ca.MX:
    """Return the next state of asking (2,).

    A row that was given up may ask again once no row is outside.

    The predicted time follows from the speed at which rows come back, see
    `ergoqp.step.rows`.

    Args:
        limits: limits that have rows.
        asked: seconds for which a row asked to come back, and twice the seconds that it should take
            [s].
        margins: present margins of all rows (r,).
        dt: period [s].
        numbers: tolerance and recovery time of each row (r,). None: those of the limits.
    """
    tolerance, time = numbers or (
        ca.DM(limit_values(limits, name)) for name in ("tolerance", "recovery_time")
    )
    soft = limit_values(limits, "recovers") * (1 - limit_values(limits, "hard"))
    away = ca.if_else(margins < -tolerance, -margins, 0) * ca.DM(soft)
    steady = STEADY_RETURN * time
    fading = time * (ca.log(ca.fmax(away / steady, 1)) + 1)
    longest = largest(ca.if_else(away > steady, fading, away / STEADY_RETURN))
    waiting = ca.vertcat(asked[0] + dt, ca.fmax(asked[1], 2 * longest))
    return ca.if_else(longest > 0, waiting, ca.MX(ca.DM.zeros(2)))
