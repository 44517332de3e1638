"""Where the contact point must not be: below a plane, in a box, in a ball."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Final, Protocol

import casadi as ca
import numpy as np

from ergoqp.arguments import check_number, check_text, object_of, read_array, shown
from ergoqp.errors import InputError
from ergoqp.joints import JOINTS
from ergoqp.limits.limit import RECOVERY_TIMES, Rows, Situation, straight_margins

_TINY: Final = 1e-30
"""Keeps the slope of a square root finite [m^2]."""

_SAME: Final = 1e-9
"""Points closer to each other than this count as one [m]."""

_LARGEST: Final = 1e3
"""Lengths above this are mistakes [m]."""

_SAMPLES: Final = ((0.31, -0.42, 1.13), (-1.7, 2.3, 0.2), (0.04, 0.07, -0.9))
"""Points at which a user's region is checked [m]."""

_UNIT: Final = 1e-6
"""Tolerance of the length of a unit vector."""


class Region(Protocol):
    """A convex part of the world.

    Example:
        >>> import casadi as ca
        >>> from ergoqp.limits import KeepOut
        >>> class Ceiling:
        ...     def nearest(self, point):
        ...         return 2.0 - point[2], ca.SX([0, 0, -1])
        >>> KeepOut(Ceiling(), name="ceiling").names
        ('ceiling',)
    """

    def nearest(self, point: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return the distance of a point (3,) [m] and the direction (3,) in which it grows.

        The distance is to the nearest point of the region, negative inside. The direction is a unit
        vector; if several are possible, any of them. `KeepOut` checks this at a few points.
        """
        ...


@dataclass(frozen=True)
class HalfSpace:
    """All points p with normal . p <= offset.

    Attributes:
        normal: direction out of the region, of any length but zero (dimensionless).
        offset: position of the plane along the unit normal [m].

    Raises:
        InputError: if a value has the wrong type or is out of range.

    Example:
        >>> import casadi as ca
        >>> from ergoqp.limits import HalfSpace
        >>> floor = HalfSpace(normal=(0, 0, 2), offset=0.1)
        >>> distance, direction = floor.nearest(ca.SX([0, 0, 1]))
        >>> floor.normal, float(distance)
        ((0.0, 0.0, 1.0), 0.9)
    """

    normal: tuple[float, float, float]
    offset: float
    flat: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Check the numbers and make the normal a unit vector."""
        normal = _three("keep_out normal", self.normal)
        length = float(np.linalg.norm(normal))
        if length < 1e-9:
            raise InputError(f"keep_out normal: got {self.normal}, allowed any vector but zero")
        object.__setattr__(self, "normal", tuple((normal / length).tolist()))
        check_number("keep_out offset", self.offset, -_LARGEST, _LARGEST, "m")

    def nearest(self, point: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return distance and direction. The direction is the normal everywhere."""
        normal = ca.SX(ca.DM(self.normal))
        return ca.dot(normal, point) - self.offset, normal


@dataclass(frozen=True)
class Ball:
    """All points within a distance of a centre.

    Attributes:
        centre: x, y, z [m].
        radius: radius of the ball [m].

    Raises:
        InputError: if a value has the wrong type or is out of range.

    Example:
        >>> import casadi as ca
        >>> from ergoqp.limits import Ball
        >>> ball = Ball(centre=(0, 0, 1), radius=0.2)
        >>> distance, _ = ball.nearest(ca.SX([0, 0, 2]))
        >>> round(float(distance), 6)
        0.8
    """

    centre: tuple[float, float, float]
    radius: float

    def __post_init__(self) -> None:
        """Check the numbers."""
        centre = _three("keep_out centre", self.centre)
        object.__setattr__(self, "centre", tuple(centre.tolist()))
        check_number("keep_out radius", self.radius, 0.0, _LARGEST, "m")

    def nearest(self, point: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return distance and direction: away from the centre, and up at the centre itself."""
        away = point - ca.DM(self.centre)
        length = ca.sqrt(ca.sumsqr(away) + _TINY)
        return length - self.radius, ca.if_else(length < _SAME, ca.DM([0, 0, 1]), away / length)


@dataclass(frozen=True)
class Box:
    """All points between two corners, along the axes of the world.

    Attributes:
        lower: least x, y, z [m].
        upper: greatest x, y, z [m].

    Raises:
        InputError: if a value has the wrong type or is out of range.

    Example:
        >>> import casadi as ca
        >>> from ergoqp.limits import Box
        >>> box = Box(lower=(0, 0, 0), upper=(1, 1, 1))
        >>> distance, _ = box.nearest(ca.SX([2, 0.5, 0.5]))
        >>> float(distance)
        1.0
    """

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]

    def __post_init__(self) -> None:
        """Check the numbers, and that the box is not empty."""
        lower, upper = (_three(f"keep_out {end}", getattr(self, end)) for end in ("lower", "upper"))
        if not np.all(lower < upper):
            raise InputError(
                f"keep_out: got lower {self.lower} not below upper {self.upper}, allowed"
                " lower < upper"
            )
        object.__setattr__(self, "lower", tuple(lower.tolist()))
        object.__setattr__(self, "upper", tuple(upper.tolist()))

    def nearest(self, point: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return distance and direction, from the nearest point; inside, from the nearest face."""
        beyond = ca.fmax(point - ca.DM(self.upper), 0) - ca.fmax(ca.DM(self.lower) - point, 0)
        length = ca.sqrt(ca.sumsqr(beyond) + _TINY)
        outside = length > _SAME
        faces = ca.vertcat(point - ca.DM(self.upper), ca.DM(self.lower) - point)
        depth, inward = ca.mmax(faces), ca.SX(3, 1)
        for face in reversed(range(6)):
            out = ca.DM(np.eye(3)[face % 3] * (1.0 if face < 3 else -1.0))
            inward = ca.if_else(faces[face] >= depth, out, inward)
        return ca.if_else(outside, length, depth), ca.if_else(outside, beyond / length, inward)


@dataclass(frozen=True)
class KeepOut:
    """The contact point stays out of a region.

    The outside of a convex region is not convex. So the limit is one row: the half-space that
    touches the region at the point nearest to the object. It stays fixed during the motion under
    way and the whole stop. This half-space is part of the allowed set, so a stop inside it stays
    out of the region. The distance from a convex region is a convex function: on a straight path,
    its tangent at a later point lies above its tangents at earlier points from there on. So a stop
    that was certified in one half-space is also certified in the next.

    With a declared position noise (d per axis) the object keeps the distance d along the row and
    sqrt(3) d in addition. So it is never measured inside, where the nearest point may be on the
    other side.

    Attributes:
        region: `HalfSpace`, `Box`, `Ball`, or anything else with a `Region.nearest`.
        tolerance: distance inside that still counts as on the limit, for noise [m].
        recovery_time: time constant of the return from outside [s]. The speed back is distance /
            recovery_time.
        name: name of the row.

    Raises:
        InputError: if a value has the wrong type or is out of range.

    Example:
        >>> import ergoqp
        >>> from ergoqp.limits import Ball, KeepOut
        >>> post = KeepOut(Ball(centre=(0.5, 0.3, 1.0), radius=0.1), name="post")
        >>> problem = ergoqp.load_problem("screwing")
        >>> problem = problem.replace(limits=[*problem.limits, post])
        >>> "post" in problem.row_names
        True
    """

    region: Region
    tolerance: float = 1e-6
    recovery_time: float = 2.0
    name: str = "keep out"
    hard = True
    proven = False
    yield_zone = 0.0
    unit = "m"
    breach = "in"
    returns = (True,)
    state = JOINTS

    def __post_init__(self) -> None:
        """Check the numbers."""
        known = callable(getattr(self.region, "nearest", None))
        if not known or isinstance(self.region, type):
            allowed = "a HalfSpace, Box or Ball of ergoqp.limits.keep_out"
            if known and isinstance(self.region, type):
                allowed = object_of(self.region)
            raise InputError(f"keep_out region: got {shown(self.region)}, allowed {allowed}")
        if not isinstance(self.region, (HalfSpace, Ball, Box)):
            _check_nearest(self.region)
        check_text("keep_out name", self.name)
        check_number("keep_out tolerance", self.tolerance, 0.0, 1.0)
        check_number("keep_out recovery_time", self.recovery_time, *RECOVERY_TIMES, "s")

    @property
    def tangent(self) -> bool:
        """Whether the direction of the row depends on the measured pose."""
        return not getattr(self.region, "flat", False)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of the one row."""
        return (self.name,)

    def measure(self) -> None:
        """Return None: nothing is computed beforehand."""

    def rows(self, situation: Situation) -> Rows:
        """Return the one row, of the half-space that touches the region nearest to the object.

        Inside a region of the package, it is the half-space at the end of the way out, see
        `ergoqp.limits.way_out`.
        """
        ahead = situation.ahead[:3]
        distance, direction = self.region.nearest(situation.pose[:3, 3] - ahead)
        if (way := situation.readings.get(self.name)) is not None:
            inside = way[3] > 0
            direction = ca.if_else(inside, way[:3], direction)
            distance = ca.if_else(inside, -way[3], distance)
        distance += ca.dot(direction, ahead)
        matrix = ca.SX(1, 6)
        matrix[0, :3] = direction.T
        free, straight = ca.SX([ca.inf]), ca.SX(1, 1)
        return situation.counted(self.name, Rows(matrix, distance, free, free, straight))

    def margins(self, situation: Situation, displacement: ca.SX) -> ca.SX:
        """Return the smallest distance to the edge of that half-space on a straight path."""
        return straight_margins(self.rows(situation), displacement, situation)


def _check_nearest(region: Region) -> None:
    """Check at a few points that a user's region returns a distance and a unit vector."""
    point = ca.SX.sym("point", 3)
    try:
        distance, direction = region.nearest(point)
        nearest = ca.Function("nearest", [point], [distance, ca.norm_2(direction)])
        lengths = [float(nearest(at)[1]) for at in _SAMPLES]
        shapes = distance.shape, direction.shape
    except Exception as error:  # any error in the code of a user's region
        words = (str(error).strip().splitlines() or [""])[-1][:100]
        raise InputError(
            f"keep_out region: got {type(error).__name__} ({words}) from nearest of"
            f" {shown(region)}, allowed a distance and a direction (3,) of CasADi"
        ) from None
    if shapes != ((1, 1), (3, 1)):
        raise InputError(
            f"keep_out region: got shapes {shapes[0]} and {shapes[1]} from nearest of"
            f" {shown(region)}, allowed a distance (1, 1) and a direction (3, 1)"
        )
    for at, length in zip(_SAMPLES, lengths, strict=True):
        if not abs(length - 1) < _UNIT:
            raise InputError(
                f"keep_out region: got a direction of length {length:g} at {at} from"
                f" {shown(region)}, allowed a unit vector everywhere"
            )


def _three(what: str, value: Any) -> np.ndarray:
    numbers = read_array(what, value, (3,), "three finite numbers")
    if np.abs(numbers).max() > _LARGEST:
        raise InputError(f"{what}: got {shown(value)}, allowed numbers up to {_LARGEST:g}")
    return numbers
