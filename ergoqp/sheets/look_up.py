"""Exact scores by a sheet, vectorised: angles give segment scores, tables give the final score.

The functions take a block of joint angles with one contiguous row per joint, so that each
comparison runs over a whole row of postures. All scores are int8.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ergoqp.joints import SIDES
from ergoqp.sheets.description import Segment, Sheet
from ergoqp.sheets.task import Task

Scores8 = NDArray[np.int8]


def score_segment(segment: Segment, angles: NDArray[np.float64], task: Task, side: str) -> Scores8:
    """Return a segment's score on one side.

    Args:
        segment: the segment.
        angles: shape (32, n), one row per joint [rad].
        task: options of the n postures.
        side: ``"right"``, ``"left"`` or ``""``.
    """
    if segment.worse_side:
        total = np.maximum(
            *(segment.base.score(angles[segment.joint(segment.base, s)]) for s in SIDES)
        )
    else:
        total = segment.base.score(angles[segment.joint(segment.base, side)])
    if segment.skipped_by is not None:
        total = total * ~task.flag(segment.skipped_by, side)
    total += np.int8(segment.start)
    for modifier in segment.modifiers:
        points = [step.score(angles[segment.joint(step, side)]) for step in modifier.conditions]
        for one in points if modifier.additive else [np.bitwise_or.reduce(points)]:
            total += one
    for option in segment.options:
        flag = task.flag(option.option, side)
        if option.not_with is not None:
            flag = flag & ~task.flag(option.not_with, side)
        total += np.int8(option.points) * flag
    return np.clip(total, 1, segment.highest, out=total)


def score_segments(sheet: Sheet, angles: NDArray[np.float64], task: Task) -> dict[str, Scores8]:
    """Return the score of every segment by its label, ``"neck"`` ... ``"left_wrist"``.

    The arguments are those of :func:`score_segment`.
    """
    return {
        segment.label(side): score_segment(segment, angles, task, side)
        for segment in sheet.segments.values()
        for side in segment.sides
    }


def look_up(sheet: Sheet, table: str, *scores: Scores8) -> Scores8:
    """Return cells of a table.

    Args:
        sheet: the sheet with the table.
        table: name of the table.
        *scores: one array of scores, counted from 1, per axis of the table.
    """
    cells = sheet.tables[table]
    index = scores[0].astype(np.int16) - 1
    for size, axis in zip(cells.cells.shape[1:], scores[1:], strict=True):
        index = index * np.int16(size) + (axis - np.int8(1))
    return np.take(cells.flat, index)


def score_side(sheet: Sheet, segments: dict[str, Scores8], side: str) -> Scores8:
    """Return the score of table B for one arm."""
    return look_up(sheet, "B", *(segments[segment.label(side)] for segment in sheet.of_table("B")))


def score_worse_segments(sheet: Sheet, segments: dict[str, Scores8]) -> Scores8:
    """Return the score of table B for the worse of both arms in each segment."""
    return look_up(
        sheet,
        "B",
        *(np.maximum(*(segments[s.label(side)] for side in SIDES)) for s in sheet.of_table("B")),
    )


def score_final(
    sheet: Sheet, table_a: Scores8, table_b: Scores8, points: dict[str, Scores8], highest: int
) -> Scores8:
    """Return the final score from the scores of tables A and B.

    Args:
        sheet: the sheet.
        table_a: score of table A.
        table_b: score of table B, of the arm that counts.
        points: ``load``, ``coupling`` and ``activity``.
        highest: upper end of the final score.
    """
    tables = sheet.tables
    score_a, score_b = table_a + points[tables["A"].plus], table_b + points[tables["B"].plus]
    return np.minimum(
        look_up(sheet, "C", score_a, score_b) + points[tables["C"].plus], np.int8(highest)
    )
