"""Range and rate of the person's joints: soft rows, through S."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated

import casadi as ca
import numpy as np

from ergoqp.arguments import Range, check_kind, check_parameters, read_array, shown
from ergoqp.errors import InputError
from ergoqp.joints import INDEX, JOINTS, LOWER, UPPER
from ergoqp.limits.limit import LimitContext, Recovery, Rows, straight_margins


@dataclass(frozen=True)
class JointLimit:
    """Range and rate of every joint of the person.

    A joint within `yield_zone_deg` of its end yields: the response holds it there and the other
    joints follow. So one joint at its end does not stop the object. A joint that the sensors do not
    see has no row, because its angle is unknown.

    Attributes:
        ranges_deg: narrower ranges, by joint name: (least, greatest) [deg]. The others are those of
            `ergoqp.joints`.
        rate_deg: largest rate that the object may ask of a joint [deg/s].
        yield_zone_deg: distance to the end within which a joint yields [deg].
        tolerance_deg: measured angle outside that still counts as at the end [deg].
        recover: whether a joint outside a range that was narrowed here moves the object until the
            joint is back, for at most twice the time that this should take. Otherwise, and always
            at the end of what a body can do, the joint is only kept from going further: an angle
            measured out there shows that the range or the sensor is wrong.
        recovery_time: time constant of the return from outside [s]. The speed back is distance /
            recovery_time.

    Raises:
        InputError: if a value has the wrong type or is out of range.

    Example:
        >>> import numpy as np
        >>> from ergoqp import JOINTS
        >>> from ergoqp.limits import JointLimit
        >>> limit = JointLimit(ranges_deg={"trunk_flexion": (0, 30)}, recover=True)
        >>> lower, upper = limit.range
        >>> round(float(np.degrees(upper[JOINTS.index("trunk_flexion")])), 6)
        30.0
    """

    ranges_deg: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    rate_deg: Annotated[float, Range(1e-3, 1e4, "deg/s", (6.3, 720.0))] = 90.0
    yield_zone_deg: Annotated[float, Range(0.0, 20.0, "deg")] = 1.5
    tolerance_deg: Annotated[float, Range(0.0, 20.0, "deg")] = 2.0
    recovery_time: Recovery = 1.0
    recover: bool = False
    hard = False
    margin_is_lower_bound = False
    linear = True
    unit = "rad"
    names = JOINTS
    state = JOINTS
    kind = "joints"

    def __post_init__(self) -> None:
        """Check names and numbers."""
        check_kind(
            "ranges_deg",
            self.ranges_deg,
            Mapping,
            "a table of joints, each with its (least, greatest) [deg]",
        )
        for name, ends in self.ranges_deg.items():
            if name not in INDEX:
                raise InputError(
                    f"ranges_deg: got {shown(name)}, allowed a joint such as 'trunk_flexion'"
                )
            low, high = read_array(
                f"ranges_deg of {name}", ends, (2,), "two numbers, (least, greatest) [deg]"
            )
            least, greatest = np.degrees([LOWER[INDEX[name]], UPPER[INDEX[name]]])
            if not least - 1e-9 <= low < high <= greatest + 1e-9:
                raise InputError(
                    f"ranges_deg of {name}: got {low:g} to {high:g}, allowed within {least:.0f} to"
                    f" {greatest:.0f} deg"
                )
        check_parameters(self)

    @cached_property
    def tolerance(self) -> float:
        """`tolerance_deg` in [rad]."""
        return float(np.radians(self.tolerance_deg))

    @cached_property
    def yield_zone(self) -> float:
        """`yield_zone_deg` in [rad]."""
        return float(np.radians(self.yield_zone_deg))

    @cached_property
    def range(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper ends of all joints, each (32,) [rad]."""
        lower, upper = LOWER.copy(), UPPER.copy()
        for name, (low, high) in self.ranges_deg.items():
            lower[INDEX[name]], upper[INDEX[name]] = np.radians([low, high])
        return lower, upper

    @property
    def recovers(self) -> tuple[bool, ...]:
        """Which joints ask to come back when they are outside, see `recover`."""
        return tuple(self.recover and name in self.ranges_deg for name in JOINTS)

    def measure(self) -> None:
        """Return None: nothing is computed beforehand."""

    def constants(self) -> dict[str, np.ndarray]:
        """Return ``lower``, ``upper`` [rad] and ``rate`` [rad/s] of every joint (32,)."""
        lower, upper = self.range
        return {
            "lower": lower,
            "upper": upper,
            "rate": np.full(len(JOINTS), np.radians(self.rate_deg)),
        }

    def structure(self) -> tuple[tuple[bool, ...], bool]:
        """Return which joints ask to come back, and whether a joint yields at its end."""
        return self.recovers, bool(self.yield_zone)

    def rows(self, context: LimitContext) -> Rows:
        """Return one row per joint. The row of a joint that the object cannot move is zero."""
        given = context.given(self)
        q, seen = context.posture, context.observed
        landed = q + context.shift
        below = ca.if_else(seen, landed - given.lower, ca.inf)
        above = ca.if_else(seen, given.upper - landed, ca.inf)
        return Rows(context.sensitivity, below, above, given.rate, ca.DM.zeros(len(JOINTS)))

    def margins(self, context: LimitContext, displacement: ca.SX) -> ca.SX:
        """Return the smallest margins on the path, by the linear model of the person."""
        return straight_margins(self.rows(context), displacement)
