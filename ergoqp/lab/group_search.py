"""The people of a group, a grid of places for all of them, and a pattern search between.

A pattern search from the best places of a grid to places between them. It minimises the smooth cost
of everybody's rest posture.

The search uses values only. The exact score has no useful gradient. The smooth cost at rest
has one almost everywhere, but S(q) does not give it. S says where the posture goes when the
object moves, but afterwards the person still relaxes toward comfort while the object is at
rest. The derivative of the rest posture changes with every joint that reaches its end. The
worst of several people has kinks where another person becomes the worst. With five unknowns a
pattern search needs some hundred placements.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from numbers import Integral, Real
from typing import Literal

import numpy as np

from ergoqp.arguments import Progress, as_tuple, check_real, check_whole, shown
from ergoqp.errors import InputError
from ergoqp.lab.population import variant
from ergoqp.placing.parallel import in_order
from ergoqp.placing.place import Place, PoseParametrization
from ergoqp.problem.problem import Problem
from ergoqp.rest.batch import settling
from ergoqp.rest.best_place import (
    features,
    outward,
    poses_over,
    workspace_lines,
    workspace_map,
    workspace_poses,
)
from ergoqp.rest.model_person import ModelPerson, person_of, sample_person

MOST = 200
"""Largest size of a group."""


@dataclass(frozen=True)
class GroupPerson:
    """One person of a group.

    Attributes:
        label: name of the person in tables, unique in a group.
        follower: body, weights and comfort.

    Example:
        >>> import ergoqp
        >>> from ergoqp.lab.group_search import GroupPerson
        >>> from ergoqp.rest.model_person import sample_person
        >>> problem = ergoqp.load_problem("screwing")
        >>> anna = GroupPerson("Anna", sample_person(problem, seed=3))
        >>> anna.label, round(anna.stature, 1)
        ('Anna', 1.8)
    """

    label: str
    follower: ModelPerson

    @property
    def stature(self) -> float:
        """Standing height [m]."""
        return self.follower.response.body.stature


def read_people(
    problem: Problem, people: Sequence[float | ModelPerson | GroupPerson]
) -> tuple[GroupPerson, ...]:
    """Return the people of a group.

    A number is the stature [m] of a person with the weights and the comfort of the problem.

    Raises:
        InputError: if the group is empty or larger than `MOST`, or a person has other hands,
            stance, seat height or tool than the problem.
    """
    people = as_tuple("group", people)
    if not 1 <= len(people) <= MOST:
        raise InputError(f"group: got {len(people)} people, allowed 1 to {MOST}")
    return _unique([_person(problem, person) for person in people])


def drawn_people(problem: Problem, count: int, seed: int = 0) -> tuple[GroupPerson, ...]:
    """Return people drawn with the seeds `seed`, `seed` + 1 and so on.

    Each is drawn as in `ergoqp.rest.model_person.sample_person`.

    Raises:
        InputError: if the count is not from 1 to `MOST`, or the seed is negative.
    """
    if isinstance(count, bool) or not (isinstance(count, Integral) and 1 <= count <= MOST):
        raise InputError(f"group: got {count} people, allowed 1 to {MOST}")
    check_whole("seed", seed, 0)
    drawn = ((number, sample_person(problem, number)) for number in range(seed, seed + count))
    return tuple(
        GroupPerson(f"{person.response.body.stature:.2f} m, seed {number}", person)
        for number, person in drawn
    )


def _person(problem: Problem, person: float | ModelPerson | GroupPerson) -> GroupPerson:
    if isinstance(person, ModelPerson):
        person = GroupPerson(f"{person.response.body.stature:.2f} m", person)
    if not isinstance(person, GroupPerson):
        if isinstance(person, bool) or not isinstance(person, Real):
            raise InputError(
                f"group: got a {type(person).__name__}, allowed statures in metres or simulated"
                " people"
            )
        alike = ModelPerson(person_of(variant(problem, stature=float(person))))
        return GroupPerson(f"{float(person):.2f} m", alike)
    model, own = person_of(problem), person.follower.response
    for term in ("hands", "stance", "seat_height", "tool"):
        if getattr(own, term) != getattr(model, term):
            raise InputError(
                f"group: {person.label} has {term} {getattr(own, term)!r}, allowed the problem's"
                f" {getattr(model, term)!r}"
            )
    return person


def _unique(people: list[GroupPerson]) -> tuple[GroupPerson, ...]:
    """Add numbers to labels that occur more than once."""
    labels = [person.label for person in people]
    numbers = [labels[: i + 1].count(label) for i, label in enumerate(labels)]
    return tuple(
        person if number == 1 else replace(person, label=f"{person.label} ({number})")
        for person, number in zip(people, numbers, strict=True)
    )


AXES = ("x", "y", "z", "tilt")
"""The four axes of a grid. A tilt is one of the rotations of the contact frame."""


@dataclass(frozen=True, eq=False)
class SharedGrid:
    """Scores of n people over one grid of poses: x slowest, then y, z, and the tilt fastest.

    Attributes:
        lines: places forward, places to the left, and heights [m].
        tilts: rotations of the contact frame (k, 3, 3).
        scores: exact scores (people, poses), 0 if the person does not reach.
        costs: smooth costs of the same rest postures (people, poses), inf if the person does
            not reach.
        postures: rest postures (people, poses, 32) [rad].
    """

    lines: Sequence[np.ndarray]
    tilts: np.ndarray
    scores: np.ndarray
    costs: np.ndarray
    postures: np.ndarray

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of places along x, y and z, and of tilts."""
        return *map(len, self.lines), len(self.tilts)

    @property
    def poses(self) -> np.ndarray:
        """The poses (n, 4, 4)."""
        return poses_over(self.lines, self.tilts)

    @property
    def reached_by_all(self) -> np.ndarray:
        """Whether everybody reaches a pose (n,)."""
        return np.all(self.scores > 0, axis=0)

    def of(self, number: int) -> SharedGrid:
        """Return the grid of one person."""
        rows = slice(number, number + 1)
        return replace(
            self, scores=self.scores[rows], costs=self.costs[rows], postures=self.postures[rows]
        )

    def with_free(self, axis: str) -> np.ndarray:
        """Return scores (people, remaining poses) if each may choose a place along one of `AXES`.

        A score is 0 if the person reaches none of the places along the axis.
        """
        number = 1 + AXES.index(axis)
        none = np.iinfo(np.int64).max
        scores = np.where(self.scores > 0, self.scores, none).reshape(-1, *self.shape)
        lowest = scores.min(axis=number).reshape(len(self.scores), -1)
        return np.where(lowest < none, lowest, 0)


def shared_grid(
    problem: Problem,
    people: Sequence[GroupPerson],
    spacing: float,
    *,
    jobs: int = 1,
    cache: bool = True,
    progress: Progress | None = None,
) -> SharedGrid:
    """Return the grid of a group.

    The part of each person is kept in the cache, so that a study that was stopped can
    continue.

    Args:
        problem: its workspace and tool axis define where the object can be.
        people: the group.
        spacing: distance of neighbouring places [m].
        jobs: number of processes.
        cache: keep maps, and use those of earlier studies.
        progress: called after every person with the share of the people who are done.

    Raises:
        InputError: if the problem has no workspace or no tool axis, or the spacing is not
            allowed.
    """
    Place.of(problem)  # needs a workspace and a tool axis too
    check_real("spacing", spacing, "metres")
    if not 0.01 <= spacing <= 1.0:
        raise InputError(f"spacing: got {shown(spacing)} m, allowed 0.01 to 1 m")
    calls = [(problem, person.follower, spacing, cache) for person in people]
    parts = in_order(_of_person, calls, jobs, progress)
    lines, tilts = workspace_lines(problem, spacing)
    scores, postures = map(np.stack, zip(*parts, strict=True))
    costs = np.stack([problem.cost(rows) for rows in postures])
    return SharedGrid(lines, tilts, scores, np.where(scores > 0, costs, np.inf), postures)


def _of_person(
    problem: Problem, person: ModelPerson, spacing: float, cache: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return scores (n,) and postures (n, 32) in the order of the grid.

    A map is in the order in which the person settled.
    """
    found = workspace_map(problem, person, spacing=spacing, cache=cache)
    order = outward(person, workspace_poses(problem, spacing))
    scores, postures = np.empty_like(found.scores), np.empty_like(found.postures)
    scores[order], postures[order] = found.scores, found.postures
    return scores, postures


Objective = Literal["minimax", "mean"]

SOFTNESS = 0.25
"""Softness of the largest cost in a group, so that the second largest counts too [points]."""
FINEST = 0.01
"""Shortest step along an axis [m]. Tilts are equally fine relative to their range."""
SEARCH_MOST = 150
"""Longest search from one start, in placements of the object."""


@dataclass(frozen=True)
class Equilibrium:
    """Everybody at rest at one place.

    Attributes:
        point: the place, see `PoseParametrization`.
        scores: exact scores (people,), 0 for a person who does not reach.
        costs: smooth costs (people,), inf for a person who does not reach.
        postures: rest postures (people, 32) [rad].
    """

    point: np.ndarray
    scores: np.ndarray
    costs: np.ndarray
    postures: np.ndarray

    def key(self, objective: Objective) -> tuple[float, ...]:
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
        self.placing = PoseParametrization.of(problem)
        self.placements = 0
        self._features = features(grid.poses)
        self._people = [person.follower for person in people]
        self._comforts = [person.response.comfort for person in self._people]
        pairs = zip(self._people, self._comforts, strict=True)
        self._holds = [(person.stand(q), person.grasp(q)) for person, q in pairs]
        self._settles = [settling(person, SEARCH_MOST) for person in self._people]

    def starts(self, count: int) -> list[np.ndarray]:
        """Return the grid's best places (5,), best first, none within a spacing of a better one."""
        found = keys(self.grid.scores, self.grid.costs, self.objective)
        order = np.lexsort(found.T[::-1])
        poses, chosen = self.grid.poses, []
        lines = [line for line in self.grid.lines if len(line) > 1]
        apart = 1.01 * max((float(line[1] - line[0]) for line in lines), default=0)
        for i in order[found[order, 0] == found[order[0], 0]]:
            if all(np.linalg.norm(poses[i, :3, 3] - poses[j, :3, 3]) > apart for j in chosen):
                chosen.append(i)
                if len(chosen) == count:
                    break
        return [self.placing.point(poses[i]) for i in chosen]

    def at(self, point: np.ndarray) -> Equilibrium:
        """Return everybody at rest at a place, each from the nearest grid place in their reach."""
        self.placements += 1
        pose, seeds = self.placing.pose(point), self._comforts.copy()
        apart = ((self._features - features(pose)) ** 2).sum(axis=1)
        for number, scores in enumerate(self.grid.scores):
            near = np.where(scores > 0, apart, np.inf)
            nearest = int(np.argmin(near))
            if np.isfinite(near[nearest]):
                seeds[number] = self.grid.postures[number, nearest]
        return self._rest(point, seeds)

    def resettled_from_comfort(self, rest: Equilibrium) -> Equilibrium:
        """Return the same place, with people settled again from comfort if that is worse.

        A rest posture can depend on the path to it. A place must be good for both paths.
        """
        other = self._rest(rest.point, self._comforts)
        worse = (other.scores > rest.scores) & (rest.scores > 0)
        return Equilibrium(
            rest.point,
            np.where(worse, other.scores, rest.scores),
            np.where(worse, other.costs, rest.costs),
            np.where(worse[:, None], other.postures, rest.postures),
        )

    def descend(self, start: np.ndarray) -> list[Equilibrium]:
        """Return the best place of a search from a point, and the start itself.

        A step of the pattern changes one of the five numbers. It is accepted if it lowers the
        smooth cost. If no step does, all steps become half as long. The best place is the one
        with the lowest key of all places that were tried.
        """
        here = first = best = self.at(start)
        # Half of the grid's spacing along each number, 0 if it is fixed.
        steps = np.array([*(len(line) - 1 for line in self.grid.lines), 3, 3])
        lengths = 0.5 * (self.placing.upper - self.placing.lower) / np.maximum(steps, 1)
        free = np.flatnonzero(lengths)
        scale = 1.0
        end = self.placements + SEARCH_MOST
        while scale * lengths[:3].max(initial=0.0) >= FINEST or (
            scale > 0.1 and not lengths[:3].any()
        ):
            improved = False
            for number, sign in product(free, (1, -1)):
                point = here.point.copy()
                moved = point[number] + sign * scale * lengths[number]
                point[number] = np.clip(
                    moved, self.placing.lower[number], self.placing.upper[number]
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

    def line(self, point: np.ndarray, number: int, count: int = 9) -> list[Equilibrium]:
        """Return everybody at rest at places along one of the five numbers from a point.

        The places are those where the object may be. The list is empty if the number is fixed.
        """
        low, high = self.placing.lower[number], self.placing.upper[number]
        points = np.tile(point, (count if high - low > 1e-9 else 0, 1))
        points[:, number] = np.linspace(low, high, len(points))
        return [self.at(each) for each in points if self.placing.holds(each)]

    def _merit(self, rest: Equilibrium) -> float:
        return float(merit(rest.costs[:, None], self.objective)[0])

    def _rest(self, point: np.ndarray, seeds: list[np.ndarray]) -> Equilibrium:
        """Return everybody settled at a place, each from one of the postures (32,)."""
        pose, own = self.placing.pose(point), self.problem.own_limits
        settled = [
            settle(seed, pose, grasp, soles)
            for settle, seed, (soles, grasp) in zip(self._settles, seeds, self._holds, strict=True)
        ]
        postures = np.array([posture for posture, _ in settled])
        # A place that one of the user's own limits forbids counts as not reached.
        reached = np.array([there and not own.broken(pose, q) for q, there in settled])
        scores = np.where(reached, self.problem.assess(postures).final, 0)
        costs = np.where(reached, self.problem.cost(postures), np.inf)
        return Equilibrium(point, scores, costs, postures)
