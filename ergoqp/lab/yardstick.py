"""The yardstick of closed loops: the best place that exists for a person and a start.

A place counts if the object is carried to it straight from the start. Its score is the exact
score of the person's own undisturbed rest there. Places are spread evenly over the workspace.
Then the neighbourhoods of the best are searched, by the person's own rests. Known places from
elsewhere may be added. No controller is involved, so the yardstick can be computed before any
controller runs.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.joints import JOINTS
from ergoqp.problem.geometry import Workspace
from ergoqp.problem.problem import Problem
from ergoqp.rest.person import Holding

NOISE_DEG = 2.0
"""Width of the smooth score that ranks places with equal exact scores [deg]."""

_STEPS = (0.25, 0.12, 0.06)
"""Steps of the search, as shares of the workspace and of the cone."""


@dataclass(frozen=True)
class Place:
    """A place that the object was carried to, and how the person rests there.

    Attributes:
        pose: pose of the object (4, 4) [m].
        score: exact score of the person's rest, 0 if the place is not reached.
        value: smooth score of the rest at `NOISE_DEG`; infinite if the place is not reached.
        posture: posture at rest (32,) [rad].
    """

    pose: np.ndarray
    score: int
    value: float
    posture: np.ndarray

    @property
    def rank(self) -> tuple[float, float]:
        """Sort key of the place; lower is better."""
        return (self.score or np.inf, self.value)


class Judge:
    """Scores places for one problem.

    Args:
        problem: the problem with the sheet and the limits.
    """

    def __init__(self, problem: Problem) -> None:
        """Prepare the smooth score."""
        self.problem, self.workspace = problem, Workspace(problem)
        self._smooth = SmoothReba((NOISE_DEG,), (1.0,), problem.method, **problem.task)

    def score(self, posture: np.ndarray) -> int:
        """Return the exact score of a posture (32,) [rad]."""
        return int(self.problem.assess(posture).final[0])

    def carried(self, start: Holding, pose: np.ndarray) -> Place:
        """Return the result of carrying the object straight to a pose (4, 4)."""
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
        """Return all places that were tried from a start, the best first.

        Args:
            start: start of all straight paths.
            known: further poses (4, 4) to try.
            places: number of places that are spread over the workspace.
            around: number of the best places whose neighbourhoods are searched.
            enough: score at which the search ends; None: that of standing at ease with hanging
                arms, the lowest for any work.
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
        """Return the places that were tried around one place, continuing from the best so far."""
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
