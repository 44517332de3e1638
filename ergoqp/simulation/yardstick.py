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
from ergoqp.joints import JOINTS
from ergoqp.problem.problem import Problem
from ergoqp.problem.workspace import Workspace
from ergoqp.simulation.people.person import Holding

NOISE_DEG = 2.0
"""Among places of one exact score the one is searched around whose score is the surest [deg]."""

_STEPS = (0.25, 0.12, 0.06)
"""Steps of the search, as shares of the workspace and of the cone."""


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
