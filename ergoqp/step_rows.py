"""From margins to bounds: what each row asks of the twist of this period, so that the whole stop afterwards stays inside.

The object stops along a straight line: from twist xi it takes t_s = max_i |xi_i| / a_i seconds and, whatever the periods of
the steps to come, moves at most xi (dt + t_s / 2). So a row with `above` left holds through the stop if
A xi <= above / (dt + t_s / 2), with the longest t_s that this period can reach.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ergoqp.limits import Limit, Situation, TwistLimit
from ergoqp.qp import FREE


@dataclass(frozen=True)
class Braking:
    """What braking does from the twist of the last period.

    Attributes:
        twist: the braking twist (6,).
        low: least twist of this period (6,).
        high: greatest twist of this period (6,); both allow the braking twist.
        reach: seconds of motion at the new twist that a stop from it takes at most [s].
    """

    twist: ca.SX
    low: ca.SX
    high: ca.SX
    reach: ca.SX


def braking(limit: TwistLimit, previous: ca.SX, dt: ca.SX) -> Braking:
    """Return braking twist and twist bounds after the twist `previous` (6,) for a period `dt` [s]."""
    speed, acceleration = ca.DM(limit.speed), ca.DM(limit.acceleration)
    stop = stop_time(limit, previous)
    twist = previous * ca.fmax(0, 1 - dt / ca.fmax(stop, 1e-12))
    # A twist beyond its speed can only come back as fast as the acceleration allows, so the braking twist is never excluded.
    low = ca.fmin(ca.fmax(-speed, previous - acceleration * dt), twist)
    high = ca.fmax(ca.fmin(speed, previous + acceleration * dt), twist)
    return Braking(twist, low, high, dt + (stop + dt) / 2)


def stop_time(limit: TwistLimit, twist: ca.SX) -> ca.SX:
    """Return how long it takes to stop from a twist (6,) [s]."""
    return ca.mmax(ca.fabs(twist) / ca.DM(limit.acceleration))


def stop_displacement(limit: TwistLimit, twist: ca.SX, dt: ca.SX) -> ca.SX:
    """Return the largest displacement (6,) [m, rad] of one period at `twist` and the stop after it."""
    return twist * (dt + stop_time(limit, twist) / 2)


@dataclass(frozen=True)
class RowBounds:
    """Rows over the twist, as the QP takes them (`ergoqp.qp.build_qp`), only those that some twist can move."""

    matrix: ca.SX
    lower: ca.SX
    upper: ca.SX
    side: ca.SX
    cap: ca.SX


def movable_rows(limits: Sequence[Limit], situation: Situation) -> list[int]:
    """Return the numbers, among all rows, of those that are not zero by structure."""
    numbers, start = [], 0
    for limit in limits:
        matrix = limit.rows(situation).matrix
        numbers += [start + row for row in range(matrix.shape[0]) if matrix[row, :].nnz()]
        start += matrix.shape[0]
    return numbers


def row_bounds(
    limits: Sequence[Limit], situation: Situation, brake: Braking, final: ca.SX, movable: Sequence[int]
) -> RowBounds:
    """Return the bounds of the movable rows.

    Args:
        limits: the row limits of the problem.
        situation: where things are.
        brake: of this period.
        final: 1 in the last pass, in which joints near their end do not yield any more.
        movable: which rows to keep, see `movable_rows`.
    """
    blocks = [_bounds(limit, situation, brake, final) for limit in limits]
    matrix, lower, upper, side, cap = (ca.vertcat(*parts) for parts in zip(*blocks, strict=True))
    return RowBounds(*(ca.densify(part[movable, :]) for part in (matrix, lower, upper, side, cap)))


def _bounds(limit: Limit, situation: Situation, brake: Braking, final: ca.SX) -> tuple[ca.SX, ...]:
    rows = limit.rows(situation)
    at_braking = rows.matrix @ brake.twist
    # A row that no twist moves now (a locked joint) has no inward target: it could only be missed.
    moves = ca.sum2(ca.fabs(ca.densify(rows.matrix))) > 1e-6
    upper, cap_up = _one_end(limit, rows.above, rows.rate, at_braking, moves, brake, final)
    lower, cap_down = _one_end(limit, rows.below, rows.rate, -at_braking, moves, brake, final)
    upper = ca.fmin(upper, FREE)
    # An inward target never asks for more than the other end allows; the slack covers only one side.
    lower = ca.fmin(ca.fmax(-lower, -FREE), upper)
    relaxes_up = cap_up > 0
    return rows.matrix, lower, upper, ca.if_else(relaxes_up, 1.0, -1.0), ca.if_else(relaxes_up, cap_up, cap_down)


def _one_end(
    limit: Limit, distance: ca.SX, rate: ca.SX, at_braking: ca.SX, moves: ca.SX, brake: Braking, final: ca.SX
) -> tuple[ca.SX, ca.SX]:
    """Return (largest rate toward this end, by how much it may be exceeded) for each row."""
    inside = distance >= -limit.tolerance
    coming_back = ca.fmin(rate, -distance / limit.recovery_time)
    wanted_back = ca.if_else(moves, coming_back, 0.0)
    allowed = ca.fmin(rate, ca.fmax(distance, 0) / brake.reach)
    bound = ca.if_else(inside, allowed, -wanted_back)
    least = ca.if_else(inside, allowed, 0.0)
    if limit.yield_zone:
        # In the zone the first passes let the joint go where the QP wants it: outward, it is locked and the object goes on.
        near = ca.logic_and(distance < limit.yield_zone, distance >= -limit.tolerance)
        yields = ca.logic_and(near, ca.logic_not(final))
        bound, least = ca.if_else(yields, rate, bound), ca.if_else(yields, rate, least)
    if limit.hard:
        # The last acceptance promised the braking twist, so a hard row never excludes it and needs no slack inside.
        bound = ca.if_else(inside, ca.fmax(bound, at_braking), bound)
        least = ca.if_else(inside, bound, least)
    return bound, ca.fmax(0, ca.fmax(least, at_braking) - bound)


def limit_values(limits: Sequence[Limit], pick: str) -> np.ndarray:
    """Return one number per row from the limits' attribute `pick`."""
    return np.array([getattr(limit, pick) for limit in limits for _ in limit.names], dtype=float)
