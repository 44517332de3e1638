"""Boxes of trunk and right arm angles that allow a score, with all other joints at their best."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ergoqp.human.forearm import ARM_INDEX
from ergoqp.joints import JOINTS, LOWER, SIDES, UPPER
from ergoqp.sheets import reba
from ergoqp.sheets.description import TIE, StepFunction
from ergoqp.sheets.options import Method, sheet_of

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
                ends = self.intervals[joint][points]
                beyond = [
                    np.maximum(low - angles[joint], angles[joint] - high) for low, high in ends
                ]
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
        rest[joint] = min(
            (float(np.clip(0.0, low, high)) for low, high in intervals[min(intervals)]), key=abs
        )
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
