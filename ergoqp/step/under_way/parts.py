"""What is under way as one vector: which parts it has in a problem, and how limits read them."""

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
    """What is under way, for `ergoqp.limits.Situation`.

    Attributes:
        ahead: displacement (6,) [m, rad].
        lost: what cannot be counted on of the distance to the (lower, upper) ends, by hard limit.
        turn: angle that a robot may have done already, and by which its pose may be mistaken [rad];
            None: there is none.
        stray: by which angle it leaves the straight line at most [rad]; None: no row bends.
        raised: which angle a mean that rises adds at most [rad]; None: no row bends.
        lost_held: as `lost`, where the robot holds on once with what is under way, if that is
            declared.
        turn_held: and as `turn`.
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
    """Which parts the vector ``way`` has.

    Attributes:
        limits: those on the object side.
        count: how many of their rows have less than their distance to count on: all, or none.
        turns: whether the object may be turned otherwise than it lands.
        strays: whether the way under way can turn it about more than one axis, and a row bends.
        holds: whether the robot may hold on once with what is under way.
    """

    limits: Sequence[Limit]
    count: int
    turns: bool
    strays: bool
    holds: bool

    @classmethod
    def of(cls, problem: Problem) -> WayLayout:
        """Return the parts for a problem."""
        robot, hard = problem.robot, tuple(limit for limit in problem.row_limits if limit.hard)
        uncounted = problem.average or robot.owes or robot.noise.any() or robot.longest_hold
        count = sum(len(limit.names) for limit in hard) if uncounted else 0
        turns = robot.owes or bool(robot.pose_noise_deg)
        strays = problem.average > 0 and any(_bend(limit) for limit in hard)
        return cls(hard, count, turns, strays, robot.longest_hold > 0)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the rows on the object side."""
        return tuple(name for limit in self.limits for name in limit.names)

    @property
    def bends(self) -> list[bool]:
        """Whether each of them bends."""
        return [_bend(limit) for limit in self.limits for _ in limit.names]

    @property
    def tangents(self) -> list[bool]:
        """Whether the direction of each of them is read off the pose."""
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
        """How many numbers there are in all."""
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
