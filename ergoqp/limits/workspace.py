"""Where the object may be: a box for the contact point, a cone for the tool's axis.

Both are hard rows on the object side.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Final

import casadi as ca
import numpy as np

from ergoqp.arguments import Range, check_parameters
from ergoqp.errors import InputError
from ergoqp.expressions import turned
from ergoqp.joints import JOINTS
from ergoqp.limits.limit import (
    Expression,
    LimitContext,
    Recovery,
    Rows,
    straight_margins,
    three,
)

_AXIS_NAMES: Final = ("x", "y", "z")

_Coordinate = Annotated[float, Range(unit="m", usual=(-3.0, 3.0))]
_Point = tuple[_Coordinate, _Coordinate, _Coordinate]


@dataclass(frozen=True)
class WorkspaceBox:
    """The contact point stays in a box of the world.

    Attributes:
        lower: least x, y, z [m].
        upper: greatest x, y, z [m].
        tolerance: distance outside that still counts as on the limit, for noise [m].
        recovery_time: time constant of the return from outside [s]. The speed back is distance /
            recovery_time.

    Raises:
        InputError: if a value has the wrong type or is out of range.

    Example:
        >>> import ergoqp
        >>> from ergoqp.limits import TwistLimit, WorkspaceBox
        >>> box = WorkspaceBox(lower=(0.2, -0.4, 0.7), upper=(0.7, 0.4, 1.4))
        >>> problem = ergoqp.load_problem("screwing")
        >>> small = problem.replace(limits=[TwistLimit(), box])
        >>> small.row_names
        ('workspace x', 'workspace y', 'workspace z')
    """

    lower: _Point
    upper: _Point
    tolerance: Annotated[float, Range(0.0, 1.0, "m")] = 1e-6
    recovery_time: Recovery = 2.0
    hard = True
    margin_is_lower_bound = False
    yield_zone = 0.0
    linear = True
    unit = "m"
    names = tuple(f"workspace {axis}" for axis in _AXIS_NAMES)
    state = JOINTS
    kind = "workspace"
    recovers = (True, True, True)

    def __post_init__(self) -> None:
        """Check the numbers, and that the box is not empty."""
        for what, value in (("lower", self.lower), ("upper", self.upper)):
            object.__setattr__(self, what, three(f"workspace {what}", value))
        if not np.all(np.asarray(self.lower) <= np.asarray(self.upper)):
            raise InputError(
                f"workspace: got lower {self.lower} above upper {self.upper}, allowed lower <="
                " upper"
            )
        check_parameters(self, "workspace ")

    def measure(self) -> None:
        """Return None: nothing is computed beforehand."""

    def constants(self) -> dict[str, np.ndarray]:
        """Return ``lower`` and ``upper`` (3,) [m]."""
        return {"lower": np.array(self.lower), "upper": np.array(self.upper)}

    def structure(self) -> tuple[()]:
        """Return nothing: all boxes have the same operations."""
        return ()

    def rows(self, context: LimitContext) -> Rows:
        """Return one row per axis."""
        point, given = context.pose[:3, 3], context.given(self)
        matrix = ca.DM(3, 6)
        matrix[:, :3] = ca.DM.eye(3)
        free, straight = ca.DM([ca.inf] * 3), ca.DM.zeros(3)
        return context.reduced(
            self.names[0],
            Rows(matrix, point - given.lower, given.upper - point, free, straight),
        )

    def margins(self, context: LimitContext, displacement: ca.SX) -> ca.SX:
        """Return the smallest margins on the path; they are exact, because a box is convex.

        A point outside that comes back must not leave the box at the other end. There the distance
        outside counts in addition.
        """
        rows = self.rows(context)
        through = replace(
            rows,
            to_lower=rows.to_lower + ca.fmin(rows.to_upper, 0),
            to_upper=rows.to_upper + ca.fmin(rows.to_lower, 0),
        )
        return straight_margins(through, displacement)


@dataclass(frozen=True)
class AxisCone:
    """The tool's axis (x of the contact frame) stays within an angle of a direction of the world.

    Attributes:
        direction: axis of the cone, of any length but zero (dimensionless).
        half_angle_deg: half the opening angle [deg].
        tolerance: angle outside that still counts as on the limit, for noise [rad].
        recovery_time: time constant of the return from outside [s]. The speed back is distance /
            recovery_time.

    Raises:
        InputError: if a value has the wrong type or is out of range.

    Example:
        >>> from ergoqp.limits import AxisCone
        >>> cone = AxisCone(direction=(2, 0, 0), half_angle_deg=30.0)
        >>> cone.direction, cone.unit
        ((1.0, 0.0, 0.0), 'rad')
    """

    direction: tuple[float, float, float]
    half_angle_deg: Annotated[float, Range(1e-6, 170.0, "deg", (3.2, 170.0))]
    tolerance: Annotated[float, Range(0.0, 1.0, "rad")] = 1e-6
    recovery_time: Recovery = 2.0
    hard = True
    margin_is_lower_bound = False
    yield_zone = 0.0
    curvature = 3.0
    unit = "rad"
    names = ("tool axis",)
    state = JOINTS
    kind = "tool axis"
    recovers = (True,)

    def __post_init__(self) -> None:
        """Check the numbers and make the direction a unit vector."""
        direction = np.asarray(three("tool axis direction", self.direction))
        length = float(np.linalg.norm(direction)) if np.abs(direction).max() <= 1e9 else np.inf
        if not 1e-9 < length < np.inf:
            raise InputError(
                f"tool axis direction: got {self.direction}, allowed any vector from 1e-9 to 1e9"
                " long"
            )
        object.__setattr__(self, "direction", tuple(float(x) for x in direction / length))
        check_parameters(self, "tool axis ")

    def measure(self) -> None:
        """Return None: nothing is computed beforehand."""

    def constants(self) -> dict[str, np.ndarray]:
        """Return ``direction`` (3,) and ``half_angle`` [rad]."""
        half = np.array([np.radians(self.half_angle_deg)])
        return {"direction": np.array(self.direction), "half_angle": half}

    def structure(self) -> tuple[()]:
        """Return nothing: all cones have the same operations."""
        return ()

    def rows(self, context: LimitContext) -> Rows:
        """Return the one row, of the angle between the tool's axis and the direction.

        The angle grows with a turn about the normal of the two.

        A cone is curved. With the slope at the middle of the swing, the change of the angle along
        the swing is exact to second order. The reserve covers turns that differ from the swing.
        Without it, the certification would brake a turn along the edge of the cone.
        """
        axis = context.pose[:3, 0]
        turn = context.stop_displacement[3:]
        change = ca.norm_2(context.change[3:])
        given = context.given(self)
        middle = given.direction
        _, sine, cosine = _slope(middle, axis)
        matrix, _, _ = _slope(middle, turned(turn / 2, axis))
        slope = matrix[0, 3:] @ turn
        bend = ca.fmax(
            0, cosine * (ca.sumsqr(turn) - slope**2) - ca.dot(middle, turn) * ca.dot(axis, turn)
        )
        reserve = 1.5 * change * (2 * ca.sqrt(bend) + change) / (2 * ca.fmax(sine, 0.1))
        start, along = _uncertain(context, sine, ca.norm_2(turn) + change)
        along += _mixed(context, turn, change)
        if context.overshoot_bound is not None and context.overshoot_angle is not None:
            along += _beyond(context.overshoot_angle + ca.norm_2(context.overshoot_bound[3:]), sine)
        above = given.half_angle - ca.atan2(sine, cosine) - start
        return context.reduced(
            self.names[0], Rows(matrix, ca.SX([ca.inf]), above, ca.SX([ca.inf]), reserve + along)
        )

    def margins(self, context: LimitContext, displacement: ca.SX) -> ca.SX:
        """Return the smallest margin during a turn about a fixed axis.

        It is exact except for the motion under way, see `_uncertain`.

        While the tool's axis a turns by phi about u, d . a(phi) = c + m cos(phi - phi0). The
        smallest value on [0, end] is at an end or where phi - phi0 = pi.
        """
        given, axis = context.given(self), context.pose[:3, 0]
        middle = given.direction
        turn = context.straight(displacement)[3:]
        end = ca.sqrt(ca.sumsqr(turn) + 1e-24)
        u = turn / end
        constant = ca.dot(u, axis) * ca.dot(u, middle)
        cosine = ca.dot(middle, axis) - constant
        sine = ca.dot(middle, ca.cross(u, axis))
        at_end = constant + cosine * ca.cos(end) + sine * ca.sin(end)
        farthest = ca.pi + ca.atan2(sine, cosine)
        passes = ca.logic_and(farthest >= 0, farthest <= end)
        least = ca.fmin(at_end, ca.if_else(passes, constant - ca.hypot(cosine, sine), 1.0))
        start, along = _uncertain(context, _slope(middle, axis)[1], end)
        along += _mixed(context, turn)
        lead, most, raised = context.overshoot, context.overshoot_bound, context.overshoot_angle
        if lead is not None and most is not None and raised is not None:
            # The rows and the rates of the angle at the start and at the end of the turn.
            turned_axis = (
                axis * ca.cos(end)
                + ca.cross(u, axis) * ca.sin(end)
                + u * ca.dot(u, axis) * (1 - ca.cos(end))
            )
            rows, sines, _ = zip(
                *(_slope(middle, place) for place in (axis, turned_axis)), strict=True
            )
            rates = [ca.fmin(ca.fmax(row[0, 3:] @ u, 0), 1) for row in rows]
            reach = ca.fmax(*(ca.fabs(row) @ most for row in rows))
            here, there = _risen(
                ca.norm_2(lead[3:]), ca.fmax(*rates), reach, ca.norm_2(most[3:]), raised, sines
            )
            start, along = start + here, along + there
        lost = context.margin_reduction.get(self.names[0], (0, 0))[1]
        nearest, farthest = (
            given.half_angle - ca.acos(ca.fmax(-1.0, ca.fmin(1.0, part)))
            for part in (constant + cosine, least)
        )
        return ca.fmin(nearest, farthest - along) - start - lost


def _slope(middle: Expression, axis: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return the rate (1, 6) per twist of the angle between the direction and an axis (3,).

    The sine and the cosine of that angle are returned too.
    """
    normal = ca.cross(middle, axis)
    sine, cosine = ca.sqrt(ca.sumsqr(normal) + 1e-18), ca.dot(middle, axis)
    matrix = ca.SX(1, 6)
    matrix[0, 3:] = (normal / sine).T
    return matrix, sine, cosine


def _uncertain(context: LimitContext, sine: ca.SX, end: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return the largest error of the angle by an uncertain turn of L rad under way.

    The first value is at the start of a further turn, the second along a further turn of `end` rad.

    The direction in which the angle grows turns by at most L / sin(angle) while the axis turns by
    L. So the angle differs from its first-order change by at most L^2 / (2 sin). A further turn by
    W then changes the angle by at most W L / sin more or less.
    """
    if context.turn is None:
        return ca.SX(0), ca.SX(0)
    turn = context.turn
    # sin(angle - L) >= sin(angle) - L: the smallest sine during the turn.
    near, nearer = (ca.fmax(sine - part, 1e-6) for part in (turn, turn + end))
    return ca.fmin(turn, turn**2 / (2 * near)), ca.fmin(turn, end * turn / nearer)


def _mixed(context: LimitContext, turn: ca.SX, change: ca.SX | float = 0.0) -> ca.SX:
    """Return the largest error of a turn (3,) that happens during the motion under way [rad].

    Turns do not commute. Turns at the same time differ from the same turns one after the other by
    the area between their paths, and by third-order terms, which are not counted.
    """
    if context.direction_error is None:
        return ca.SX(0)
    ahead = context.pending_displacement[3:]
    return (
        ca.norm_2(ca.cross(ahead, turn))
        + context.direction_error * (ca.norm_2(turn) + change)
        + ca.norm_2(ahead) * change
    )


def _risen(
    led: ca.SX, rate: ca.SX, reach: ca.SX, most: ca.SX, raised: ca.SX, sines: tuple[ca.SX, ...]
) -> tuple[ca.SX, ca.SX]:
    """Return the largest effect of a rising mean on a cone: (at the start, along a turn) [rad].

    The effect is first order along the slope, where that is known, plus a second-order part.

    Args:
        led: addition of the mean with this twist, at any acceleration [rad].
        rate: largest growth of the angle per rad of `led`.
        reach: largest growth of the angle at any twist [rad].
        most: largest addition of the mean at any twist [rad].
        raised: addition of the mean without this twist [rad].
        sines: sines of the angle at the start and at the end of the turn.
    """
    along = ca.fmin(rate * led, reach) + _beyond(raised + ca.fmin(led, most), ca.fmin(*sines))
    return _beyond(raised, sines[0]), along


def _beyond(turn: ca.SX, sine: ca.SX) -> ca.SX:
    """Return the largest change of an angle beyond its slope by a turn of `turn` [rad]."""
    return ca.fmin(turn, turn**2 / (2 * ca.fmax(sine - turn, 1e-6)))
