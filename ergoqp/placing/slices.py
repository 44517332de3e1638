"""Flat maps through a place: exact scores with the object moved along two coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from ergoqp.placing.place import Placing
from ergoqp.placing.workers import in_order
from ergoqp.problem.problem import Problem
from ergoqp.rest.best_place import outward, settle_in_order
from ergoqp.rest.model_person import Alike, Start

SPACING: Final = 0.05
"""Distance of neighbouring places of a slice [m]."""
TILTS: Final = 11
"""Number of tilts of a slice with tilts."""

_PAIRS: Final = ((0, 2), (1, 2), (0, 1), (3, 2), (4, 2), (3, 0), (4, 0), (3, 1), (4, 1), (3, 4))
_MOST: Final = 2


@dataclass(frozen=True, eq=False)
class Slice:
    """Scores over two coordinates of the object's place. The others are as at the place itself.

    Attributes:
        across: number of the horizontal coordinate of `ergoqp.placing.place.Placing`:
            x, y, z [m], two turns [rad].
        up: number of the vertical coordinate.
        horizontal: values of the horizontal coordinate (h,).
        vertical: values of the vertical coordinate (v,).
        scores: exact scores (people, v, h), 0 if the person does not reach, -1 if the object
            may not be there.
        point: the place itself (5,).
    """

    across: int
    up: int
    horizontal: np.ndarray
    vertical: np.ndarray
    scores: np.ndarray
    point: np.ndarray


def slices_through(
    problem: Problem,
    people: Sequence[Alike],
    pose: np.ndarray,
    *,
    starts: Sequence[Start] | None = None,
    spacing: float = SPACING,
    jobs: int = 1,
) -> list[Slice]:
    """Return at most two slices through a place.

    They show distance and side over height, or tilt over height if nothing else moves.

    Args:
        problem: its workspace and tool axis define where the object can be.
        people: people who are put to rest at every place.
        pose: the place (4, 4), in the workspace.
        starts: how each person holds the object, and from which posture they settle; None: as
            in comfort.
        spacing: distance of neighbouring places [m].
        jobs: number of processes.
    """
    placing = Placing.of(problem)
    exact = placing.point(pose)
    # An optimum is often at an end of the workspace, up to the tolerance of its solver.
    point = np.clip(exact, placing.lower, placing.upper)
    # The rotation of the object about its tool axis stays the same.
    roll = placing.pose(exact)[:3, :3].T @ pose[:3, :3]
    free = placing.upper - placing.lower > 1e-9
    pairs = [pair for pair in _PAIRS if free[list(pair)].all()]
    flat = [pair for pair in pairs if max(pair) < 3] or pairs
    slices = []
    for across, up in flat[:_MOST]:
        horizontal, vertical = (_values(placing, number, spacing) for number in (across, up))
        points = np.tile(point, (len(vertical), len(horizontal), 1))
        points[..., across], points[..., up] = horizontal, vertical[:, None]
        allowed = np.array([placing.holds(each) for each in points.reshape(-1, 5)])
        if not allowed.any():
            continue
        poses = np.array([placing.pose(each) for each in points.reshape(-1, 5)[allowed]])
        poses[:, :3, :3] = poses[:, :3, :3] @ roll
        scores = np.full((len(people), len(allowed)), -1)
        calls = [
            (problem, person, poses, start)
            for person, start in zip(people, starts or [None] * len(people), strict=True)
        ]
        scores[:, allowed] = np.stack(list(in_order(_scores, calls, jobs)))
        slices.append(
            Slice(
                across,
                up,
                horizontal,
                vertical,
                scores.reshape(-1, len(vertical), len(horizontal)),
                point,
            )
        )
    return slices


def _values(placing: Placing, number: int, spacing: float) -> np.ndarray:
    low, high = placing.lower[number], placing.upper[number]
    return np.linspace(
        low, high, max(2, round((high - low) / spacing) + 1) if number < 3 else TILTS
    )


def _scores(problem: Problem, person: Alike, poses: np.ndarray, start: Start | None) -> np.ndarray:
    order = outward(person, poses, None if start is None else start.pose)
    postures, reached = settle_in_order(person, poses[order], start)
    scores = np.zeros(len(poses), dtype=int)
    scores[order] = np.where(reached, problem.assess(postures).final, 0)
    return scores
