"""Result for a group: the place, all members at it, and what it costs them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ergoqp._version import __version__
from ergoqp.expressions.quaternions import pose_as_dict
from ergoqp.files.whole import whole, write_json
from ergoqp.human import Body
from ergoqp.placing.group.grid import SharedGrid
from ergoqp.placing.group.search import Objective


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
        >>> from ergoqp.placing.group.optimise import best_for_group
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
        >>> from ergoqp.placing.group.optimise import best_for_group
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
        with whole(folder / "group.npz") as scratch:
            np.savez_compressed(
                scratch,
                allow_pickle=False,
                pose=self.pose,
                postures=np.array([member.posture for member in self.members]),
                labels=np.array([member.label for member in self.members], dtype=np.str_),
                x=grid.x,
                y=grid.y,
                z=grid.z,
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
