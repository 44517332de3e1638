"""A pattern search from the best places of a grid to places between them.

It minimises the smooth cost of everybody's rest posture.

The search uses values only. The exact score has no useful gradient. The smooth cost at rest
has one almost everywhere, but S(q) does not give it. S says where the posture goes when the
object moves, but afterwards the person still relaxes toward comfort while the object is at
rest. The derivative of the rest posture changes with every joint that reaches its end. The
worst of several people has kinks where another person becomes the worst. With five unknowns a
pattern search needs some hundred placements.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ergoqp.limits import AxisCone, WorkspaceBox
from ergoqp.placing.group.grid import SharedGrid
from ergoqp.placing.group.people import GroupPerson
from ergoqp.problem.problem import Problem
from ergoqp.problem.workspace import frame_of, turn_about

Objective = Literal["minimax", "mean"]
Key = tuple[float, ...]

SOFTNESS = 0.25
"""Softness of the largest cost in a group, so that the second largest counts too [points]."""
FINEST = 0.01
"""Shortest step along an axis [m]. Tilts are equally fine relative to their range."""
MOST = 150
"""Longest search from one start, in placements of the object."""


@dataclass(frozen=True)
class Placing:
    """Poses of the object as five numbers: x, y, z [m], then two turns [rad].

    The turns are about the y and z axes of the cone's middle frame.

    Attributes:
        lower: least value of each (5,).
        upper: greatest value of each (5,); if it equals the least, the number is fixed.
        frame: middle of the cone (3, 3).
        half_angle: half angle of the cone [rad].
    """

    lower: np.ndarray
    upper: np.ndarray
    frame: np.ndarray
    half_angle: float

    @classmethod
    def of(cls, problem: Problem) -> Placing:
        """Return the placing for the workspace, tool axis and movable axes of a problem."""
        box, cone, axes = (
            problem.limit_of(WorkspaceBox),
            problem.limit_of(AxisCone),
            problem.twist_limit.axes,
        )
        half = float(np.radians(cone.half_angle_deg))
        turns = [
            half * any(axis in axes for axis in group) for group in (("rx", "ry"), ("rx", "rz"))
        ]
        ends = np.array([*box.upper, *turns])
        return cls(
            np.array([*box.lower, *(-turn for turn in turns)]),
            ends,
            frame_of(np.asarray(cone.direction)),
            half,
        )

    def pose(self, point: np.ndarray) -> np.ndarray:
        """Return the pose (4, 4) of a point (5,)."""
        pose = np.eye(4)
        pose[:3, 3] = point[:3]
        pose[:3, :3] = self.frame @ turn_about(1, point[3]) @ turn_about(2, point[4])
        return pose

    def point(self, pose: np.ndarray) -> np.ndarray:
        """Return the point (5,) of a pose (4, 4). The rotation about its own x is ignored."""
        x, y, z = self.frame.T @ pose[:3, 0]
        return np.array([*pose[:3, 3], np.arctan2(-z, x), np.arcsin(np.clip(y, -1, 1))])

    def holds(self, point: np.ndarray) -> bool:
        """Return whether a point is in the workspace and its tool axis in the cone."""
        inside = (point >= self.lower - 1e-9).all() and (point <= self.upper + 1e-9).all()
        return bool(
            inside and np.cos(point[3]) * np.cos(point[4]) >= np.cos(self.half_angle) - 1e-9
        )


@dataclass(frozen=True)
class RestAtPlace:
    """Everybody at rest at one place.

    Attributes:
        point: the place, see `Placing`.
        scores: exact scores (people,), 0 for a person who does not reach.
        costs: smooth costs (people,), inf for a person who does not reach.
        postures: rest postures (people, 32) [rad].
    """

    point: np.ndarray
    scores: np.ndarray
    costs: np.ndarray
    postures: np.ndarray

    def key(self, objective: Objective) -> Key:
        """Return the values by which places are compared, the lowest is best; see `keys`."""
        return tuple(keys(self.scores[:, None], self.costs[:, None], objective)[0].tolist())


def keys(scores: np.ndarray, costs: np.ndarray, objective: Objective) -> np.ndarray:
    """Return for every place (n, 4) the values that are compared, from first to last.

    They are the number of people who do not reach, two figures of the scores, and the cost.

    ``"minimax"``: the highest score, then the mean; ``"mean"``: the mean, then the highest. In
    a tie the smooth cost decides, by its soft maximum or mean.

    Args:
        scores: exact scores (people, n), 0 if a person does not reach.
        costs: smooth costs (people, n).
        objective: ``"minimax"`` or ``"mean"``.
    """
    unreached, highest, mean = (scores == 0).sum(axis=0), scores.max(axis=0), scores.mean(axis=0)
    two = (highest, mean) if objective == "minimax" else (mean, highest)
    return np.stack([unreached, *two, merit(costs, objective)], axis=1)


def merit(costs: np.ndarray, objective: Objective) -> np.ndarray:
    """Return one smooth cost per place (n,): the mean or soft maximum of the costs (people, n).

    The soft maximum is s log mean exp(c / s) with s = `SOFTNESS`.
    """
    if objective == "mean":
        return costs.mean(axis=0)
    highest = costs.max(axis=0)
    finite = np.isfinite(highest)
    above = np.where(finite, costs - np.where(finite, highest, 0), 0)
    return highest + SOFTNESS * np.log(np.exp(above / SOFTNESS).mean(axis=0))


class PlaceSearch:
    """The search for one group.

    Args:
        problem: the task.
        people: people who come to rest at every place.
        grid: grid of the same people, in the same order.
        objective: ``"minimax"`` or ``"mean"``.
    """

    def __init__(
        self,
        problem: Problem,
        people: Sequence[GroupPerson],
        grid: SharedGrid,
        objective: Objective,
    ) -> None:
        """Prepare the data that every placement needs."""
        self.problem, self.grid = problem, grid
        self.objective: Objective = objective
        self.placing = Placing.of(problem)
        self.placements = 0
        self._features = _features(grid.poses)
        self._people = [person.follower for person in people]
        comforts = [person.response.comfort for person in self._people]
        self._holds = [
            (p.stand(q), p.grasp(q)) for p, q in zip(self._people, comforts, strict=True)
        ]

    def starts(self, count: int) -> list[np.ndarray]:
        """Return the grid's best places (5,), best first, none within a spacing of a better one."""
        found = keys(self.grid.scores, self.grid.costs, self.objective)
        order = np.lexsort(found.T[::-1])
        poses, chosen = self.grid.poses, []
        apart = 1.01 * max(
            (
                float(line[1] - line[0])
                for line in (self.grid.x, self.grid.y, self.grid.z)
                if len(line) > 1
            ),
            default=0,
        )
        for i in order[found[order, 0] == found[order[0], 0]]:
            if all(np.linalg.norm(poses[i, :3, 3] - poses[j, :3, 3]) > apart for j in chosen):
                chosen.append(i)
                if len(chosen) == count:
                    break
        return [self.placing.point(poses[i]) for i in chosen]

    def at(self, point: np.ndarray) -> RestAtPlace:
        """Return everybody at rest at a place, each from the nearest grid place in their reach."""
        self.placements += 1
        pose = self.placing.pose(point)
        postures, reached = [], []
        apart = ((self._features - _features(pose[None])) ** 2).sum(axis=1)
        for number, (person, (soles, grasp)) in enumerate(
            zip(self._people, self._holds, strict=True)
        ):
            near = np.where(self.grid.scores[number] > 0, apart, np.inf)
            nearest = int(np.argmin(near))
            seed = (
                self.grid.postures[number, nearest]
                if np.isfinite(near[nearest])
                else person.response.comfort
            )
            posture, there = person.settle(seed, pose, grasp, soles)
            postures.append(posture)
            reached.append(there)
        return self._rest(point, np.array(postures), np.array(reached))

    def resettled_from_comfort(self, rest: RestAtPlace) -> RestAtPlace:
        """Return the same place, with people settled again from comfort if that is worse.

        A rest posture can depend on the path to it. A place must be good for both paths.
        """
        pose = self.placing.pose(rest.point)
        postures, reached = [], []
        for person, (soles, grasp) in zip(self._people, self._holds, strict=True):
            posture, there = person.settle(person.response.comfort, pose, grasp, soles)
            postures.append(posture)
            reached.append(there)
        other = self._rest(rest.point, np.array(postures), np.array(reached))
        worse = (other.scores > rest.scores) & (rest.scores > 0)
        return RestAtPlace(
            rest.point,
            np.where(worse, other.scores, rest.scores),
            np.where(worse, other.costs, rest.costs),
            np.where(worse[:, None], other.postures, rest.postures),
        )

    def descend(self, start: np.ndarray) -> list[RestAtPlace]:
        """Return the best place of a search from a point, and the start itself.

        A step of the pattern changes one of the five numbers. It is accepted if it lowers the
        smooth cost. If no step does, all steps become half as long. The best place is the one
        with the lowest key of all places that were tried.
        """
        here = first = best = self.at(start)
        lengths = self._first_lengths()
        free = np.flatnonzero(lengths)
        scale = 1.0
        end = self.placements + MOST
        while scale * lengths[:3].max(initial=0.0) >= FINEST or (
            scale > 0.1 and not lengths[:3].any()
        ):
            improved = False
            for step in [sign * i for i in free + 1 for sign in (1, -1)]:
                point = here.point.copy()
                number = abs(step) - 1
                point[number] = np.clip(
                    point[number] + np.sign(step) * scale * lengths[number],
                    self.placing.lower[number],
                    self.placing.upper[number],
                )
                if self.placements >= end:
                    return [best, first]
                if point[number] == here.point[number] or not self.placing.holds(point):
                    continue
                there = self.at(point)
                best = min(best, there, key=lambda rest: rest.key(self.objective))
                if self._merit(there) < self._merit(here) - 1e-6:
                    here, improved = there, True
            if not improved:
                scale /= 2
        return [best, first]

    def line(self, point: np.ndarray, number: int, count: int = 9) -> list[RestAtPlace]:
        """Return everybody at rest at places along one of the five numbers from a point.

        The places are those where the object may be. The list is empty if the number is fixed.
        """
        low, high = self.placing.lower[number], self.placing.upper[number]
        points = np.tile(point, (count if high - low > 1e-9 else 0, 1))
        points[:, number] = np.linspace(low, high, len(points))
        return [self.at(each) for each in points if self.placing.holds(each)]

    def _first_lengths(self) -> np.ndarray:
        """Return half of the grid's spacing along each number, 0 if it is fixed (5,)."""
        wide = self.placing.upper - self.placing.lower
        places = [len(self.grid.x), len(self.grid.y), len(self.grid.z), 4, 4]
        return np.array(
            [0.5 * width / max(count - 1, 1) for width, count in zip(wide, places, strict=True)]
        )

    def _merit(self, rest: RestAtPlace) -> float:
        return float(merit(rest.costs[:, None], self.objective)[0])

    def _rest(self, point: np.ndarray, postures: np.ndarray, reached: np.ndarray) -> RestAtPlace:
        pose, own = self.placing.pose(point), self.problem.own_limits
        # A place that one of the user's own limits forbids counts as not reached.
        reached = reached & np.array([not own.broken(pose, posture) for posture in postures])
        scores = np.where(reached, self.problem.assess(postures).final, 0)
        return RestAtPlace(
            point, scores, np.where(reached, self.problem.cost(postures), np.inf), postures
        )


def _features(poses: np.ndarray) -> np.ndarray:
    # As in the maps, a quarter turn counts as much as 30 cm.
    return np.concatenate([poses[:, :3, 3], 0.2 * poses[:, :3, 0]], axis=1)
