"""The independent checker: it checks every limit again in plain numpy.

It shares no code with the step, and uses only what was sent and measured. It checks every twist
against speed, acceleration and axes; the pose of the object after each period against workspace and
cone; the predicted posture of the model person against joint ranges and rates and against the
boundary of the data; elbow and wrist against the length of the forearm; and the contact point
against regions to keep out of. Limits and regions of the user's own are checked by the distances
that they declare, because nothing else is known of them. An object that is outside may only move
inward, and an object that is inside must stay inside: the pose is never further out than at its
nearest so far. In a region to keep out of, "inward" is along a way out, as `ergoqp.limits.keep_out`
says what a way is.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from itertools import product
from typing import Any, Final

import numpy as np

from ergoqp.joints import LOWER, UPPER
from ergoqp.limits import (
    ArmLength,
    AxisCone,
    Ball,
    Box,
    HalfSpace,
    JointLimit,
    KeepOut,
    Limit,
    OneClassBoundary,
    WorkspaceBox,
)
from ergoqp.problem.problem import Problem

_ROOM: Final = 1e-3
"""Distance from the ends of the workspace that a way leads to, beside what a mean needs [m]."""

_PAST: Final = 2e-3
"""Distance at which an object outside the workspace passes a region [m]."""

_ROUNDING: Final = 1e-9


@dataclass(frozen=True)
class _Solid:
    """A region: the points on the inner side of all planes, or those near a centre.

    Attributes:
        normals: directions out of the planes (f, 3).
        offsets: positions of the planes along them (f,) [m].
        centre: of a ball (3,) [m].
        radius: of a ball [m]; a region with planes is no ball.
        spared: depth that still counts as outside [m].
    """

    normals: np.ndarray
    offsets: np.ndarray
    centre: np.ndarray
    radius: float
    spared: float

    def drawn(self, back: np.ndarray, wider: float, place: np.ndarray) -> _Solid:
        """Return the region swept by all parts of ``-back``, and so much wider.

        Of a swept ball it is the one that is nearest to the place.
        """
        along = np.maximum(-self.normals * back, 0).sum(axis=1)
        centre = np.clip(
            place, self.centre - np.maximum(back, 0), self.centre - np.minimum(back, 0)
        )
        radius = max(self.radius + wider, 0.0)
        return _Solid(self.normals, self.offsets + along + wider, centre, radius, self.spared)

    def depth(self, place: np.ndarray) -> float:
        """How deep a place (3,) is inside [m]; negative outside."""
        if not len(self.normals):
            return self.radius - float(np.linalg.norm(place - self.centre))
        return float((self.offsets - self.normals @ place).min())

    def crossed(self, place: np.ndarray, ways: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return where straight ways (n, 3) enter and leave (n,), none: enter after they leave."""
        if not len(self.normals):
            apart = place - self.centre
            nearest = -ways @ apart
            rest = self.radius**2 - apart @ apart + nearest**2
            half = np.sqrt(np.maximum(rest, 0))
            meets = rest > 0
            return (
                np.where(meets, nearest - half, np.inf),
                np.where(meets, nearest + half, -np.inf),
            )
        rates, left = ways @ self.normals.T, self.offsets - self.normals @ place
        along = np.abs(rates) <= _ROUNDING
        ends = left / np.where(along, 1.0, rates)
        never = (along & (left <= 0)).any(axis=1)
        enter = np.where(~along & (rates < 0), ends, -np.inf).max(axis=1)
        leave = np.where(~along & (rates > 0), ends, np.inf).min(axis=1)
        return np.where(never, np.inf, enter), np.where(never, -np.inf, leave)


class Ways:
    """The lengths of the ways out of the regions of a problem.

    Args:
        problem: the problem with the limits.
    """

    def __init__(self, problem: Problem) -> None:
        """Read the limits."""
        robot, box = problem.robot, problem.limit_of(WorkspaceBox)
        self._moves = problem.twist_limit.speed[:3] > 0
        noise = robot.pose_noise * 3**0.5
        # A mean that rises for one period more needs this much before an end.
        h, dt = 3 * problem.dt, problem.dt
        acceleration = problem.twist_limit.linear_acceleration * (1 + robot.gain_error)
        rise = acceleration * (h * dt + h**2 / 8) if problem.average else 0.0
        self._room = rise + _ROOM + noise
        self._low, self._high = (
            (np.full(3, -np.inf), np.full(3, np.inf))
            if box is None
            else (np.array(box.lower), np.array(box.upper))
        )
        self._outside = noise + (box.tolerance if box else 0.0)
        self._solids = [
            solid
            for limit in problem.row_limits
            if (solid := _solid(limit, noise)) is not None
            and (solid.radius or np.abs(solid.normals[:, self._moves]).max(initial=0.0) > 1e-4)
        ]
        whole = np.array([each for each in product((-1, 0, 1), repeat=3) if any(each)], float)
        self._fixed = whole[~whole[:, ~self._moves].any(axis=1)]

    def length(self, place: np.ndarray) -> float:
        """Return the length of the shortest way from a place (3,) [m]; infinite if there is none.

        It is 0 where no way is needed.
        """
        back = np.clip(place, self._low, self._high) - place
        back = np.where(self._moves & (np.abs(back) > self._outside), back, 0.0)
        swept = [solid.drawn(back, _PAST, place) for solid in self._solids]
        within = [solid.depth(place) > solid.spared for solid in self._solids]
        behind = [bool(back.any()) and solid.depth(place) > 0 for solid in swept]
        if not any(within) and not any(behind):
            return 0.0
        ways = self._ways(place)
        lengths, enters = np.zeros(len(ways)), np.zeros(len(ways), dtype=bool)
        for solid, wide, inside, meets in zip(self._solids, swept, within, behind, strict=True):
            if inside:
                lengths = np.maximum(lengths, solid.crossed(place, ways)[1])
            if meets:
                lengths = np.maximum(lengths, wide.crossed(place, ways)[1])
        for solid, inside in zip(self._solids, within, strict=True):
            less = solid.drawn(np.zeros(3), -solid.spared, place)
            enter, leave = less.crossed(place, ways)
            if not inside:
                enters |= (enter < np.minimum(leave, lengths + self._room)) & (leave > _ROUNDING)
        ends = place + np.where(np.isfinite(lengths), lengths, 0.0)[:, None] * ways
        low, high = self._low + self._room, self._high - self._room
        stays = (ends >= np.minimum(low, place) - _ROUNDING) & (
            ends <= np.maximum(high, place) + _ROUNDING
        )
        met = [
            any(solid.drawn(back, 0.0, end).depth(end) > _ROUNDING for solid in self._solids)
            for end in ends
        ]
        counts = np.isfinite(lengths) & ~enters & stays.all(axis=1) & ~np.array(met, dtype=bool)
        return float(lengths[counts].min(initial=np.inf))

    def _ways(self, place: np.ndarray) -> np.ndarray:
        """Return the directions (n, 3) in which a way may lead."""
        others = [
            place - solid.centre if solid.radius else solid.normals[0]
            for solid in self._solids
            if solid.radius or len(solid.normals) == 1
        ]
        ways = np.concatenate([self._fixed, *(each[None] * self._moves for each in others)])
        size = np.linalg.norm(ways, axis=1)
        return ways[size > _ROUNDING] / size[size > _ROUNDING, None]


def _solid(limit: Any, noise: float) -> _Solid | None:
    """Return the region of a limit; None if it has none, or one of a user."""
    if type(limit) is not KeepOut or type(limit.region) not in (HalfSpace, Ball, Box):
        return None
    spared, nowhere = limit.tolerance + noise, np.zeros(3)
    match limit.region:
        case HalfSpace(normal, offset):
            return _Solid(np.array([normal]), np.array([offset]), nowhere, 0.0, spared)
        case Ball(centre, radius):
            return _Solid(np.zeros((0, 3)), np.zeros(0), np.array(centre), radius, spared)
        case Box(lower, upper):
            faces = np.concatenate([np.eye(3), -np.eye(3)])
            offsets = np.concatenate([upper, np.negative(lower)])
            return _Solid(faces, offsets, nowhere, 0.0, spared)
    return None


_ALLOWED = 1e-8
"""Excess that counts as rounding, not as a violation, in every unit."""

_SOLVED = 1e-7
"""Accuracy to which the QP keeps a joint's rate [rad/s]."""


class Checker:
    """Counts the violations of limits in one loop, step by step.

    Args:
        problem: the problem with the limits.

    Attributes:
        violations: number of steps that broke a limit, per limit.
        max_violation: largest violation of each limit, in the unit of `units`.
        units: unit of each limit.

    Example:
        >>> import numpy as np
        >>> import ergoqp
        >>> from ergoqp.simulation.check import Checker
        >>> problem = ergoqp.load_problem("screwing")
        >>> checker = Checker(problem)
        >>> fast = np.array([9.0, 0, 0, 0, 0, 0])
        >>> posture = problem.response.comfort
        >>> pose = problem.response.contact()(posture)[0].full()
        >>> broken = checker.check(fast, np.zeros(6), pose, posture, np.zeros(32), problem.dt)
        >>> "speed" in broken, checker.violations["speed"]
        (True, 1)
    """

    def __init__(self, problem: Problem) -> None:
        """Set every count to zero, so that a limit that is never broken is reported too."""
        self.problem, limit = problem, problem.twist_limit
        self._speed = np.array([limit.linear_speed] * 3 + [limit.angular_speed] * 3)
        self._acceleration = np.array(
            [limit.linear_acceleration] * 3 + [limit.angular_acceleration] * 3
        )
        self._frozen = np.array(
            [axis not in limit.axes for axis in ("x", "y", "z", "rx", "ry", "rz")]
        )
        kinds = (WorkspaceBox, AxisCone, JointLimit, OneClassBoundary, ArmLength)
        self._box, self._cone, self._joints, self._boundary, self._length = map(
            problem.limit_of, kinds
        )
        units = {"speed": "m/s, rad/s", "acceleration": "m/s^2, rad/s^2", "axes": "m/s, rad/s"}
        units |= {"jerk": "m/s^3, rad/s^3"} if self.problem.average else {}
        units |= {"workspace": "m"} if self._box else {}
        units |= {"tool axis": "rad"} if self._cone else {}
        units |= {"joint range": "rad", "joint rate": "rad/s"} if self._joints else {}
        units |= {"boundary": "log"} if self._boundary else {}
        units |= {"arm length": "m"} if self._length else {}
        own = problem.own_limits.limits
        units |= {name: limit.unit for limit in own for name in limit.names}
        self._ways = Ways(problem)
        self._least_out: dict[str, np.ndarray] = {}
        self._last = (np.zeros(6), problem.dt)
        self.units = units
        self.violations, self.max_violation = dict.fromkeys(units, 0), dict.fromkeys(units, 0.0)

    def check(
        self,
        twist: np.ndarray,
        previous: np.ndarray,
        pose: np.ndarray,
        posture: np.ndarray | None,
        rate: np.ndarray,
        dt: float,
        observed: np.ndarray | None = None,
        gave_way: Collection[str] = (),
        after: np.ndarray | None = None,
        stops: bool = False,
    ) -> list[str]:
        """Check one step and return the names of the limits that it broke.

        Args:
            twist: the sent twist (6,) [m/s, rad/s].
            previous: twist of the period before (6,) [m/s, rad/s].
            pose: pose of the object when the step was taken (4, 4) [m].
            posture: measured posture (32,) [rad], None if no frame arrived.
            rate: how the model person follows (32,) [rad/s].
            dt: period [s].
            observed: joints that are seen (32,) bool, None: all.
            after: pose of the object at the end of the period (4, 4) [m]; None: the pose that
                the twist leads to.
            stops: whether the step itself reported that it brakes.
            gave_way: joints whose rate the step itself reported as not kept (its `slack`).
                Soft rows come after acceleration and workspace. Such steps are counted by
                their status, not here.
        """
        excess = {
            "speed": float(np.max(np.abs(twist) - self._speed)),
            "acceleration": float(np.max(np.abs(twist - previous) - self._acceleration * dt)) / dt,
            "axes": float(np.max(np.abs(twist[self._frozen]), initial=0.0)),
        }
        if self.problem.average:
            excess["jerk"] = self._jerk_excess((twist - previous) / dt, dt)
        after = _moved(pose, twist * dt) if after is None else after
        if self._box:
            low, high = np.asarray(self._box.lower), np.asarray(self._box.upper)
            excess["workspace"] = self._further_out(
                "workspace", _outside_box(pose, low, high), _outside_box(after, low, high)
            )
        if self._cone:
            angles = [_angle(frame[:3, 0], self._cone.direction) for frame in (pose, after)]
            out = np.array(angles)[:, None] - np.radians(self._cone.half_angle_deg)
            excess["tool axis"] = self._further_out("tool axis", *out)
        if self._joints and posture is not None:
            kept = np.array([name not in gave_way for name in self.problem.coordinates])
            excess |= self._joint_excess(posture, rate, dt, observed, stops, kept)
        if self._boundary and posture is not None:
            excused = not self._boundary.hard and (stops or self._boundary.name in gave_way)
            excess["boundary"] = 0.0 if excused else self._boundary_excess(posture, rate, dt)
        if self._length and posture is not None:
            before, behind = (
                abs(float(np.linalg.norm(points[3:] - points[:3])) - self._length.length)
                for points in (posture, posture + rate * dt)
            )
            excess["arm length"] = behind - before
        excess |= self._own_excess(pose, after, posture, rate * dt, stops, gave_way)
        if not np.isfinite(twist).all():
            excess = {name: np.inf for name in excess}
        broken = [name for name, value in excess.items() if value > _ALLOWED]
        for name in broken:
            self.violations[name] += 1
            self.max_violation[name] = max(self.max_violation[name], excess[name])
        return broken

    def _jerk_excess(self, acceleration: np.ndarray, dt: float) -> float:
        """Return by how much the acceleration changed faster than 2 a / W.

        The change is from the middle of one period to that of the next.
        """
        before, lasted = self._last
        self._last = acceleration, dt
        between = (dt + lasted) / 2
        allowed = 2 * self._acceleration / self.problem.average
        # An acceleration is the difference of two twists over a period, so it has their
        # rounding error.
        rounding = 1e-15 * self._speed / dt
        return float(np.max((np.abs(acceleration - before) - rounding) / between - allowed))

    def _further_out(self, name: str, before: np.ndarray, after: np.ndarray) -> float:
        """Return how much further out it is than at its nearest so far.

        What has come in must stay in, over any number of steps.
        """
        least = np.minimum(self._least_out.get(name, np.inf), np.maximum(before, 0.0))
        self._least_out[name] = np.minimum(least, np.maximum(after, 0.0))
        return float(np.max(after - least))

    def _own_excess(
        self,
        pose: np.ndarray,
        after: np.ndarray,
        posture: np.ndarray | None,
        moved: np.ndarray,
        stops: bool,
        gave_way: Collection[str],
    ) -> dict[str, float]:
        """Return how much further outside each row of the user's own limits is, by its margins."""
        found, own = {}, self.problem.own_limits
        for limit in own.limits:
            if limit.hard:
                before, behind = self._outside_own(limit, pose, after)
                ends = zip(limit.names, before[:, None], behind[:, None], strict=True)
                further = [self._further_out(*end) for end in ends]
            elif posture is None or stops:
                continue
            else:
                before, behind = (
                    own.margins(limit, angles, pose) for angles in (posture, posture + moved)
                )
                further = (np.minimum(before, 0) - behind).tolist()
            found |= {
                name: far
                for name, far in zip(limit.names, further, strict=True)
                if limit.hard or name not in gave_way
            }
        return found

    def _outside_own(self, limit: Limit, *poses: np.ndarray) -> list[np.ndarray]:
        """Return how far outside each row of a hard limit of the user's own is (m,), at each pose.

        An object that was and is in a region of the package counts by the length of the way out, if
        there is one.
        """
        nowhere = np.zeros(len(self.problem.coordinates))
        solid = _solid(limit, 0.0)
        if solid is None:
            return [-self.problem.own_limits.margins(limit, nowhere, pose) for pose in poses]
        depths = [solid.depth(pose[:3, 3]) for pose in poses]
        if min(depths) > _ALLOWED:
            lengths = [self._ways.length(pose[:3, 3]) for pose in poses]
            depths = lengths if np.isfinite(lengths).all() and min(lengths) > 0 else depths
        return [np.array([depth]) for depth in depths]

    def _boundary_excess(self, posture: np.ndarray, rate: np.ndarray, dt: float) -> float:
        """Return how much further outside the posture is than it was; 0 inside."""
        points = self._boundary.model.coordinates.read(np.stack([posture, posture + rate * dt]))
        before, after = self._boundary.model.margin(points)
        return float(min(before, 0.0) - after)

    def _joint_excess(
        self,
        posture: np.ndarray,
        rate: np.ndarray,
        dt: float,
        observed: np.ndarray | None,
        stops: bool,
        kept: np.ndarray,
    ) -> dict[str, float]:
        low, high = LOWER.copy(), UPPER.copy()
        for name, (least, greatest) in self._joints.ranges_deg.items():
            joint = self.problem.coordinates.index(name)
            low[joint], high[joint] = np.radians([least, greatest])
        predicted = posture + rate * dt
        before = np.maximum(np.maximum(low - posture, posture - high), 0)
        out = np.maximum(low - predicted, predicted - high) - before
        # Rows that pass through S hold to the accuracy of the QP only.
        too_fast = np.abs(rate) - np.radians(self._joints.rate_deg) - _SOLVED
        seen = np.ones(len(out), dtype=bool) if observed is None else observed
        out, too_fast = out[seen], too_fast[seen & kept]
        # Acceleration and workspace come before posture, so braking may be the only choice.
        worst = float(np.max(out, initial=0.0)), float(np.max(too_fast, initial=0.0))
        return {"joint range": worst[0], "joint rate": 0.0 if stops else worst[1]}


def _outside_box(pose: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    return np.maximum(low - pose[:3, 3], pose[:3, 3] - high)


def _moved(pose: np.ndarray, displacement: np.ndarray) -> np.ndarray:
    angle = float(np.linalg.norm(displacement[3:]))
    rotation = np.eye(3)
    if angle > 0:
        x, y, z = displacement[3:] / angle
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        rotation += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    after = pose.copy()
    after[:3, 3] += displacement[:3]
    after[:3, :3] = rotation @ pose[:3, :3]
    return after


def _angle(axis: np.ndarray, direction: tuple[float, float, float]) -> float:
    toward = np.asarray(direction)
    return float(np.arctan2(np.linalg.norm(np.cross(toward, axis)), toward @ axis))
