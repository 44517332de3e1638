"""The best that there is for a person and a start: the yardstick for whoever moves the object.

A place counts that the object is carried to straight from the start, with the person's own rest
there, undisturbed, and its exact score. Places are spread evenly over the workspace; the best of
them are then searched around, by the person's own rests; places that others know may be added. No
controller has a part in it, so that it can be kept before any is looked at.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.errors import InputError
from ergoqp.joints import JOINTS
from ergoqp.limits import AXES, AxisCone, WorkspaceBox
from ergoqp.problem.problem import Problem
from ergoqp.simulation.best_place import frame_of, turn_about
from ergoqp.simulation.people.person import Holding

NOISE_DEG = 2.0
"""Among places of one exact score the one is searched around whose score is the surest [deg]."""

_STEPS = (0.25, 0.12, 0.06)
"""Steps of the search, as shares of the workspace and of the cone."""

_PRIMES = (2, 3, 5, 7, 11)
_TILT = 0.9
"""Largest tilt of places, as a share of the cone's half angle."""


@dataclass(frozen=True)
class Place:
    """Where the object was carried to, and how the person rests there.

    Attributes:
        pose: of the object (4, 4) [m].
        score: exact score of the person's rest, 0 where it is not reached.
        value: its smooth score at `NOISE_DEG`; infinite where it is not reached.
        posture: at rest (32,) [rad].
    """

    pose: np.ndarray
    score: int
    value: float
    posture: np.ndarray

    @property
    def rank(self) -> tuple[float, float]:
        """What is lower is better."""
        return (self.score or np.inf, self.value)


class Workspace:
    """Poses that a problem allows, as points of a cube.

    Args:
        problem: with a workspace and a tool axis.

    Raises:
        InputError: if it has not both.
    """

    def __init__(self, problem: Problem) -> None:
        """Read the limits."""
        box, cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
        if box is None or cone is None:
            missing = "workspace" if box is None else "tool_axis"
            raise InputError(
                f"problem {problem.name}: got no limits.{missing}, allowed both limits.workspace"
                " and limits.tool_axis where places are looked for"
            )
        self._lower, self._upper = np.asarray(box.lower), np.asarray(box.upper)
        self._middle, self._half = (
            frame_of(np.asarray(cone.direction)),
            np.radians(cone.half_angle_deg) * _TILT,
        )
        axes = problem.twist_limit.axes
        turns = [("rx" in axes or axis in axes) for axis in ("ry", "rz")]
        self.moves = np.array([*(self._upper > self._lower + 1e-9), *turns])
        self.moves[:3] &= [axis in axes for axis in AXES[:3]]

    def pose(self, point: np.ndarray) -> np.ndarray:
        """Return the pose (4, 4) of a point (5,) of the cube from -1 to 1."""
        point = np.where(self.moves, point, 0.0)
        tilt = point[3:] / max(1.0, float(np.linalg.norm(point[3:]))) * self._half
        pose = np.eye(4)
        pose[:3, 3] = (self._lower + self._upper) / 2 + point[:3] * (self._upper - self._lower) / 2
        pose[:3, :3] = self._middle @ turn_about(1, tilt[0]) @ turn_about(2, tilt[1])
        return pose

    def spread(self, count: int) -> np.ndarray:
        """Return points (n, 5) spread evenly over the cube: Halton's sequence."""
        numbers = range(1, count + 1)
        return np.array([[2 * _mirrored(n, prime) - 1 for prime in _PRIMES] for n in numbers])


class Judge:
    """Scores places for one problem.

    Args:
        problem: whose sheet and limits hold.
    """

    def __init__(self, problem: Problem) -> None:
        """Prepare the smooth score."""
        self.problem, self.workspace = problem, Workspace(problem)
        self._smooth = SmoothReba((NOISE_DEG,), (1.0,), problem.method, **problem.task)

    def score(self, posture: np.ndarray) -> int:
        """Return the exact score of a posture (32,) [rad]."""
        return int(self.problem.assess(posture).final[0])

    def carried(self, start: Holding, pose: np.ndarray) -> Place:
        """Return what becomes of a person when the object is carried straight to a pose (4, 4)."""
        person = start.copy()
        reached = person.carry(pose)
        posture = person.posture
        if not reached or self.problem.own_limits.broken(pose, posture):
            return Place(pose, 0, np.inf, posture)
        return Place(pose, self.score(posture), float(self._smooth(posture)[0]), posture)

    def best(
        self,
        start: Holding,
        known: Iterable[np.ndarray] = (),
        *,
        places: int = 48,
        around: int = 3,
        enough: int | None = None,
    ) -> list[Place]:
        """Return all places that were looked at from a start, the best first.

        Args:
            start: of every straight way.
            known: poses (4, 4) to look at as well.
            places: how many are spread over the workspace.
            around: how many of the best are searched around.
            enough: nothing more is looked for at this score; None: at that of standing at ease
                with the arms hanging, which no work is below.
        """
        if enough is None:
            enough = self.score(np.zeros(len(JOINTS)))
        found: list[Place] = []
        points: list[np.ndarray | None] = []
        spread = self.workspace.spread(places)
        asked = [(self.workspace.pose(point), point) for point in spread]
        for pose, point in [*((each, None) for each in known), *asked]:
            found.append(self.carried(start, pose))
            points.append(point)
            if 0 < found[-1].score <= enough:
                return _ranked(found)
        starts = [i for i in np.argsort([each.rank[1] for each in found]) if points[i] is not None]
        by_score = sorted(starts, key=lambda i: found[i].rank)[:around]
        for number in by_score:
            point = points[number]
            if found[number].score and point is not None:
                found += self._searched(start, point, found[number], enough)
        return _ranked(found)

    def _searched(
        self, start: Holding, point: np.ndarray, place: Place, enough: int
    ) -> Sequence[Place]:
        """Return the places looked at around one, going on from the best so far."""
        looked: list[Place] = []
        for step in _STEPS:
            for axis in np.flatnonzero(self.workspace.moves):
                for way in (-step, step):
                    beside = point.copy()
                    beside[axis] = np.clip(point[axis] + way, -1.0, 1.0)
                    looked.append(self.carried(start, self.workspace.pose(beside)))
                    if looked[-1].rank < place.rank:
                        place, point = looked[-1], beside
                    if 0 < place.score <= enough:
                        return looked
        return looked


def _ranked(places: Sequence[Place]) -> list[Place]:
    return sorted(places, key=lambda place: place.rank)


def _mirrored(number: int, base: int) -> float:
    """Return a whole number's digits behind the point, in reverse."""
    value, share = 0.0, 1.0
    while number:
        share /= base
        value += share * (number % base)
        number //= base
    return value
