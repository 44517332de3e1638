"""The best fixed place of the object for a group of people, for the design of a workplace.

Everybody is put to rest at the same places: first on a grid over the workspace, then in a
pattern search from its best places (`ergoqp.lab.group_search`). The exact score of each
person's rest posture counts. A place that somebody cannot reach is not a place for the group.
The result also says what the group pays: each person relative to their own best place, and
relative to a place that could be adjusted along one axis.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np

from ergoqp._version import __version__
from ergoqp.arguments import Progress, check_whole, check_word, part_of, unseen
from ergoqp.errors import InputError
from ergoqp.expressions import pose_as_dict
from ergoqp.files.atomic import atomic_write, write_json
from ergoqp.human import Body
from ergoqp.lab.group_search import (
    AXES,
    Equilibrium,
    GroupPerson,
    Objective,
    PlaceSearch,
    SharedGrid,
    read_people,
    shared_grid,
)
from ergoqp.placing.parallel import in_order
from ergoqp.problem.problem import Problem
from ergoqp.rest.model_person import ModelPerson, person_of


@dataclass(frozen=True, eq=False)
class Member:
    """One person of a group, at the place of the group and at their own best place.

    Attributes:
        label: name of the person.
        body: body of the person.
        reba: exact score at the place of the group.
        cost: smooth cost there [points].
        posture: rest posture there (32,) [rad].
        base_pose: pelvis in the world there (4, 4) [m].
        segments: score of every segment there.
        reasons: sentences that explain the score.
        own_reba: exact score at the best place that was found for this person alone.
        own_pose: pose of the object there (4, 4) [m].
        reach: share of the grid's poses that the person reaches.

    Example:
        >>> import ergoqp
        >>> from ergoqp.lab.group import best_for_group
        >>> problem = ergoqp.load_problem("screwing")
        >>> best = best_for_group(problem, [1.75], spacing=0.5, starts=1, cache=False)
        >>> [first] = best.members
        >>> first.posture.shape, first.pays == first.reba - first.own_reba
        ((32,), True)
    """

    label: str
    body: Body
    reba: int
    cost: float
    posture: np.ndarray
    base_pose: np.ndarray
    segments: dict[str, int]
    reasons: list[str]
    own_reba: int
    own_pose: np.ndarray
    reach: float

    @property
    def pays(self) -> int:
        """Points above the score at the person's own best place."""
        return self.reba - self.own_reba


@dataclass(frozen=True, eq=False)
class GroupOptimum:
    """The best fixed place for a group.

    Attributes:
        problem: name of the problem.
        title: the problem in a few words, for people.
        objective: ``"minimax"`` or ``"mean"``.
        pose: pose of the object's contact frame (4, 4) [m], the same for everybody.
        members: the people, in the given order.
        grid: scores of everybody over the grid, in the same order.
        spacing: spacing of the grid [m].
        grid_pose: best pose of the grid (4, 4) [m].
        grid_reba: exact scores of the people there (p,) [points].
        free: highest and mean exact score [points] if everybody could set one thing for
            themselves, by its name. The first name is ``"none"``: everything is fixed. The
            score is the better of the grid's and that of moving from the place of the group.
        placements: how many times the whole group was put to rest beyond the grid.
        seconds: computation time, without results from the cache [s].
        seated: whether the people sit.
        assumptions: sentences on what was assumed.

    Example:
        >>> import ergoqp
        >>> from ergoqp.lab.group import best_for_group
        >>> problem = ergoqp.load_problem("screwing")
        >>> best = best_for_group(problem, [1.75], spacing=0.5, starts=1, cache=False)
        >>> best.mean <= best.maximum, best.mean >= best.own_mean
        (True, True)
    """

    problem: str
    title: str
    objective: Objective
    pose: np.ndarray
    members: tuple[Member, ...]
    grid: SharedGrid
    spacing: float
    grid_pose: np.ndarray
    grid_reba: np.ndarray
    free: dict[str, tuple[int, float]]
    placements: int
    seconds: float
    seated: bool
    assumptions: tuple[str, ...]

    @property
    def maximum(self) -> int:
        """Highest exact score of the group at its place."""
        return max(member.reba for member in self.members)

    @property
    def mean(self) -> float:
        """Mean exact score of the group at its place."""
        return float(np.mean([member.reba for member in self.members]))

    @property
    def own_mean(self) -> float:
        """Mean exact score if each had their own best place."""
        return float(np.mean([member.own_reba for member in self.members]))

    def __repr__(self) -> str:
        """Return the result in one line."""
        x, y, z = self.pose[:3, 3]
        return (
            f"GroupOptimum({self.problem!r}, {self.objective}: {len(self.members)} people, highest"
            f" {self.maximum}, mean {self.mean:.2f} with the object at ({x:z.2f}, {y:z.2f},"
            f" {z:z.2f}) m)"
        )

    def save(self, folder: str | Path) -> Path:
        """Write ``group.json`` and ``group.npz``, and return the path of the first.

        The files are described in ``docs/group_json.md``.

        Raises:
            OSError: if the files cannot be written.
        """
        folder, grid = Path(folder), self.grid
        folder.mkdir(parents=True, exist_ok=True)
        with atomic_write(folder / "group.npz") as scratch:
            np.savez_compressed(
                scratch,
                allow_pickle=False,
                pose=self.pose,
                postures=np.array([member.posture for member in self.members]),
                labels=np.array([member.label for member in self.members], dtype=np.str_),
                **dict(zip("xyz", grid.lines, strict=True)),
                tilts=grid.tilts,
                scores=grid.scores.reshape(-1, *grid.shape),
            )
        path = folder / "group.json"
        write_json(path, summary_of_group(self))
        return path


def summary_of_group(found: GroupOptimum) -> dict[str, Any]:
    """Return the contents of ``group.json``: numbers, texts, lists and dicts."""
    return {
        "version": __version__,
        "problem": found.problem,
        "title": found.title,
        "objective": found.objective,
        "people": len(found.members),
        **_place("", found.pose),
        "maximum": found.maximum,
        "mean": round(found.mean, 6),
        "own_mean": round(found.own_mean, 6),
        "grid_maximum": int(found.grid_reba.max()),
        "grid_mean": round(float(found.grid_reba.mean()), 6),
        "grid_spacing_m": found.spacing,
        "free": {
            axis: {"maximum": highest, "mean": round(mean, 6)}
            for axis, (highest, mean) in found.free.items()
        },
        "placements": found.placements,
        "seconds": round(found.seconds, 3),
        "members": [_member(member) for member in found.members],
        "assumptions": list(found.assumptions),
    }


def _member(member: Member) -> dict[str, Any]:
    return {
        "label": member.label,
        "stature_m": round(member.body.stature, 6),
        "reba": member.reba,
        "cost": round(member.cost, 6),
        "own_reba": member.own_reba,
        "pays": member.pays,
        "reach": round(member.reach, 6),
        "segments": member.segments,
        "reasons": member.reasons,
        **_place("own_", member.own_pose),
    }


def _place(prefix: str, pose: np.ndarray) -> dict[str, list[float]]:
    digits = {"position_m": 6, "quaternion_xyzw": 9}
    return {
        f"{prefix}{name}": np.round(values, digits[name]).tolist()
        for name, values in pose_as_dict(pose).items()
    }


SPACING = 0.15
"""Distance of neighbouring places of the grid [m]. The search continues between them."""
STARTS = 4
"""Number of places of the grid from which the search continues."""
MOST_STARTS = 100
"""A larger number of starts is taken for a mistake."""
OWN_STARTS = 2
"""The same number for the best place of one person."""

_NUMBERS = dict(zip(AXES, ((0,), (1,), (2,), (3, 4)), strict=True))
"""Numbers of a point that belong to each axis of the grid."""
_SHARES = (0.6, 0.85)  # share of the work that is done after the grid, and after the search


def best_for_group(
    problem: Problem,
    people: Sequence[float | ModelPerson | GroupPerson],
    objective: Objective = "minimax",
    *,
    spacing: float = SPACING,
    starts: int = STARTS,
    jobs: int = 1,
    cache: bool = True,
    progress: Progress | None = None,
) -> GroupOptimum:
    """Find the best fixed place of the object for a group.

    Args:
        problem: the task, with a workspace and a tool axis.
        people: statures [m], simulated people, or the result of
            `ergoqp.lab.group_search.drawn_people`.
        objective: ``"minimax"``: the highest exact score, then the mean; ``"mean"``: the mean,
            then the highest. In a tie the smooth cost decides.
        spacing: spacing of the grid [m].
        starts: number of places of the grid from which the search continues.
        jobs: number of processes; the result does not depend on it.
        cache: keep the grid of every person, and use earlier ones, so that a study that was
            stopped can continue.
        progress: called with the share that is done.

    Raises:
        InputError: if an argument is not usable, or no place is reached by everybody; the
            message names who does not reach.
        MissingExtraError: if joblib is not installed and more than one process is needed.

    Example:
        >>> import ergoqp
        >>> from ergoqp.lab.group import best_for_group
        >>> problem = ergoqp.load_problem("screwing")
        >>> best = best_for_group(problem, [1.60, 1.80], spacing=0.5, starts=1, cache=False)
        >>> best.pose.shape, [member.label for member in best.members]
        ((4, 4), ['1.60 m', '1.80 m'])
    """
    check_word("objective", objective, get_args(Objective))
    check_whole("starts", starts, 1, MOST_STARTS)
    begin = time.perf_counter()
    crew = read_people(problem, people)
    tell = progress or unseen
    told = part_of(tell, 0.0, _SHARES[0])
    grid = shared_grid(problem, crew, spacing, jobs=jobs, cache=cache, progress=told)
    _refuse_unreached(crew, grid)
    search = PlaceSearch(problem, crew, grid, objective)
    points = search.starts(starts)
    # Each part builds the equations of everybody again, so there are as many as processes.
    parts = np.array_split(points, len(points) if jobs == 1 else min(jobs, len(points)))
    calls = [(problem, crew, grid, objective, part) for part in parts]
    searched = in_order(_from_starts, calls, jobs, part_of(tell, *_SHARES))
    found = [rest for rests, _ in searched for rest in rests]
    best = min(found, key=lambda rest: rest.key(objective))
    calls = [(problem, crew, grid, number, best.point) for number in range(len(crew))]
    own = in_order(_own_best, calls, jobs, part_of(tell, _SHARES[1], 1.0))
    # The first start is the best place of the grid itself, and every search also returns its
    # start.
    on_grid = min(found[1::2], key=lambda rest: rest.key(objective))
    return GroupOptimum(
        problem=problem.name,
        title=problem.title or problem.name,
        objective=objective,
        pose=search.placing.pose(best.point),
        members=_members(search, crew, best, own),
        grid=grid,
        spacing=spacing,
        grid_pose=search.placing.pose(on_grid.point),
        grid_reba=on_grid.scores,
        free=_free(search, best),
        placements=sum(used for _, used in searched),
        seconds=time.perf_counter() - begin,
        seated=bool(problem.task.get("seated", False)),
        assumptions=_assumptions(problem),
    )


def _from_starts(
    problem: Problem,
    people: Sequence[GroupPerson],
    grid: SharedGrid,
    objective: Objective,
    points: np.ndarray,
) -> tuple[list[Equilibrium], int]:
    """Return the results of the search from every point, each followed by its start.

    The second value is the number of placements.

    Every result is also checked with the people coming from comfort.
    """
    search = PlaceSearch(problem, people, grid, objective)
    rests = [
        search.resettled_from_comfort(rest) for point in points for rest in search.descend(point)
    ]
    return rests, search.placements


def _own_best(
    problem: Problem,
    people: Sequence[GroupPerson],
    grid: SharedGrid,
    number: int,
    group_point: np.ndarray,
) -> Equilibrium:
    """Return one person's best place. The place of the group is one of the candidates."""
    search = PlaceSearch(problem, people[number : number + 1], grid.of(number), "mean")
    found = [search.at(group_point)]
    for point in search.starts(OWN_STARTS):
        found += search.descend(point)
    return min(
        (search.resettled_from_comfort(rest) for rest in found), key=lambda rest: rest.key("mean")
    )


def _refuse_unreached(people: Sequence[GroupPerson], grid: SharedGrid) -> None:
    """Raise an error if no place is reached by everybody.

    Raises:
        InputError: naming who does not reach the place that most people reach.
    """
    if grid.reached_by_all.any():
        return
    labels = np.array([person.label for person in people])
    nowhere = labels[~grid.scores.any(axis=1)].tolist()
    if nowhere:
        raise InputError(
            f"group: {', '.join(nowhere)} cannot reach any place of the workspace that the limits"
            " allow; move it, or leave them out"
        )
    there = int(np.argmax((grid.scores > 0).sum(axis=0)))
    left = labels[grid.scores[:, there] == 0].tolist()
    raise InputError(
        f"group: no place is reached by all; where most can reach, {', '.join(left)} cannot;"
        " enlarge the workspace"
    )


def _members(
    search: PlaceSearch, people: Sequence[GroupPerson], rest: Equilibrium, own: list[Equilibrium]
) -> tuple[Member, ...]:
    assessment = search.problem.assess(rest.postures)
    return tuple(
        Member(
            label=person.label,
            body=person.follower.response.body,
            reba=int(rest.scores[i]),
            cost=float(rest.costs[i]),
            posture=rest.postures[i],
            base_pose=person.follower.contact(rest.postures[i])[1],
            segments={name: int(scores[i]) for name, scores in assessment.segments.items()},
            reasons=assessment.reasons(i),
            own_reba=int(alone.scores[0]),
            own_pose=search.placing.pose(alone.point),
            reach=float((search.grid.scores[i] > 0).mean()),
        )
        for i, (person, alone) in enumerate(zip(people, own, strict=True))
    )


def _free(search: PlaceSearch, best: Equilibrium) -> dict[str, tuple[int, float]]:
    """Return the highest and the mean score for every axis that everybody could set themselves."""
    grid, objective = search.grid, search.objective
    found = {"none": (int(best.scores.max()), float(best.scores.mean()))}
    for axis, numbers in _NUMBERS.items():
        # Everybody has at most the score at the group's place. Along the axis from there it
        # may be lower.
        here = best.scores.copy()
        moves = [rest for number in numbers for rest in search.line(best.point, number)]
        if not moves:
            continue
        for rest in moves:
            here = np.where(rest.scores > 0, np.minimum(here, rest.scores), here)
        on_grid = grid.with_free(axis)
        scores = np.column_stack([here, on_grid[:, (on_grid > 0).all(axis=0)]])
        two = np.stack([scores.max(axis=0), scores.mean(axis=0)])
        order = np.lexsort(two[::-1] if objective == "minimax" else two)
        found[axis] = (int(two[0, order[0]]), float(two[1, order[0]]))
    return found


def _assumptions(problem: Problem) -> tuple[str, ...]:
    model = person_of(problem)
    where = "stands on the same spot"
    if model.stance == "seated":
        own = "that is fitted to each of them"
        seat = f"on a seat {own if model.seat_height is None else f'of {model.seat_height:.2f} m'}"
        where = f"sits on the same spot, {seat}"
    return (
        f"Everybody {where}, facing the same way. This spot is the origin of the world.",
        (
            "Everybody holds the object as stated in the problem and comes to rest by contact,"
            " joint ranges and comfort. People given by stature have the problem's joint weights."
        ),
        (
            "The object is level: it is tilted about its y and z, and not turned about the tool's"
            " axis."
        ),
    )
