"""Where the contact point must not be, and the straight way out for an object that is there.

The straight way out of regions to keep out of, for an object that is in one.

The nearest face of a region may lie outside the workspace or in another region. Then the object
would be pushed against a wall and stay.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from types import SimpleNamespace
from typing import Annotated, Any, ClassVar, Final, Protocol

import casadi as ca
import numpy as np

from ergoqp.arguments import Range, check_has, check_parameters, check_text, shown
from ergoqp.errors import InputError, last_line
from ergoqp.expressions import column, dense, slices
from ergoqp.joints import JOINTS
from ergoqp.limits.limit import (
    LimitContext,
    Recovery,
    Rows,
    straight_margins,
    three,
    with_symbols,
)

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


_Coordinate = Annotated[float, Range(unit="m", usual=(-10.0, 10.0))]
_Point = tuple[_Coordinate, _Coordinate, _Coordinate]


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
    offset: Annotated[float, Range(-_LARGEST, _LARGEST, "m", (-10.0, 10.0))]
    flat: ClassVar[bool] = True
    directions: ClassVar[tuple[str, ...]] = ("normal",)

    def __post_init__(self) -> None:
        """Check the numbers and make the normal a unit vector."""
        normal = np.array(three("keep_out normal", self.normal, _LARGEST))
        length = float(np.linalg.norm(normal))
        if length < 1e-9:
            raise InputError(f"keep_out normal: got {self.normal}, allowed any vector but zero")
        object.__setattr__(self, "normal", tuple((normal / length).tolist()))
        check_parameters(self, "keep_out ")

    def nearest(self, point: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return distance and direction. The direction is the normal everywhere."""
        normal = ca.SX(column(self.normal))
        return ca.dot(normal, point) - self.offset, normal

    def constants(self) -> dict[str, np.ndarray]:
        """Return ``normal`` (3,) and ``offset`` [m]."""
        return {"normal": np.array(self.normal), "offset": np.array([self.offset])}


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

    centre: _Point
    radius: Annotated[float, Range(1e-9, _LARGEST, "m", (0.005, 5.0))]

    def __post_init__(self) -> None:
        """Check the numbers."""
        object.__setattr__(self, "centre", three("keep_out centre", self.centre, _LARGEST))
        check_parameters(self, "keep_out ")

    def nearest(self, point: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return distance and direction: away from the centre, and up at the centre itself."""
        away = point - column(self.centre)
        length = ca.sqrt(ca.sumsqr(away) + _TINY)
        return length - self.radius, ca.if_else(length < _SAME, ca.DM([0, 0, 1]), away / length)

    def constants(self) -> dict[str, np.ndarray]:
        """Return ``centre`` (3,) and ``radius`` [m]."""
        return {"centre": np.array(self.centre), "radius": np.array([self.radius])}


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

    lower: _Point
    upper: _Point

    def __post_init__(self) -> None:
        """Check the numbers, and that the box is not empty."""
        for end in ("lower", "upper"):
            corner = three(f"keep_out {end}", getattr(self, end), _LARGEST)
            object.__setattr__(self, end, corner)
        if not np.less(self.lower, self.upper).all():
            raise InputError(
                f"keep_out: got lower {self.lower} not below upper {self.upper}, allowed"
                " lower < upper"
            )

    def nearest(self, point: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return distance and direction, from the nearest point; inside, from the nearest face."""
        lower, upper = column(self.lower), column(self.upper)
        beyond = ca.fmax(point - upper, 0) - ca.fmax(lower - point, 0)
        length = ca.sqrt(ca.sumsqr(beyond) + _TINY)
        outside = length > _SAME
        faces = ca.vertcat(point - upper, lower - point)
        depth, inward = ca.mmax(faces), ca.SX(3, 1)
        for face in reversed(range(6)):
            out = ca.DM(np.eye(3)[face % 3] * (1.0 if face < 3 else -1.0))
            inward = ca.if_else(faces[face] >= depth, out, inward)
        return ca.if_else(outside, length, depth), ca.if_else(outside, beyond / length, inward)

    def constants(self) -> dict[str, np.ndarray]:
        """Return ``lower`` and ``upper`` (3,) [m]."""
        return {"lower": np.array(self.lower), "upper": np.array(self.upper)}


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
    tolerance: Annotated[float, Range(0.0, 1.0, "m")] = 1e-6
    recovery_time: Recovery = 2.0
    name: str = "keep out"
    hard = True
    margin_is_lower_bound = False
    yield_zone = 0.0
    unit = "m"
    violation_label = "in"
    recovers = (True,)
    state = JOINTS

    def __post_init__(self) -> None:
        """Check the numbers."""
        allowed = "a HalfSpace, Box or Ball of ergoqp.limits.keep_out"
        check_has("keep_out region", self.region, "nearest", allowed)
        if not isinstance(self.region, (HalfSpace, Ball, Box)):
            _check_nearest(self.region)
        check_text("keep_out name", self.name)
        check_parameters(self, "keep_out ")

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

    def constants(self) -> dict[str, np.ndarray]:
        """Return the numbers of a region of the package, each of shape (3,) or (1,).

        Other regions have them in their expressions.
        """
        region: Any = self.region
        return region.constants() if type(region) in (HalfSpace, Ball, Box) else {}

    def structure(self) -> Any:
        """Return the kind of a region of the package and the zeros of its directions, or all."""
        numbers = self.constants()
        directions = [numbers[name] != 0 for name in getattr(self.region, "directions", ())]
        return (type(self.region), directions) if numbers else self.region

    def rows(self, context: LimitContext) -> Rows:
        """Return the one row, of the half-space that touches the region nearest to the object.

        Inside a region of the package, it is the half-space at the end of the way out, see
        `ergoqp.limits.keep_out`.
        """
        ahead = context.pending_displacement[:3]
        region = self.region
        if self.constants():
            region = with_symbols(region, context.given(self))
        distance, direction = region.nearest(context.pose[:3, 3] - ahead)
        if (way := context.readings.get(self.name)) is not None:
            inside = way[3] > 0
            direction = ca.if_else(inside, way[:3], direction)
            distance = ca.if_else(inside, -way[3], distance)
        distance += ca.dot(direction, ahead)
        matrix = ca.SX(1, 6)
        matrix[0, :3] = direction.T
        free, straight = ca.SX([ca.inf]), ca.SX(1, 1)
        return context.reduced(self.name, Rows(matrix, distance, free, free, straight))

    def margins(self, context: LimitContext, displacement: ca.SX) -> ca.SX:
        """Return the smallest distance to the edge of that half-space on a straight path."""
        return straight_margins(self.rows(context), displacement, context)


def _check_nearest(region: Region) -> None:
    """Check at a few points that a user's region returns a distance and a unit vector."""
    point = ca.SX.sym("point", 3)
    try:
        distance, direction = region.nearest(point)
        nearest = ca.Function("nearest", [point], [distance, ca.norm_2(direction)])
        lengths = [float(nearest(at)[1]) for at in _SAMPLES]
        shapes = distance.shape, direction.shape
    except Exception as error:  # any error in the code of a user's region
        raise InputError(
            f"keep_out region: got {type(error).__name__} ({last_line(error)[:100]}) from nearest"
            f" of {shown(region)}, allowed a distance and a direction (3,) of CasADi"
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


_FAR: Final = 1e6
"""Stands for the length of a way that does not end [m]."""

_CLEAR: Final = 2e-3
"""Distance from a region at which an object outside the workspace passes it [m]."""

_ROUNDING: Final = 1e-9

_MOVES: Final = 1e-4
"""A half-space whose normal has less than this along the object's axes cannot be left."""

_DIRECTIONS: Final = np.array(
    sorted((each for each in product((0, 1, -1), repeat=3) if any(each)), key=np.count_nonzero),
    dtype=float,
).T
"""Along the axes, then between two and three of them (3, 26)."""


@dataclass(frozen=True)
class _Given:
    """What the way out depends on, as symbols: the regions, and numbers of `WayOut`."""

    regions: list[Any]
    lower: Any
    upper: Any
    inside: Any
    room: Any
    allowed: Any


@dataclass(frozen=True)
class WayOut:
    """The shortest straight way from a place in a region to a place where every region holds.

    A way leads along an axis, between axes, or from the nearest point of the region. It counts if
    it enters no other region and does not leave the workspace. On the way its length falls by the
    way that is made, and so does the least of all lengths. So an object that follows the shortest
    one at every step comes out, and no step leads it further in.

    An object outside the workspace is led past regions between it and the workspace in the same
    manner: out of all places from which the straight way back meets a region.

    Regions of users say where their nearest point is, and not where a way through them ends. They
    are left by that point, as if they were alone.

    Attributes:
        kept: all regions of the package that the object can leave.
        lower: least x, y, z of the workspace (3,) [m].
        upper: greatest x, y, z of the workspace (3,) [m].
        inside: distance outside the workspace that counts as inside [m].
        room: distance from the workspace's ends at which the object can rest (3,) [m].
        moves: whether the object can move along x, y, z.
        allowed: how deep in each region still counts as outside (k,) [m].
    """

    kept: tuple[KeepOut, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    inside: float
    room: tuple[float, ...]
    moves: tuple[bool, ...]
    allowed: tuple[float, ...]

    @classmethod
    def of(
        cls, limits: Sequence[Any], box: Any, room: np.ndarray, moves: np.ndarray, noise: np.ndarray
    ) -> WayOut | None:
        """Return the way out of the regions among some limits, or None if there is none to leave.

        Args:
            limits: limits of a problem.
            box: its `WorkspaceBox`, or None.
            room: distance from the box's ends at which the object can rest (3,) [m].
            moves: whether the object can move along x, y, z (3,).
            noise: largest error of a measured position along each axis (3,) [m].
        """
        kept = tuple(limit for limit in limits if _can_be_left(limit, moves))
        if not kept:
            return None
        error = float(np.linalg.norm(noise))
        ends = ((-np.inf,) * 3, (np.inf,) * 3) if box is None else (box.lower, box.upper)
        inside = error if box is None else box.tolerance + error
        allowed = tuple(limit.tolerance + error for limit in kept)
        return cls(kept, *ends, inside, tuple(room + error), tuple(moves.tolist()), allowed)

    @property
    def recovery_time(self) -> float:
        """Time constant of the way out [s]. The speed is its length / recovery_time."""
        return max(limit.recovery_time for limit in self.kept)

    @property
    def size(self) -> int:
        """Number of entries of `function`'s result."""
        return 5 + len(self.kept)

    def constants(self) -> dict[str, np.ndarray]:
        """Return the numbers that are attributes, and ``regions``: those of all regions."""
        names = ("lower", "upper", "inside", "room", "allowed")
        found = {name: np.array(getattr(self, name), dtype=float).reshape(-1) for name in names}
        parts = [part for limit in self.kept for part in limit.constants().values()]
        return found | {"regions": np.concatenate([part.reshape(-1) for part in parts])}

    @property
    def numbers(self) -> np.ndarray:
        """All `constants`, one after the other (m,)."""
        return np.concatenate(list(self.constants().values()))

    def _given(self, numbers: Any) -> _Given:
        """Return what the way depends on, with the symbols of `numbers`."""
        parts = slices({name: value.size for name, value in self.constants().items()})
        found = {name: numbers[at] for name, at in parts.items()}
        rest, regions = found.pop("regions"), list[Any]()
        for limit in self.kept:
            sizes = {name: value.size for name, value in limit.constants().items()}
            own = SimpleNamespace(**{name: rest[at] for name, at in slices(sizes).items()})
            regions.append(with_symbols(limit.region, own))
            rest = rest[sum(sizes.values()) :]
        return _Given(regions, **found)

    @cached_property
    def function(self) -> ca.Function:
        """``pose (4, 4), numbers (m,) -> way (5 + k,)``.

        The entries are the direction (3,) of the way, its length [m], 1 if a way is needed and
        there is none, and for each region the length of the way inside it [m]. All are zero where
        no way is needed.
        """
        pose, numbers = ca.MX.sym("pose", 4, 4), ca.MX.sym("numbers", self.numbers.size)
        given = [pose[:3, 3], *self._where(pose[:3, 3], numbers), numbers]
        symbols = [ca.MX.sym("at", part.shape[0]) for part in given]
        found = ca.Function("found", symbols, [self._search(*symbols)])
        none = ca.Function("none", symbols, [ca.MX(ca.DM.zeros(self.size))])
        way = ca.Function.if_else("way", found, none)(
            ca.mmax(ca.vertcat(given[2], given[3])), *given
        )
        return ca.Function("way_out", [pose, numbers], [way], ["pose", "numbers"], ["way"])

    def of_limits(self, way: Any) -> dict[str, Any]:
        """Return for each region, by name, the direction (3,) of the way and its length inside."""
        return {
            limit.name: ca.vertcat(way[:3], way[5 + number])
            for number, limit in enumerate(self.kept)
        }

    @cached_property
    def _where(self) -> ca.Function:
        """``place (3,), numbers -> (back (3,), within (k,), behind (k,))``.

        `back` leads straight back to the workspace. `within` is 1 for regions that the place is
        in, `behind` for regions that the way back meets.
        """
        place, numbers = ca.SX.sym("place", 3), ca.SX.sym("numbers", self.numbers.size)
        own = self._given(numbers)
        off = ca.fmin(ca.fmax(place, own.lower), own.upper) - place
        back = ca.if_else(ca.fabs(off) > own.inside, off, 0) * ca.DM(self.moves)
        still, outside = ca.SX(3, 1), ca.norm_1(back) > 0
        within = [_depth(region, place, still, 0) for region in own.regions]
        behind = [_depth(region, place, back, _CLEAR) > 0 for region in own.regions]
        parts = [back, ca.vertcat(*within) > own.allowed, outside * ca.vertcat(*behind)]
        return ca.Function("where", [place, numbers], ca.cse(dense(parts)))

    def _search(
        self, place: ca.MX, back: ca.MX, within: ca.MX, behind: ca.MX, numbers: ca.MX
    ) -> ca.MX:
        moves = np.array(self.moves, dtype=float)
        fixed = [each for each in _DIRECTIONS.T if not each[moves == 0].any()]
        away = [ca.MX(ca.DM(each / np.linalg.norm(each))) for each in fixed]
        for region in self._given(numbers).regions:
            if not isinstance(region, Box):
                # Along the other axes the object stays where it is.
                out = ca.DM(moves) * _outward(region, place)
                away.append(out / ca.fmax(ca.norm_2(out), _ROUNDING))
        directions = ca.horzcat(*away)
        parts = (place, back, within, behind, numbers)
        given = [ca.repmat(part, 1, len(away)) for part in parts]
        lengths = self._length.map(len(away))(directions, *given)[0]
        direction, length = _shortest(len(away))(directions, lengths)
        parts = self._length(direction, *parts)[1]
        exists = length < _FAR / 2
        return ca.vertcat(exists * ca.vertcat(direction, length), 1 - exists, exists * parts)

    @cached_property
    def _length(self) -> ca.Function:
        """``(direction (3,), place, *_where, numbers) -> (length, length in each region (k,))``.

        The length is `_FAR` if the way does not count.
        """
        k = len(self.kept)
        d, place, back = (ca.SX.sym(name, 3) for name in ("d", "place", "back"))
        within, behind = ca.SX.sym("within", k), ca.SX.sym("behind", k)
        numbers = ca.SX.sym("numbers", self.numbers.size)
        own = self._given(numbers)
        still, length, parts = ca.SX(3, 1), ca.SX(0), []
        for number, region in enumerate(own.regions):
            part = within[number] * _ends(region, place, d, still, 0)[1]
            passed = behind[number] * _ends(region, place, d, back, _CLEAR)[1]
            length = ca.fmax(length, ca.fmax(part, passed))
            parts.append(part)
        end = place + length * d
        counts = length < _FAR / 2
        for low, high in (
            (ca.fmin(own.lower + own.room, place), end),
            (end, ca.fmax(own.upper - own.room, place)),
        ):
            counts = ca.logic_and(counts, ca.mmin(high - low) >= -_ROUNDING)
        for number, region in enumerate(own.regions):
            enter, leave = _ends(region, place, d, still, -own.allowed[number])
            enters = ca.logic_and(
                enter < ca.fmin(leave, length + ca.mmax(own.room)), leave > _ROUNDING
            )
            enters = ca.logic_and(enters, ca.logic_not(within[number]))
            blocked = _depth(region, end, back, 0) > _ROUNDING
            counts = ca.logic_and(counts, ca.logic_not(ca.logic_or(enters, blocked)))
        outputs = dense([ca.if_else(counts, length, _FAR), ca.vertcat(*parts)])
        inputs = [d, place, back, within, behind, numbers]
        return ca.Function("length", inputs, ca.cse(outputs))


def _depth(region: Any, place: ca.SX, back: ca.SX, grown: float) -> ca.SX:
    """Return how deep a place is in a region that is drawn along ``-back`` and grown [m]."""
    match region:
        case HalfSpace():
            normal: Any = region.normal
            drawn = ca.sum1(ca.fmax(0, -normal * back))
            return region.offset + drawn + grown - ca.dot(normal, place)
        case Ball():
            return region.radius + grown - ca.norm_2(place - _centre(region, place, back))
    low, high = _corners(region, back, grown)
    return ca.mmin(ca.fmin(place - low, high - place))


def _can_be_left(limit: Any, moves: np.ndarray) -> bool:
    """Return whether a limit is a region of the package that the object can leave by moving."""
    region = limit.region if isinstance(limit, KeepOut) else None
    if type(region) not in (HalfSpace, Ball, Box) or not moves.any():
        return False
    return type(region) is not HalfSpace or bool(
        np.abs(np.array(region.normal)[moves]).sum() > _MOVES
    )


def _outward(region: Any, place: ca.MX) -> Any:
    """Return a way (3,) from a place to the nearest end of a half-space or a ball."""
    if isinstance(region, HalfSpace):
        return region.normal
    return place - region.centre


def _corners(region: Any, back: ca.SX, grown: float) -> tuple[ca.SX, ca.SX]:
    """Return the corners of a box that is drawn along ``-back`` and grown."""
    return (
        region.lower - ca.fmax(back, 0) - grown,
        region.upper - ca.fmin(back, 0) + grown,
    )


def _centre(region: Any, place: ca.SX, back: ca.SX) -> ca.SX:
    """Return the centre that is nearest to a place, of a ball that is drawn along ``-back``."""
    centre = region.centre
    return ca.fmin(ca.fmax(place, centre - ca.fmax(back, 0)), centre - ca.fmin(back, 0))


def _ends(region: Any, place: ca.SX, d: ca.SX, back: ca.SX, grown: float) -> tuple[ca.SX, ca.SX]:
    """Return where a straight way enters and leaves a region, as lengths from its beginning [m].

    It does not meet the region if it leaves before it enters. The region is drawn along ``-back``
    and grown.
    """
    match region:
        case HalfSpace():
            normal: Any = region.normal
            rate = ca.dot(normal, d)
            offset = region.offset + ca.sum1(ca.fmax(0, -normal * back)) + grown
            depth = offset - ca.dot(normal, place)
            end = depth / ca.if_else(ca.fabs(rate) > _ROUNDING, rate, _ROUNDING)
            beyond = ca.if_else(depth > 0, _FAR, -_FAR)
            leave = ca.if_else(rate > _ROUNDING, end, ca.if_else(rate < -_ROUNDING, _FAR, beyond))
            return ca.if_else(rate < -_ROUNDING, end, -_FAR), leave
        case Ball(radius=radius):
            apart = place - _centre(region, place, back)
            along, radius = ca.dot(d, apart), ca.fmax(radius + grown, 0)
            square = along**2 - ca.sumsqr(apart) + radius**2
            half = ca.sqrt(ca.fmax(square, 0))
            return (
                ca.if_else(square > 0, -along - half, _FAR),
                ca.if_else(square > 0, half - along, -_FAR),
            )
    low, high = _corners(region, back, grown)
    # Beside a face that the way does not approach, it is at one side of it for ever.
    pace = ca.if_else(ca.fabs(d) > _ROUNDING, d, _ROUNDING / _FAR)
    first, second = (low - place) / pace, (high - place) / pace
    enter, leave = ca.mmax(ca.fmin(first, second)), ca.mmin(ca.fmax(first, second))
    return ca.fmax(enter, -_FAR), ca.fmin(leave, _FAR)


def _shortest(count: int) -> ca.Function:
    """``(directions (3, n), lengths (1, n)) -> (direction (3,), length)``: the first shortest."""
    directions, lengths = ca.SX.sym("directions", 3, count), ca.SX.sym("lengths", 1, count)
    direction, length = directions[:, 0], lengths[0]
    for number in range(1, count):
        less = lengths[number] < length - _ROUNDING
        direction = ca.if_else(less, directions[:, number], direction)
        length = ca.if_else(less, lengths[number], length)
    return ca.Function("shortest", [directions, lengths], [direction, length])
