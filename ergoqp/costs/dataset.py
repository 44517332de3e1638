"""Random postures, the same number for every score: what surrogates are fitted to and judged by.

Low scores are rare: with every joint drawn from a random band, REBA 1 comes up about once in 40 000 draws. Waiting
for it is not needed. Joints are independent and each is read by one segment, so the law of the drawn bands is a finite
table; the score splits that table, and drawing from the part with the wanted score gives exactly the postures that rejection
would keep.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Unpack

import numpy as np
from numpy.typing import NDArray

from ergoqp.errors import InputError
from ergoqp.joints import JOINTS, LOWER, SIDES, UPPER
from ergoqp.sheets.description import TIE, Segment, Sheet
from ergoqp.sheets.method import Method, read_method, sheet_of
from ergoqp.sheets.score import look_up, score_final, score_segment
from ergoqp.sheets.task import Task, TaskOptions, read_task

_CLEAR: Final = 2 * TIE
"""Drawn angles keep this far from band ends, so that a tie rule never decides [rad]."""


def balanced_postures(
    per_score: int,
    rng: np.random.Generator,
    method: Method | None = None,
    *,
    scores: Sequence[int] = range(1, 11),
    **options: Unpack[TaskOptions],
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Draw postures with equally many of each score.

    Every joint that scores is drawn by picking one of its bands uniformly (clipped to the joint's range), then uniformly
    inside; the others uniformly in their range; kept are the wanted scores.

    Args:
        per_score: postures of each score, at least 1.
        rng: source of randomness; the same state gives the same postures.
        method: how the sheet is read; the default follows the publication.
        scores: wanted scores.
        **options: of the task, as in :func:`ergoqp.sheets.reba.assess`, one value for all.

    Returns:
        Postures, shape (n, 32) [rad], in random order, and their scores, shape (n,).

    Raises:
        InputError: for a score that no posture has under these options.
    """
    if per_score < 1:
        raise InputError(f"per_score: got {per_score}, allowed: 1 or more")
    if not len(scores):
        raise InputError("scores: got none, allowed: one or more final scores")
    method = read_method(method)
    sheet = sheet_of(method)
    law = _law(sheet, method, read_task(sheet, None, **options))
    labels = np.repeat(np.asarray(scores, dtype=np.int64), per_score)
    cells = np.concatenate([law.draw_cells(int(score), per_score, rng) for score in scores])
    order = rng.permutation(len(labels))
    return law.draw_angles(cells[order], rng), labels[order]


@dataclass(frozen=True, eq=False)
class _Bands:
    """The bands of one segment on one side, all combinations, sorted by the segment's score.

    Attributes:
        joints: indices of the m joints.
        low: lower ends, shape (combinations, m) [rad].
        high: upper ends.
        first: number of the first combination of score k, indexed by k.
        count: number of combinations of score k, indexed by k.
    """

    joints: list[int]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    first: NDArray[np.int64]
    count: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class _Law:
    """The law of the drawn bands: a table of all combinations of segment scores.

    Attributes:
        bands: per segment and side.
        scores: segment scores of each cell, shape (cells, segments and sides).
        chance: probability of each cell.
        final: final score of each cell.
    """

    bands: list[_Bands]
    scores: NDArray[np.int8]
    chance: NDArray[np.float64]
    final: NDArray[np.int8]

    def draw_cells(self, score: int, count: int, rng: np.random.Generator) -> NDArray[np.int64]:
        """Draw cells of one final score, by their probabilities."""
        cells = np.flatnonzero((self.final == score) & (self.chance > 0))
        if not len(cells):
            reachable = sorted(set(self.final[self.chance > 0].tolist()))
            raise InputError(f"scores: got {score}, allowed under these options: {', '.join(map(str, reachable))}")
        cumulative = np.cumsum(self.chance[cells])
        return cells[np.searchsorted(cumulative[:-1], rng.random(count) * cumulative[-1], side="right")]

    def draw_angles(self, cells: NDArray[np.int64], rng: np.random.Generator) -> NDArray[np.float64]:
        """Draw a posture in each cell, shape (n, 32) [rad]."""
        postures = rng.uniform(LOWER, UPPER, (len(cells), len(JOINTS)))
        for bands, score in zip(self.bands, self.scores[cells].T, strict=True):
            pick = bands.first[score] + rng.integers(bands.count[score])
            postures[:, bands.joints] = rng.uniform(bands.low[pick], bands.high[pick])
        return postures


def _law(sheet: Sheet, method: Method, task: Task) -> _Law:
    parts = [(segment, "") for segment in sheet.of_table("A")]
    parts += [(segment, side) for side in SIDES for segment in sheet.of_table("B")]
    bands = [_bands(segment, side, task) for segment, side in parts]
    marginals = [b.count / b.count.sum() for b in bands]
    grid = np.meshgrid(*(np.arange(1, len(b.count), dtype=np.int8) for b in bands), indexing="ij")
    scores = [axis.ravel() for axis in grid]
    chance = np.prod([marginal[score] for marginal, score in zip(marginals, scores, strict=True)], axis=0)
    a, right, left = scores[:3], scores[3:6], scores[6:]
    if method.arms == "whole":
        table_b = np.maximum(look_up(sheet, "B", *right), look_up(sheet, "B", *left))
    else:
        table_b = look_up(sheet, "B", *(np.maximum(r, other) for r, other in zip(right, left, strict=True)))
    final = score_final(sheet, look_up(sheet, "A", *a), table_b, task.points, method.final_max)
    return _Law(bands, np.stack(scores, axis=1), chance, final)


def _bands(segment: Segment, side: str, task: Task) -> _Bands:
    joints, choices = [], []
    for step in segment.steps:
        for joint_side in SIDES if segment.worse_side and step is segment.base else (side,):
            joint = segment.joint(step, joint_side)
            ends = np.clip([LOWER[joint], *step.edges, UPPER[joint]], LOWER[joint], UPPER[joint])
            joints.append(joint)
            choices.append([(low, high) for low, high in itertools.pairwise(ends) if high - low > 2 * _CLEAR])
    ends = np.array(list(itertools.product(*choices)))  # (combinations, joints, 2)
    # The exact reading says what a combination scores: no rule is written twice.
    angles = np.zeros((len(JOINTS), len(ends)))
    angles[joints] = ends.mean(axis=2).T
    score = score_segment(segment, angles, task, side)
    order = np.argsort(score, kind="stable")
    count = np.bincount(score, minlength=segment.highest + 1)
    low, high = ends[order, :, 0] + _CLEAR, ends[order, :, 1] - _CLEAR
    return _Bands(joints, low, high, np.cumsum(count) - count, count)
