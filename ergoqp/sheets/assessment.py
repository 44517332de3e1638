"""REBA scores of many postures: the final scores at once, all details on demand."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ergoqp.errors import InputError
from ergoqp.joints import JOINTS, LOWER, SIDES, UPPER, spoken
from ergoqp.sheets.description import TIE, Segment, Sheet
from ergoqp.sheets.elevation import by_elevation
from ergoqp.sheets.look_up import (
    Scores8,
    look_up,
    score_final,
    score_segments,
    score_side,
    score_worse_segments,
)
from ergoqp.sheets.options import Method, sheet_of
from ergoqp.sheets.postures import check_angles
from ergoqp.sheets.task import Task
from ergoqp.sheets.words import explain_segment

_BLOCK: Final = 2048
"""Postures per block: 32 rows of float64 stay within the second-level cache."""


@dataclass(frozen=True, eq=False)
class Assessment:
    """REBA scores of n postures. An invalid posture (NaN) has 0 everywhere and level -1.

    Attributes:
        postures: the postures, shape (n, 32) [rad], read-only.
        method: how the sheet was read.
        final: REBA score (n,), 1 to 15, and 0 when invalid; int [points].
        valid: whether a posture could be scored; shape (n,), bool.

    Example:
        >>> import numpy as np
        >>> from ergoqp import reba
        >>> assessment = reba.assess(np.zeros((3, 32)))
        >>> assessment.final.tolist(), assessment.band.tolist()
        ([1, 1, 1], [0, 0, 0])
        >>> assessment.reasons(0)[-1]
        'REBA: table C 1, activity +0: 1, negligible'
    """

    postures: NDArray[np.float64]
    method: Method
    final: NDArray[np.int64]
    valid: NDArray[np.bool_]
    _task: Task
    _scored: dict[str, Scores8]
    _table_b: dict[str, Scores8]

    @cached_property
    def outside(self) -> NDArray[np.bool_]:
        """Finite angles beyond the range of their joint; shape (n, 32).

        They are scored by the outer band.
        """
        return (self.postures < LOWER - TIE) | (self.postures > UPPER + TIE)

    @cached_property
    def band(self) -> NDArray[np.int64]:
        """Action level 0 to 4 as in `ergoqp.reba.ACTION_LEVELS`, -1 when invalid; shape (n,)."""
        return np.searchsorted(self._sheet.level_starts, self.final, side="right") - 1

    @cached_property
    def arm(self) -> NDArray[np.str_]:
        """Arm with the higher score B, ``"right"`` or ``"left"``, right if equal; shape (n,)."""
        return np.where(self._left_is_worse, "left", "right")

    @cached_property
    def segments(self) -> dict[str, NDArray[np.int64]]:
        """Score (n,) of each segment: neck, trunk, legs, ``right_*`` and ``left_*`` of the arms.

        The arm segments without a side are those that enter the final score.
        """
        found = {
            name: np.where(self.valid, scores, 0).astype(np.int64)
            for name, scores in self._scored.items()
        }
        for segment in self._sheet.of_table("B"):
            right, left = (found[segment.label(side)] for side in SIDES)
            whole = self.method.arms == "whole"
            found[segment.name] = (
                np.where(self._left_is_worse, left, right) if whole else np.maximum(right, left)
            )
        return found

    def worst(self, time: ArrayLike | None = None) -> int:
        """Return the number of the worst posture.

        It has the highest final score. Of several it has the highest sum of score A and score B,
        and of these it is the first of those that are held longest.

        Args:
            time: time of each posture (n,), increasing [s]. None: equal steps.

        Raises:
            InputError: if there is no posture.
        """
        count = len(self.final)
        if not count:
            raise InputError("worst: got no posture, allowed one or more")
        points, scores = self._task.points, self.segments
        tables = sum(
            look_up(self._sheet, t, *(np.maximum(scores[axis], 1) for axis in axes.axes))
            for t, axes in self._sheet.tables.items()
            if t in "AB"
        )
        both = tables + points["load"] + points["coupling"]
        rank = np.where(self.valid, 1000 * self.final + both, -1)
        top = np.concatenate([[False], rank == rank.max(), [False]])
        begins, ends = np.flatnonzero(np.diff(top.astype(int))).reshape(-1, 2).T
        steps = np.ones(count) if time is None else np.diff(time, append=np.inf)
        # The last posture is held for as long as one step usually takes.
        steps[-1] = np.median(steps[:-1]) if count > 1 else 1.0
        held = np.concatenate([[0.0], np.cumsum(steps)])
        # Rounding must not decide between the same durations.
        return int(begins[np.argmax(np.round(held[ends] - held[begins], 6))])

    def reasons(self, i: int) -> list[str]:
        """Return sentences that explain the score of posture `i`.

        The list has a sentence per segment, then the tables, then warnings.

        Args:
            i: number of the posture, from 0 (negative: from the end).

        Raises:
            InputError: if there is no posture with that number.
        """
        i = self._index(i, "reasons")
        posture, task, sheet = self.postures[i], self._task.rows(i), self._sheet
        if not self.valid[i]:
            missing = ", ".join(spoken(JOINTS[j]) for j in np.flatnonzero(np.isnan(posture)))
            return [f"not scored: no angle for {missing}"]
        sentences = [
            self._segment(segment, side, i)
            for segment in sheet.segments.values()
            for side in segment.sides
        ]
        sentences += self._composition(i, task)
        for j in np.flatnonzero(self.outside[i]):
            low, high = np.degrees([LOWER[j], UPPER[j]])
            sentences.append(
                f"{spoken(JOINTS[j])} {np.degrees(posture[j]):.3g} deg is beyond its range"
                f" {low:.0f} to {high:.0f}: scored by the outer band"
            )
        return sentences

    def costly(self, i: int) -> list[str]:
        """Return what makes the score of posture `i` higher than 1.

        The list names the segments above their lowest score, and the points of the task. Of
        the arms it names only the one that counts. The list is empty if the score is 1,
        because a segment above its lowest score does not always cost a point.

        Args:
            i: number of the posture, from 0 (negative: from the end).

        Raises:
            InputError: if there is no posture with that number.
        """
        i = self._index(i, "costly")
        if self.final[i] <= 1:
            return []
        points = {name: int(value) for name, value in self._task.rows(i).points.items()}
        counts = (str(self.arm[i]),) if self.method.arms == "whole" else SIDES
        places = [
            (segment, side) for segment in self._sheet.segments.values() for side in segment.sides
        ]
        return [
            self._segment(segment, side, i)
            for segment, side in places
            if side in ("", *counts) and self._scored[segment.label(side)][i] > 1
        ] + [f"{name}: +{value}" for name, value in points.items() if value]

    def _index(self, i: int, what: str) -> int:
        if not -len(self.final) <= i < len(self.final):
            raise InputError(f"{what}: got posture {i}, allowed: 0 to {len(self.final) - 1}")
        return i % len(self.final)

    def _segment(self, segment: Segment, side: str, i: int) -> str:
        return explain_segment(
            segment,
            _as_read(self.method, self.postures[i]),
            self._task.rows(i),
            side,
            int(self._scored[segment.label(side)][i]),
        )

    @property
    def _sheet(self) -> Sheet:
        return sheet_of(self.method)

    @cached_property
    def _left_is_worse(self) -> NDArray[np.bool_]:
        return self._table_b["left"] > self._table_b["right"]

    def _composition(self, i: int, task: Task) -> list[str]:
        sheet = self._sheet
        scores = {name: int(scores[i]) for name, scores in self.segments.items()}
        table_a, table_b = (
            int(sheet.tables[t].cells[tuple(scores[axis] - 1 for axis in sheet.tables[t].axes)])
            for t in "AB"
        )
        load, coupling, activity = (
            int(task.points[name]) for name in ("load", "coupling", "activity")
        )
        score_c = int(sheet.tables["C"].cells[table_a + load - 1, table_b + coupling - 1])
        source = (
            f"the {self.arm[i]} arm"
            if self.method.arms == "whole"
            else "the worse of both arms per segment"
        )
        mass = f"{float(task.load_kg):g} kg{' with shock' if task.shock else ''}"
        final, level = int(self.final[i]), sheet.levels[int(self.band[i])]
        capped = f", at most {final}" if final < score_c + activity else ""
        return [
            f"score A: table {table_a}, load of {mass} +{load}: {table_a + load}",
            f"score B of {source}: table {table_b}, coupling +{coupling}: {table_b + coupling}",
            f"REBA: table C {score_c}, activity +{activity}{capped}: {final}, {level}",
        ]


def _as_read(method: Method, angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return joint angles (32, ...) [rad] as the method reads them."""
    return angles if method.upper_arm == "flexion" else by_elevation(angles)


def assess_rows(postures: NDArray[np.float64], method: Method, task: Task) -> Assessment:
    """Score checked postures block by block.

    Args:
        postures: shape (n, 32) [rad], from :func:`ergoqp.sheets.postures.read_postures`.
        method: how the sheet is read.
        task: options of these postures.

    Raises:
        InputError: if an angle is beyond +-180 deg.
    """
    sheet, count = sheet_of(method), len(postures)
    labels = [segment.label(side) for segment in sheet.segments.values() for side in segment.sides]
    scored: dict[str, Scores8] = {name: np.empty(count, dtype=np.int8) for name in labels}
    table_b: dict[str, Scores8] = {side: np.empty(count, dtype=np.int8) for side in SIDES}
    final, valid = np.empty(count, dtype=np.int64), np.empty(count, dtype=bool)
    for start in range(0, count, _BLOCK):
        rows = slice(start, min(start + _BLOCK, count))
        angles = np.ascontiguousarray(postures[rows].T)
        valid[rows] = check_angles(angles, start)
        options = task.rows(rows)
        block = score_segments(sheet, _as_read(method, angles), options)
        arms = {side: score_side(sheet, block, side) for side in SIDES}
        worse = (
            np.maximum(*arms.values())
            if method.arms == "whole"
            else score_worse_segments(sheet, block)
        )
        table_a = look_up(sheet, "A", *(block[name] for name in sheet.tables["A"].axes))
        final[rows] = score_final(sheet, table_a, worse, options.points, method.final_max)
        for name, scores in block.items():
            scored[name][rows] = scores
        for side, scores in arms.items():
            table_b[side][rows] = scores
    final *= valid
    return Assessment(postures, method, final, valid, task, scored, table_b)
