"""The forearm as the state: elbow and wrist of the right arm, six numbers; its true cost.

The true cost of a forearm: the lowest sheet score over all its postures. These are the postures of
the whole body that put elbow and wrist there.

Neck, legs, left arm, right wrist and pronation are free, so they take their best values. What
remains is a search over trunk and right arm. Side bend and twist of the trunk are on a grid,
and everything else follows in closed form (`ergoqp.human.forearm`). If no grid point reaches a
score but some nearly do, the search continues around these on finer and finer grids. So a
narrow set of postures is found too.

The package contains its data, its true cost and its descents.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from ergoqp.coordinates import FOREARM, Coordinates
from ergoqp.human import Body
from ergoqp.human.forearm import ARM_INDEX, ARM_JOINTS, Arm
from ergoqp.joints import JOINTS, LOWER, SIDES, UPPER
from ergoqp.lab.forearm_models import forearm_data as forearm_data
from ergoqp.lab.forearm_models import nearest_sample_cost as nearest_sample_cost
from ergoqp.sheets import reba
from ergoqp.sheets.description import TIE, StepFunction
from ergoqp.sheets.options import Method, read_method, sheet_of

Array = NDArray[np.float64]

SLACK: Final = TIE / 10
"""Angles keep this distance from the ends of bands, so that rounding never matters [rad]."""

Limits = tuple[int, ...]
"""Highest points that the band of each of `ARM_JOINTS` may give."""

Intervals = dict[int, list[tuple[float, float]]]
"""Intervals of one joint [rad], by the highest points that they give."""


@dataclass(frozen=True, eq=False)
class Boxes:
    """For each score the boxes of angles with this score or less.

    Attributes:
        scores: the possible scores of forearm points, ascending.
        limits: per score, the largest boxes in which no posture scores more.
        intervals: per joint and highest points, the allowed intervals [rad].
        rest: a posture with neck, legs, left arm and right wrist at their best, shape (32,)
            [rad].
    """

    scores: tuple[int, ...]
    limits: dict[int, list[Limits]]
    intervals: list[Intervals]
    rest: Array

    def excess(self, angles: Array, missing: Array, score: int) -> Array:
        """Return the distance of angles from the nearest box of a score, 0 inside [rad].

        Args:
            angles: angles of `ARM_JOINTS`, shape (7, ...) [rad]; the distance is that of all
                joints together.
            missing: additional distance, 0 if the angles are a solution, shape (...).
            score: the score that must not be exceeded.
        """
        outside: dict[tuple[int, int], Array] = {}

        def of(joint: int, points: int) -> Array:
            if (joint, points) not in outside:
                angle, ends = angles[joint], self.intervals[joint][points]
                beyond = [np.maximum(low - angle, angle - high) for low, high in ends]
                outside[joint, points] = np.maximum(np.min(beyond, axis=0), 0) ** 2
            return outside[joint, points]

        squares = [
            sum((of(*pair) for pair in enumerate(limits)), start=missing**2)
            for limits in self.limits[score]
        ]
        return np.sqrt(np.min(squares, axis=0))


@lru_cache(maxsize=8)
def boxes_of(method: Method) -> Boxes:
    """Return the boxes of a method."""
    by_joint = _intervals_by_joint(method)
    rest = np.zeros(len(JOINTS))
    for joint, intervals in by_joint.items():
        nearest = (float(np.clip(0.0, *interval)) for interval in intervals[min(intervals)])
        rest[joint] = min(nearest, key=abs)
    moved = [by_joint[joint] for joint in ARM_INDEX]
    # One posture per combination of points, in bands that give exactly these. The exact score
    # is then computed from the sheet.
    combinations = np.array(list(itertools.product(*(sorted(intervals) for intervals in moved))))
    postures = np.tile(rest, (len(combinations), 1))
    for column, joint in enumerate(ARM_INDEX):
        angle = {points: _inside(moved[column], points) for points in moved[column]}
        postures[:, joint] = [angle[points] for points in combinations[:, column]]
    final = reba.assess(postures, method).final
    limits = {int(score): _largest(combinations[final <= score]) for score in np.unique(final)}
    return Boxes(tuple(limits), limits, moved, rest)


def _intervals_by_joint(method: Method) -> dict[int, Intervals]:
    found = {}
    for segment in sheet_of(method).segments.values():
        for side in segment.sides:
            for step in segment.steps:
                for joint_side in SIDES if segment.worse_side and step is segment.base else (side,):
                    joint = segment.joint(step, joint_side)
                    found[joint] = _intervals(step, LOWER[joint] - SLACK, UPPER[joint] + SLACK)
    return found


def _intervals(step: StepFunction, lower: float, upper: float) -> Intervals:
    """Return, per number of points that a joint can get in its range, where it gets no more."""
    ends = [-np.inf, *step.rises_at, np.inf]
    found: Intervals = {}
    for points in sorted(set(step.scores)):
        allowed = [i for i, score in enumerate(step.scores) if score <= points]
        runs = [
            [i for _, i in run]
            for _, run in itertools.groupby(enumerate(allowed), key=lambda pair: pair[1] - pair[0])
        ]
        inside = [
            (max(ends[run[0]] + SLACK, lower), min(ends[run[-1] + 1] - SLACK, upper))
            for run in runs
        ]
        inside = [(low, high) for low, high in inside if low < high]
        if inside and inside not in found.values():
            found[points] = inside
    return found


def _inside(intervals: Intervals, points: int) -> float:
    """Return an angle that gives exactly these points.

    It is at an end of the wider intervals, outside the narrower ones.
    """
    ends = [angle for interval in intervals[points] for angle in interval]
    fewer = [interval for less in intervals if less < points for interval in intervals[less]]
    return next(
        angle for angle in ends if not any(low - TIE <= angle <= high + TIE for low, high in fewer)
    )


def _largest(limits: NDArray[np.int64]) -> list[Limits]:
    """Return the limits that are not within others."""
    within = (limits[:, None] <= limits[None]).all(axis=-1)
    less = (limits[:, None] < limits[None]).any(axis=-1)
    return [tuple(row) for row in limits[~(within & less).any(axis=-1)].tolist()]


LENGTH_TOLERANCE: Final = 1e-6
"""Points whose distance differs from the length of the forearm by more are out of reach [m]."""

_BEND_DEG: Final = (-40, -33, -26, -19, -14, -10, -7, -3.5, 0, 3.5, 7, 10, 14, 19, 26, 33, 40)
_ONE_WAY_DEG: Final = (3.5, 7, 10, 13, 17, 24, 31, 38, 45)
_TWIST_DEG: Final = (*(-angle for angle in _ONE_WAY_DEG[::-1]), 0, *_ONE_WAY_DEG)
_SHOULDER_DEG: Final = (
    *range(-60, -30, 10),
    -26,
    *range(-20, 21, 5),
    26,
    32,
    38,
    *range(45, 91, 11),
    *range(105, 176, 14),
)
"""Nodes of the grids, dense where the angles score low."""

_CELL: Final = np.radians(7)
"""Largest spacing of the grid [rad]."""
_STEEP: Final = 6
"""A finer grid is used if a score is missed by less than this many cells."""
_SEEDS: Final = 10
"""Number of local minima that are followed."""
_LEVELS: Final = 14
"""How many times the cells are halved."""
_STAR: Final = np.stack(np.meshgrid(*[np.linspace(-1, 1, 5)] * 2), axis=-1).reshape(-1, 2)
"""Points of a finer grid around a seed, in cells."""
_BLOCK: Final = 64
"""Number of points at a time, so that a block fits in the cache."""


def true_cost(
    points: ArrayLike, body: Body | None = None, method: Method | None = None
) -> NDArray[np.int64]:
    """Return the lowest sheet score of any posture with the right elbow and wrist at these points.

    Args:
        points: elbow and wrist in the pelvis frame, shape (n, 6) or (6,) [m].
        body: the person; default: the nominal one.
        method: how the sheet is read; the default follows the publication.

    Returns:
        Scores, shape (n,); 0 if no posture reaches the points, or they are not finite.

    Raises:
        InputError: if the shape of the points is wrong.
    """
    return true_posture(points, body, method)[1]


def true_posture(
    points: ArrayLike, body: Body | None = None, method: Method | None = None
) -> tuple[Array, NDArray[np.int64]]:
    """Return a posture with the lowest score for each pair of points, and the score.

    The arguments are those of `true_cost`.

    Returns:
        Postures, shape (n, 32) [rad], NaN if no posture reaches the points; and scores, shape
        (n,), 0 in that case.

    Raises:
        InputError: if the shape of the points is wrong.
    """
    rows, method = Coordinates(FOREARM).rows(points), read_method(method)
    search = _Search(Arm(body or Body()), boxes_of(method))
    postures = np.full((len(rows), len(JOINTS)), np.nan)
    length = np.linalg.norm(rows[:, 3:] - rows[:, :3], axis=1)
    fits = np.flatnonzero(np.abs(length - search.arm.fore) <= LENGTH_TOLERANCE)
    for start in range(0, len(fits), _BLOCK):
        block = fits[start : start + _BLOCK]
        angles = search.best(rows[block])
        reached = np.isfinite(angles[:, 0])
        whole = np.tile(search.boxes.rest, (reached.sum(), 1))
        whole[:, ARM_INDEX] = angles[reached]
        postures[block[reached]] = whole
    return postures, reba.assess(postures, method).final


class _Grid:
    """A way to enumerate all postures of given points: two joints on a grid, the others solved for.

    Args:
        solve: a method of `Arm`: (arm, points, first, second) -> angles (7, n, 4 m), missing
            (n, 4 m).
        nodes: nodes of the two joints on the grid, of `ARM_JOINTS` [deg].
    """

    def __init__(
        self,
        solve: Callable[[Arm, Array, Array, Array], tuple[Array, Array]],
        nodes: dict[str, Sequence[float]],
    ) -> None:
        self.solve, self.joints = solve, [ARM_JOINTS.index(name) for name in nodes]
        self.nodes = np.radians(np.meshgrid(*nodes.values()))

    def local_best(self, excess: Array) -> NDArray[np.int64]:
        """Return the columns (n, seeds) of the lowest local minima.

        Each of the four solutions is searched separately.
        """
        field = excess.reshape(len(excess), 4, *self.nodes.shape[1:])
        padded = np.pad(field, ((0, 0), (0, 0), (1, 1), (1, 1)), constant_values=np.inf)
        around = sliding_window_view(padded, (3, 3), axis=(2, 3)).min(axis=(4, 5))
        lowest = np.where(field <= around, field, np.inf).reshape(excess.shape)
        return np.argpartition(lowest, _SEEDS, axis=1)[:, :_SEEDS]

    def around(self, angles: Array, chosen: NDArray[np.int64], cell: float) -> tuple[Array, Array]:
        """Return finer grids (n, seeds x star) of the two joints around chosen columns.

        They stay within the ranges of the joints.
        """
        finer = []
        for joint, star in zip(self.joints, _STAR.T, strict=True):
            seeds = np.take_along_axis(angles[joint], chosen, axis=1)[:, :, None]
            moved = (seeds + cell * star).reshape(len(seeds), -1)
            finer.append(np.clip(moved, LOWER[ARM_INDEX[joint]], UPPER[ARM_INDEX[joint]]))
        return finer[0], finer[1]


_GRIDS: Final = (
    _Grid(Arm.solve_by_bend, {"trunk_side_bend": _BEND_DEG, "trunk_twist": _TWIST_DEG}),
    _Grid(
        Arm.solve_by_shoulder,
        {"right_shoulder_flexion": _SHOULDER_DEG, "trunk_twist": _TWIST_DEG[::2]},
    ),
)


class _Search:
    """The search for one person and method."""

    def __init__(self, arm: Arm, boxes: Boxes) -> None:
        self.arm, self.boxes = arm, boxes

    def best(self, points: Array) -> Array:
        """Return lowest-score angles (n, 7) of `ARM_JOINTS` [rad], NaN if no posture reaches."""
        found = np.full((len(points), len(ARM_JOINTS)), np.nan)
        rows = np.arange(len(points))
        solved = []
        for grid in _GRIDS:
            nodes = (np.tile(axis.ravel(), (len(points), 1)) for axis in grid.nodes)
            solved.append(grid.solve(self.arm, points, *nodes))
        for score in self.boxes.scores:
            for grid, (angles, missing) in zip(_GRIDS, solved, strict=True):
                left = np.flatnonzero(np.isnan(found[rows, 0]))
                found[rows[left]] = self._refine(
                    grid, points[rows[left]], angles[:, left], missing[left], score
                )
            left = np.isnan(found[rows, 0])
            rows = rows[left]
            solved = [(angles[:, left], missing[left]) for angles, missing in solved]
            if not len(rows):
                break
        return np.clip(found, LOWER[ARM_INDEX], UPPER[ARM_INDEX])

    def _refine(
        self, grid: _Grid, points: Array, angles: Array, missing: Array, score: int
    ) -> Array:
        """Return angles (n, 7) inside the boxes of a score, NaN if none is found.

        The search starts from the angles of the whole grid.
        """
        found = np.full((len(points), len(ARM_JOINTS)), np.nan)
        rows, cell = np.arange(len(points)), _CELL
        for level in range(_LEVELS + 1):
            excess = self.boxes.excess(angles, missing, score)
            least = np.argmin(excess, axis=1)
            best = np.take_along_axis(excess, least[:, None], axis=1)[:, 0]
            hit, go_on = best <= 0, (best > 0) & (best < _STEEP * cell)
            found[rows[hit]] = angles[:, hit, least[hit]].T
            if level == _LEVELS or not go_on.any():
                break
            rows, excess, angles = rows[go_on], excess[go_on], angles[:, go_on]
            chosen = grid.local_best(excess) if level == 0 else _best_of_stars(excess)
            angles, missing = grid.solve(self.arm, points[rows], *grid.around(angles, chosen, cell))
            cell *= 0.5
        return found


def _best_of_stars(excess: Array) -> NDArray[np.int64]:
    """Return the best column of each seed's star (n, seeds), so that no valley takes all seeds."""
    stars = excess.reshape(len(excess), 4, _SEEDS, len(_STAR)).transpose(0, 2, 1, 3)
    least = np.argmin(stars.reshape(len(excess), _SEEDS, -1), axis=2)
    solution, place = np.divmod(least, len(_STAR))
    return (solution * _SEEDS + np.arange(_SEEDS)) * len(_STAR) + place
