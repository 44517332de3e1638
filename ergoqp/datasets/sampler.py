"""Random postures with the same number for every score, to fit and to test costs.

Low scores are rare: if every joint is drawn from a random band, REBA 1 occurs about once in 40
000 draws. Rejection sampling is not needed. Joints are independent and each is read by one
segment, so the probabilities of the drawn bands are a finite table. The score divides that
table into parts. Drawing from the part with the wanted score gives exactly the postures that
rejection would keep.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal, Unpack

import numpy as np
from numpy.typing import NDArray

from ergoqp.errors import InputError
from ergoqp.joints import INDEX, JOINTS, LOWER, SIDES, UPPER
from ergoqp.sheets.description import TIE, Segment, Sheet
from ergoqp.sheets.interval import FINAL_MAX, interval_ranges, interval_sheet
from ergoqp.sheets.look_up import look_up, score_final, score_segment
from ergoqp.sheets.options import Method, check_by_joint, read_method, sheet_of
from ergoqp.sheets.task import Task, TaskOptions, read_task

_CLEAR: Final = 2 * TIE
"""Drawn angles keep this distance from band ends, so that the tie rule never matters [rad]."""


def balanced_postures(
    per_score: int,
    rng: np.random.Generator,
    method: Method | None = None,
    *,
    scores: Sequence[int] = range(1, 11),
    joints: Sequence[str] | None = None,
    **options: Unpack[TaskOptions],
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Draw postures with equally many of each score of the sheet.

    For every joint that scores, a band is picked uniformly (clipped to the range of the
    joint), then an angle uniformly in the band. All other joints are drawn uniformly in their
    range. The postures with the wanted scores are kept.

    Args:
        per_score: postures of each score, at least 1.
        rng: source of randomness; the same state gives the same postures.
        method: how the sheet is read; the default follows the publication.
        scores: wanted scores.
        joints: names of the joints that are drawn, the others are zero; None: all.
        **options: options of the task, as in :func:`ergoqp.sheets.reba.assess`, one value for
            all postures.

    Returns:
        Postures, shape (n, 32) [rad], in random order, and their scores, shape (n,).

    Raises:
        InputError: if no posture has one of the scores under these options.
    """
    return sheet_sampler(method, joints, **options).draw(per_score, rng, scores)


def sheet_sampler(
    method: Method | None = None,
    joints: Sequence[str] | None = None,
    **options: Unpack[TaskOptions],
) -> BalancedSampler:
    """Return the sampler of :func:`balanced_postures`, to draw many times.

    Its tables are computed only once.
    """
    method = read_method(method)
    check_by_joint(method, "balanced_postures")
    sheet = sheet_of(method)
    task = read_task(sheet, None, options)
    return BalancedSampler(sheet, task, method.arms, method.final_max, LOWER, UPPER, joints)


def interval_sampler(joints: Sequence[str] | None = None) -> BalancedSampler:
    """Return a sampler of the simplified sheet, in the ranges of that sheet.

    See :mod:`ergoqp.sheets.interval`.
    """
    sheet = interval_sheet()
    return BalancedSampler(
        sheet, read_task(sheet, None, {}), "segments", FINAL_MAX, *interval_ranges(), joints
    )


class BalancedSampler:
    """Draws postures of wanted scores.

    Args:
        sheet: the sheet with its bands and tables.
        task: options, one value for all postures.
        arms: ``"whole"``: the worse arm counts; ``"segments"``: the worse of both arms in each
            segment.
        final_max: highest final score.
        lower: lower end of each joint, shape (32,) [rad].
        upper: upper end of each joint, shape (32,) [rad].
        joints: names of the joints that are drawn, the others are zero; None: all.

    Raises:
        InputError: if a name is not a joint.
    """

    def __init__(
        self,
        sheet: Sheet,
        task: Task,
        arms: Literal["whole", "segments"],
        final_max: int,
        lower: NDArray[np.float64],
        upper: NDArray[np.float64],
        joints: Sequence[str] | None = None,
    ) -> None:
        """Compute the probabilities of the drawn bands."""
        names = JOINTS if joints is None else tuple(joints)
        unknown = [name for name in names if name not in INDEX]
        if unknown:
            raise InputError(f"joints: got {unknown[0]!r}, allowed names of ergoqp.JOINTS")
        drawn = np.isin(JOINTS, names)
        self._lower, self._upper = np.where(drawn, lower, 0.0), np.where(drawn, upper, 0.0)
        parts = [(segment, "") for segment in sheet.of_table("A")]
        parts += [(segment, side) for side in SIDES for segment in sheet.of_table("B")]
        bands = [_bands(segment, side, task, self._lower, self._upper) for segment, side in parts]
        self._law = _law(sheet, bands, task, arms, final_max)

    def draw(
        self, per_score: int, rng: np.random.Generator, scores: Sequence[int] = range(1, 11)
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Draw postures with equally many of each score, see :func:`balanced_postures`.

        Args:
            per_score: postures of each score, at least 1.
            rng: source of randomness.
            scores: wanted scores.

        Returns:
            Postures, shape (n, 32) [rad], in random order, and their scores, shape (n,).

        Raises:
            InputError: if `per_score` is below 1, no score is given, or no posture has one of
                the scores.
        """
        if per_score < 1:
            raise InputError(f"per_score: got {per_score}, allowed: 1 or more")
        if not len(scores):
            raise InputError("scores: got none, allowed: one or more final scores")
        labels = np.repeat(np.asarray(scores, dtype=np.int64), per_score)
        cells = np.concatenate(
            [self._law.draw_cells(int(score), per_score, rng) for score in scores]
        )
        order = rng.permutation(len(labels))
        postures = rng.uniform(self._lower, self._upper, (len(labels), len(JOINTS)))
        self._law.draw_angles(cells[order], postures, rng)
        return postures, labels[order]


@dataclass(frozen=True, eq=False)
class _Bands:
    """The bands of one segment on one side: all combinations, sorted by the score of the segment.

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
    """The probabilities of the drawn bands: a table of all combinations of segment scores.

    Attributes:
        bands: bands per segment and side.
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
            raise InputError(
                f"scores: got {score}, allowed under these options:"
                f" {', '.join(map(str, reachable))}"
            )
        cumulative = np.cumsum(self.chance[cells])
        return cells[
            np.searchsorted(cumulative[:-1], rng.random(count) * cumulative[-1], side="right")
        ]

    def draw_angles(
        self, cells: NDArray[np.int64], postures: NDArray[np.float64], rng: np.random.Generator
    ) -> None:
        """Draw the scoring joints of postures (n, 32), each in its cell [rad]."""
        for bands, score in zip(self.bands, self.scores[cells].T, strict=True):
            pick = bands.first[score] + rng.integers(bands.count[score])
            postures[:, bands.joints] = rng.uniform(bands.low[pick], bands.high[pick])


def _law(
    sheet: Sheet,
    bands: list[_Bands],
    task: Task,
    arms: Literal["whole", "segments"],
    final_max: int,
) -> _Law:
    marginals = [b.count / b.count.sum() for b in bands]
    grid = np.meshgrid(*(np.arange(1, len(b.count), dtype=np.int8) for b in bands), indexing="ij")
    scores = [axis.ravel() for axis in grid]
    chance = np.prod(
        [marginal[score] for marginal, score in zip(marginals, scores, strict=True)], axis=0
    )
    a, right, left = scores[:3], scores[3:6], scores[6:]
    if arms == "whole":
        table_b = np.maximum(look_up(sheet, "B", *right), look_up(sheet, "B", *left))
    else:
        table_b = look_up(
            sheet, "B", *(np.maximum(r, other) for r, other in zip(right, left, strict=True))
        )
    final = score_final(sheet, look_up(sheet, "A", *a), table_b, task.points, final_max)
    return _Law(bands, np.stack(scores, axis=1), chance, final)


def _bands(
    segment: Segment, side: str, task: Task, lower: NDArray[np.float64], upper: NDArray[np.float64]
) -> _Bands:
    joints, choices = [], []
    for step in segment.steps:
        for joint_side in SIDES if segment.worse_side and step is segment.base else (side,):
            joint = segment.joint(step, joint_side)
            joints.append(joint)
            choices.append(_choices(step.edges, lower[joint], upper[joint]))
    ends = np.array(list(itertools.product(*choices)))  # (combinations, joints, 2)
    # The exact score of a combination is computed from the sheet, so no rule is written twice.
    angles = np.zeros((len(JOINTS), len(ends)))
    angles[joints] = ends.mean(axis=2).T
    score = score_segment(segment, angles, task, side)
    order = np.argsort(score, kind="stable")
    count = np.bincount(score, minlength=segment.highest + 1)
    return _Bands(joints, ends[order, :, 0], ends[order, :, 1], np.cumsum(count) - count, count)


def _choices(edges: Sequence[float], lower: float, upper: float) -> list[tuple[float, float]]:
    """Return a joint's bands as (lowest, highest) drawn angle; one value if it has no range."""
    if lower == upper:
        return [(lower, upper)]
    ends = np.clip([lower, *edges, upper], lower, upper)
    return [
        (low + _CLEAR, high - _CLEAR)
        for low, high in itertools.pairwise(ends)
        if high - low > 2 * _CLEAR
    ]
