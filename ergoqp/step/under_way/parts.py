"""The motion under way as one vector: its parts in a problem, and how limits read them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ergoqp.limits import Limit
from ergoqp.problem.problem import Problem


@dataclass(frozen=True)
class Way:
    """The motion under way, for `ergoqp.limits.Situation`.

    Attributes:
        ahead: displacement (6,) [m, rad].
        lost: parts of the distances to the (lower, upper) ends that do not count, by hard limit.
        turn: angle that the robot may have done already, plus the error of its measured angle
            [rad]. None: zero.
        stray: largest angle between the motion under way and a straight line [rad]. None: no row
            bends.
        raised: largest angle that a rising mean adds [rad]. None: no row bends.
        lost_held: as `lost`, if the robot holds once what is under way (where declared).
        turn_held: as `turn`, for the same case.
    """

    ahead: Any
    lost: dict[str, tuple[Any, Any]]
    turn: Any
    stray: Any
    raised: Any
    lost_held: dict[str, tuple[Any, Any]]
    turn_held: Any


@dataclass(frozen=True)
class WayLayout:
    """The parts of the vector ``way``.

    Attributes:
        limits: limits of the object side.
        count: number of their rows that lose a part of their distance: all or none.
        turns: whether the angle of the object may differ from that of the landing pose.
        strays: whether the motion under way can turn about more than one axis, and a row bends.
        holds: whether the robot may hold once what is under way.
    """

    limits: Sequence[Limit]
    count: int
    turns: bool
    strays: bool
    holds: bool

    @classmethod
    def of(cls, problem: Problem) -> WayLayout:
        """Return the parts of a problem."""
        robot, hard = problem.robot, tuple(limit for limit in problem.row_limits if limit.hard)
        # Where a pose is moved, it may be unknown in part.
        count = sum(len(limit.names) for limit in hard) if problem.moves_pose else 0
        turns = robot.owes or bool(robot.pose_noise_deg)
        strays = problem.average > 0 and any(_bend(limit) for limit in hard)
        return cls(hard, count, turns, strays, robot.longest_hold > 0)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the rows of the object side."""
        return tuple(name for limit in self.limits for name in limit.names)

    @property
    def bends(self) -> list[bool]:
        """Whether each of these rows bends."""
        return [_bend(limit) for limit in self.limits for _ in limit.names]

    @property
    def tangents(self) -> list[bool]:
        """Whether the direction of each of these rows depends on the measured pose."""
        return [getattr(limit, "tangent", False) for limit in self.limits for _ in limit.names]

    @property
    def _sizes(self) -> list[int]:
        """Sizes of the parts, in the order of `Way`."""
        if not self.count:
            return [6]
        bent = [1] * (self.turns + 2 * self.strays)
        held = [self.count, self.count, 1] if self.holds else []
        return [6, self.count, self.count, *bent, *held]

    @property
    def size(self) -> int:
        """Number of all entries."""
        return sum(self._sizes)

    def split(self, way: Any) -> Way:
        """Return the parts of a vector (size,)."""
        ends = np.cumsum([0, *self._sizes]).tolist()
        ahead, *parts = (way[start:end] for start, end in pairwise(ends))
        if not parts:
            return Way(ahead, {}, None, None, None, {}, None)
        bent, lost = iter(parts[2:]), self._by_limit(*parts[:2])
        given = (self.turns, self.strays, self.strays)
        turn, stray, raised = (next(bent) if there else None for there in given)
        if not self.holds:
            return Way(ahead, lost, turn, stray, raised, lost, turn)
        return Way(ahead, lost, turn, stray, raised, self._by_limit(*parts[-3:-1]), parts[-1])

    def _by_limit(self, below: Any, above: Any) -> dict[str, tuple[Any, Any]]:
        found, start = {}, 0
        for limit in self.limits:
            end = start + len(limit.names)
            found[limit.names[0]] = below[start:end], above[start:end]
            start = end
        return found


def _bend(limit: Limit) -> bool:
    return bool(getattr(limit, "bend", 0.0))
