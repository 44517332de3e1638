"""How far an object in a region to keep out of is from a place outside, in plain numpy.

It shares no code with the step, which leads the object out by `ergoqp.limits.way_out`. That file
says what a way is.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any, Final

import numpy as np

from ergoqp.limits import Ball, Box, HalfSpace, KeepOut, WorkspaceBox
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
        radius: of a ball, or 0 [m].
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
        radius = max(self.radius + wider, 0.0) if self.radius else 0.0
        return _Solid(self.normals, self.offsets + along + wider, centre, radius, self.spared)

    def depth(self, place: np.ndarray) -> float:
        """How deep a place (3,) is inside [m]; negative outside."""
        if self.radius:
            return self.radius - float(np.linalg.norm(place - self.centre))
        return float((self.offsets - self.normals @ place).min(initial=np.inf))

    def crossed(self, place: np.ndarray, ways: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return where straight ways (n, 3) enter and leave (n,), none: enter after they leave."""
        if self.radius:
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
    region = limit.region if type(limit) is KeepOut else None
    if type(region) not in (HalfSpace, Ball, Box):
        return None
    spared, nowhere = limit.tolerance + noise, np.zeros(3)
    match region:
        case HalfSpace(normal, offset):
            return _Solid(np.array([normal]), np.array([offset]), nowhere, 0.0, spared)
        case Ball(centre, radius):
            return _Solid(np.zeros((0, 3)), np.zeros(0), np.array(centre), radius, spared)
        case Box(lower, upper):
            faces = np.concatenate([np.eye(3), -np.eye(3)])
            offsets = np.concatenate([upper, np.negative(lower)])
            return _Solid(faces, offsets, nowhere, 0.0, spared)
    return None
