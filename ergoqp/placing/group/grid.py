"""A grid of places for a whole group, with the exact score of each person's rest at each place."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ergoqp.arguments import check_real, shown
from ergoqp.errors import InputError
from ergoqp.limits import AxisCone, WorkspaceBox
from ergoqp.placing.group.people import GroupPerson
from ergoqp.placing.parallel import in_order
from ergoqp.problem.problem import Problem
from ergoqp.simulation.best_place import outward, workspace_lines, workspace_map, workspace_poses
from ergoqp.simulation.people.alike import Alike

AXES = ("x", "y", "z", "tilt")
"""The four axes of a grid. A tilt is one of the rotations of the contact frame."""


@dataclass(frozen=True, eq=False)
class SharedGrid:
    """Scores of n people over one grid of poses: x slowest, then y, z, and the tilt fastest.

    Attributes:
        x: places forward [m].
        y: places to the left [m].
        z: heights [m].
        tilts: rotations of the contact frame (k, 3, 3).
        scores: exact scores (people, poses), 0 if the person does not reach.
        costs: smooth costs of the same rest postures (people, poses), inf if the person does
            not reach.
        postures: rest postures (people, poses, 32) [rad].
    """

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    tilts: np.ndarray
    scores: np.ndarray
    costs: np.ndarray
    postures: np.ndarray

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Number of places along x, y and z, and of tilts."""
        return len(self.x), len(self.y), len(self.z), len(self.tilts)

    @property
    def poses(self) -> np.ndarray:
        """The poses (n, 4, 4)."""
        places = np.stack(np.meshgrid(self.x, self.y, self.z, indexing="ij"), axis=-1).reshape(
            -1, 3
        )
        poses = np.tile(np.eye(4), (len(places), len(self.tilts), 1, 1))
        poses[..., :3, 3], poses[..., :3, :3] = places[:, None], self.tilts
        return poses.reshape(-1, 4, 4)

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
        scores = (
            np.where(self.scores > 0, self.scores, np.iinfo(np.int64).max)
            .reshape(-1, *self.shape)
            .min(axis=number)
        )
        return np.where(scores < np.iinfo(np.int64).max, scores, 0).reshape(len(self.scores), -1)


def shared_grid(
    problem: Problem,
    people: Sequence[GroupPerson],
    spacing: float,
    *,
    jobs: int = 1,
    cache: bool = True,
    done: Callable[[int], None] | None = None,
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
        done: called after every person with the number of people who are done.

    Raises:
        InputError: if the problem has no workspace or no tool axis, or the spacing is not
            allowed.
    """
    if missing := next(
        (what for what, kind in _NEEDED.items() if problem.limit_of(kind) is None), None
    ):
        raise InputError(
            f"problem {problem.name}: has no limits.{missing}, so nothing says where the object"
            " may be"
        )
    check_real("spacing", spacing, "metres")
    if not 0.01 <= spacing <= 1.0:
        raise InputError(f"spacing: got {shown(spacing)} m, allowed 0.01 to 1 m")
    calls = [(problem, person.follower, spacing, cache) for person in people]
    parts = []
    for part in in_order(_of_person, calls, jobs):
        parts.append(part)
        if done is not None:
            done(len(parts))
    (x, y, z), tilts = workspace_lines(problem, spacing)
    scores, postures = np.stack([part[0] for part in parts]), np.stack([part[1] for part in parts])
    costs = np.stack([problem.cost(rows) for rows in postures])
    return SharedGrid(x, y, z, tilts, scores, np.where(scores > 0, costs, np.inf), postures)


_NEEDED = {"workspace": WorkspaceBox, "tool_axis": AxisCone}


def _of_person(
    problem: Problem, person: Alike, spacing: float, cache: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return scores (n,) and postures (n, 32) in the order of the grid.

    A map is in the order in which the person settled.
    """
    found = workspace_map(problem, person, spacing=spacing, cache=cache)
    order = outward(person, workspace_poses(problem, spacing))
    scores, postures = np.empty_like(found.scores), np.empty_like(found.postures)
    scores[order], postures[order] = found.scores, found.postures
    return scores, postures
