"""Exact scores of many postures: the final scores at once, all details and reasons on demand.

Exact scores by a sheet, vectorised: angles give segment scores, tables give the final score. The
functions take a block of joint angles with one contiguous row per joint, so that each comparison
runs over a whole row of postures. All scores are int8.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ergoqp.errors import InputError
from ergoqp.joints import JOINTS, LOWER, SIDES, UPPER, spoken
from ergoqp.sheets.angles import Ends, check_angles, check_ends
from ergoqp.sheets.description import (
    TIE,
    Segment,
    Sheet,
    StepFunction,
    between_elevations,
    by_elevation,
)
from ergoqp.sheets.options import Method, Task, sheet_of
from ergoqp.sheets.reasons import explain_segment, explain_span

Scores8 = NDArray[np.int8]


Read = Callable[[StepFunction, NDArray[np.float64]], Scores8]
"""How a step function reads its joint: a value, or the lowest or highest between two."""


def score_segment(
    segment: Segment,
    angles: NDArray[np.float64],
    task: Task,
    side: str,
    read: Read = StepFunction.score,
) -> Scores8:
    """Return a segment's score on one side.

    No joint counts in two of its steps. So the lowest (highest) score of all postures between two
    is that of the lowest (highest) value of each step.

    Args:
        segment: the segment.
        angles: shape (32, n), one row per joint, or (2, 32, n) for the postures between two [rad].
        task: options of the n postures.
        side: ``"right"``, ``"left"`` or ``""``.
        read: how a step reads its joint.
    """

    def points_of(step: StepFunction, of: str) -> Scores8:
        return read(step, angles[..., segment.joint(step, of), :])

    if segment.worse_side:
        total = np.maximum(*(points_of(segment.base, each) for each in SIDES))
    else:
        total = points_of(segment.base, side)
    if segment.skipped_by is not None:
        total = total * ~task.flag(segment.skipped_by, side)
    total += np.int8(segment.start)
    for modifier in segment.modifiers:
        points = [points_of(step, side) for step in modifier.conditions]
        for one in points if modifier.additive else [np.bitwise_or.reduce(points)]:
            total += one
    for option in segment.options:
        flag = task.flag(option.option, side)
        if option.not_with is not None:
            flag = flag & ~task.flag(option.not_with, side)
        total += np.int8(option.points) * flag
    return np.clip(total, 1, segment.highest, out=total)


def score_segments(
    sheet: Sheet, angles: NDArray[np.float64], task: Task, read: Read = StepFunction.score
) -> dict[str, Scores8]:
    """Return the score of every segment by its label, ``"neck"`` ... ``"left_wrist"``.

    The arguments are those of :func:`score_segment`.
    """
    return {
        segment.label(side): score_segment(segment, angles, task, side, read)
        for segment, side in sheet.places
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


_BLOCK: Final = 2048
"""Postures per block: 32 rows of float64 stay within the second-level cache."""


@dataclass(frozen=True, eq=False)
class _Scored:
    """Scores of n postures: final (n,), of each segment, and of table B for each arm."""

    final: NDArray[np.int64]
    segments: dict[str, Scores8]
    table_b: dict[str, Scores8]

    def rows(self, rows: slice) -> _Scored:
        """Return the scores of some of the postures."""
        return _Scored(
            self.final[rows],
            {name: scores[rows] for name, scores in self.segments.items()},
            {side: scores[rows] for side, scores in self.table_b.items()},
        )


@dataclass(frozen=True, eq=False)
class Assessment:
    """REBA scores of n postures. An invalid posture (NaN) has 0 everywhere and level -1.

    Attributes:
        postures: the postures, shape (n, 32) [rad], read-only.
        method: how the sheet was read.
        final: REBA score (n,), 1 to 15, and 0 when invalid; int [points].
        final_low: lowest score of all postures between `low` and `high` (n,); int [points]. It is
            given for an invalid posture, too, if there are such ends. It may be a little lower
            than what they reach if the method reads the elevation of the upper arm.
        final_high: highest score of them (n,), or in the same case a little higher; int [points].
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
    final_low: NDArray[np.int64]
    final_high: NDArray[np.int64]
    valid: NDArray[np.bool_]
    _task: Task
    _best: _Scored
    _lowest: _Scored
    _highest: _Scored
    _ends: Ends | None

    @property
    def low(self) -> NDArray[np.float64]:
        """Lower ends of the joint angles, shape (n, 32) [rad]; the postures if none are given."""
        return self._between(slice(None))[0]

    @property
    def high(self) -> NDArray[np.float64]:
        """Upper ends of the joint angles, the same, shape (n, 32) [rad]."""
        return self._between(slice(None))[1]

    def rows(self, rows: slice) -> Assessment:
        """Return the assessment of some of the postures, without copies.

        Args:
            rows: their numbers, without gaps; for example blocks of a long recording.

        Raises:
            InputError: if the slice has a step other than 1.
        """
        if rows.step not in (None, 1):
            raise InputError(f"rows: got a slice with step {rows.step}, allowed: step 1")
        start, stop, _ = rows.indices(len(self.final))
        whole, rows = self._ends, slice(start, stop)

        def ends(part: slice) -> NDArray[np.float64]:
            first, last, _ = part.indices(stop - start)
            return self._between(slice(start + first, start + last))

        return Assessment(
            self.postures[rows],
            self.method,
            self.final[rows],
            self.final_low[rows],
            self.final_high[rows],
            self.valid[rows],
            self._task.rows(rows),
            self._best.rows(rows),
            self._lowest.rows(rows),
            self._highest.rows(rows),
            None if whole is None else ends,
        )

    def _between(self, rows: slice) -> NDArray[np.float64]:
        """Return lower and upper ends of the joint angles of some postures (2, rows, 32) [rad]."""
        if self._ends is None:
            return np.broadcast_to(self.postures[rows], (2, *self.postures[rows].shape))
        return self._ends(rows)

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
        """Arm with the higher score B, ``"right"`` or ``"left"``, right if equal; shape (n,).

        It is that of the likeliest posture, see `arm_known`.
        """
        return np.where(self._left_is_worse, "left", "right")

    @cached_property
    def arm_known(self) -> NDArray[np.bool_]:
        """Whether one arm has the higher score B in all postures between; shape (n,), bool.

        Where it is false, either arm may be the one that counts.
        """
        right_may, left_may = self._may_count
        return ~(right_may & left_may)

    @property
    def _may_count(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Whether the right and the left arm may count (n,); of two equal ones the right does."""
        low, high = self._lowest.table_b, self._highest.table_b
        return high["right"] >= low["left"], high["left"] > low["right"]

    @cached_property
    def segments(self) -> dict[str, NDArray[np.int64]]:
        """Score (n,) of each segment: neck, trunk, legs, ``right_*`` and ``left_*`` of the arms.

        The arm segments without a side are those that enter the final score.
        """
        found = self._of_body(self._best)
        for segment in self._sheet.of_table("B"):
            right, left = (found[segment.label(side)] for side in SIDES)
            whole = self.method.arms == "whole"
            found[segment.name] = (
                np.where(self._left_is_worse, left, right) if whole else np.maximum(right, left)
            )
        return found

    @cached_property
    def segments_low(self) -> dict[str, NDArray[np.int64]]:
        """Lowest score (n,) of each segment, with the keys of `segments`.

        ``upper_arm``, ``lower_arm`` and ``wrist`` are those of the arm that counts. Where either
        arm may count, they are the lower score of the two.
        """
        return self._of_arms(self._lowest, np.minimum)

    @cached_property
    def segments_high(self) -> dict[str, NDArray[np.int64]]:
        """Highest score (n,) of each segment, the same; the higher where either arm may count."""
        return self._of_arms(self._highest, np.maximum)

    def _of_body(self, scored: _Scored) -> dict[str, NDArray[np.int64]]:
        seen = scored.final > 0
        return {
            name: np.where(seen, scores, 0).astype(np.int64)
            for name, scores in scored.segments.items()
        }

    def _of_arms(self, scored: _Scored, end: np.ufunc) -> dict[str, NDArray[np.int64]]:
        found = self._of_body(scored)
        right_counts, left_counts = self._may_count
        for segment in self._sheet.of_table("B"):
            right, left = (found[segment.label(side)] for side in SIDES)
            if self.method.arms == "whole":
                either = np.where(left_counts, end(right, left), right)
                found[segment.name] = np.where(right_counts, either, left)
            else:
                found[segment.name] = np.maximum(right, left)
        return found

    def worst(self, time: ArrayLike | None = None) -> int:
        """Return the number of the worst posture.

        It has the highest `final`, which is the score of the likeliest posture; the `final_high`
        of another may be higher. Of several it has the highest sum of score A and score B, and of
        these it is the first of those that are held longest.

        Args:
            time: time of each posture (n,), increasing [s]. None: equal steps.

        Raises:
            InputError: if there is no posture.
        """
        count = len(self.final)
        if not count:
            raise InputError("worst: got no posture, allowed one or more")
        # In blocks, because an hour of the scores of all segments is 40 MB.
        starts = range(0, count, _BLOCK)
        both = np.concatenate([self.rows(slice(i, i + _BLOCK))._scores_a_and_b() for i in starts])
        rank = np.where(self.valid, 1000 * self.final + both, -1)
        top = np.concatenate([[False], rank == rank.max(), [False]])
        begins, ends = np.flatnonzero(np.diff(top.astype(int))).reshape(-1, 2).T
        steps = np.ones(count) if time is None else np.diff(time, append=np.inf)
        # The last posture is held for as long as one step usually takes.
        steps[-1] = np.median(steps[:-1]) if count > 1 else 1.0
        held = np.concatenate([[0.0], np.cumsum(steps)])
        # Rounding must not decide between the same durations.
        return int(begins[np.argmax(np.round(held[ends] - held[begins], 6))])

    def _scores_a_and_b(self) -> NDArray[np.int64]:
        """Return the sum of score A and score B (n,), with load and coupling."""
        points, scores, tables = self._task.points, self.segments, self._sheet.tables
        found = np.zeros(len(self.final), dtype=np.int64)
        for table in "AB":
            axes = (np.maximum(scores[axis], 1) for axis in tables[table].axes)
            found += look_up(self._sheet, table, *axes)
        return found + points["load"] + points["coupling"]

    def reasons(self, i: int) -> list[str]:
        """Return sentences that explain the score of posture `i`.

        The list has a sentence per segment, then the tables, then warnings.

        Args:
            i: number of the posture, from 0 (negative: from the end).

        Raises:
            InputError: if there is no posture with that number.
        """
        i = self._index(i, "reasons")
        posture, task = self.postures[i], self._task.rows(i)
        if not self.valid[i]:
            missing = ", ".join(spoken(JOINTS[j]) for j in np.flatnonzero(np.isnan(posture)))
            return [f"not scored: no angle for {missing}" if missing else "not scored"]
        sentences = [self._segment(segment, side, i) for segment, side in self._sheet.places]
        if self.final_low[i] < self.final_high[i]:
            span = f"{self.final_low[i]} to {self.final_high[i]}"
            sentences.append(f"REBA {span}; for the likeliest posture:")
        sentences += self._composition(i, task)
        for j in np.flatnonzero(self.outside[i]):
            low, high = np.degrees([LOWER[j], UPPER[j]])
            sentences.append(
                f"{spoken(JOINTS[j])} {np.degrees(posture[j]):.3g} deg is beyond its range"
                f" {low:.0f} to {high:.0f}: scored by the outer band"
            )
        return sentences

    def costly(self, i: int) -> list[str]:
        """Return what makes the score of posture `i` higher than 1, or may make it so.

        The list names the segments that are or may be above their lowest score, and the points of
        the task. Of the arms it names only the one that counts, or both where either may. The list
        is empty if the score is 1 in all postures between `low` and `high`, because a segment
        above its lowest score does not always cost a point.

        Args:
            i: number of the posture, from 0 (negative: from the end).

        Raises:
            InputError: if there is no posture with that number.
        """
        i = self._index(i, "costly")
        if not self.valid[i] or self.final_high[i] <= 1:
            return []
        points = {name: int(value) for name, value in self._task.rows(i).points.items()}
        one = self.method.arms == "whole" and self.arm_known[i]
        counts = (str(self.arm[i]),) if one else SIDES
        return [
            self._segment(segment, side, i)
            for segment, side in self._sheet.places
            if side in ("", *counts) and self._highest.segments[segment.label(side)][i] > 1
        ] + [f"{name}: +{value}" for name, value in points.items() if value]

    def _index(self, i: int, what: str) -> int:
        if not -len(self.final) <= i < len(self.final):
            raise InputError(f"{what}: got posture {i}, allowed: 0 to {len(self.final) - 1}")
        return i % len(self.final)

    def _segment(self, segment: Segment, side: str, i: int) -> str:
        label = segment.label(side)
        low, high = (int(each.segments[label][i]) for each in (self._lowest, self._highest))
        ends = self._between(slice(i, i + 1)).transpose(0, 2, 1)
        ends = _as_read_between(self.method, ends)[..., 0]
        if low < high:
            return explain_span(segment, ends, side, low, high)
        return explain_segment(
            segment,
            _as_read(self.method, self.postures[i]),
            ends,
            self._task.rows(i),
            side,
            int(self._best.segments[segment.label(side)][i]),
        )

    @property
    def _sheet(self) -> Sheet:
        return sheet_of(self.method)

    @cached_property
    def _left_is_worse(self) -> NDArray[np.bool_]:
        return self._best.table_b["left"] > self._best.table_b["right"]

    def _composition(self, i: int, task: Task) -> list[str]:
        sheet = self._sheet
        scores = {name: int(scores[i]) for name, scores in self.segments.items()}
        table_a, table_b = (
            int(sheet.tables[t].cells[tuple(scores[axis] - 1 for axis in sheet.tables[t].axes)])
            for t in "AB"
        )
        names = ("load", "coupling", "activity")
        load, coupling, activity = (int(task.points[name]) for name in names)
        score_c = int(sheet.tables["C"].cells[table_a + load - 1, table_b + coupling - 1])
        whole = self.method.arms == "whole"
        source = f"the {self.arm[i]} arm" if whole else "the worse of both arms per segment"
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


def _as_read_between(method: Method, ends: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the ends of joint angles (2, 32, n) [rad] as the method reads them."""
    return ends if method.upper_arm == "flexion" else between_elevations(ends)


def assess_rows(
    postures: NDArray[np.float64],
    method: Method,
    task: Task,
    ends: Ends | None = None,
    scored: NDArray[np.bool_] | None = None,
) -> Assessment:
    """Score checked postures block by block.

    Args:
        postures: shape (n, 32) [rad], from :func:`ergoqp.sheets.angles.read_postures`.
        method: how the sheet is read.
        task: options of these postures.
        ends: lower and upper ends of their angles, as from `read_ends`; None: the postures.
        scored: which of them are scored (n,); None: all without NaN.

    Raises:
        InputError: if an angle is beyond +-180 deg, or not between its ends.
    """
    sheet, count = sheet_of(method), len(postures)
    valid = np.empty(count, dtype=bool)
    best = _empty(sheet, count)
    lowest, highest = (best, best) if ends is None else (_empty(sheet, count), _empty(sheet, count))
    for start in range(0, count, _BLOCK):
        rows = slice(start, min(start + _BLOCK, count))
        angles, options = np.ascontiguousarray(postures[rows].T), task.rows(rows)
        valid[rows] = check_angles(angles, start) & (True if scored is None else scored[rows])
        _score(sheet, method, options, _as_read(method, angles), StepFunction.score, best, rows)
        if ends is not None:
            between = ends(rows)
            both = np.ascontiguousarray(between.transpose(0, 2, 1))
            for name, end in zip(("low", "high"), both, strict=True):
                check_angles(end, start, name)
            check_ends(postures[rows], between, start)
            both = _as_read_between(method, both)
            _score(sheet, method, options, both, StepFunction.lowest, lowest, rows)
            _score(sheet, method, options, both, StepFunction.highest, highest, rows)
    best.final[:] *= valid
    return Assessment(
        postures,
        method,
        best.final,
        lowest.final,
        highest.final,
        valid,
        task,
        best,
        lowest,
        highest,
        ends,
    )


def _empty(sheet: Sheet, count: int) -> _Scored:
    labels = [segment.label(side) for segment, side in sheet.places]
    return _Scored(
        np.empty(count, dtype=np.int64),
        {name: np.empty(count, dtype=np.int8) for name in labels},
        {side: np.empty(count, dtype=np.int8) for side in SIDES},
    )


def _score(
    sheet: Sheet,
    method: Method,
    task: Task,
    angles: NDArray[np.float64],
    read: Read,
    into: _Scored,
    rows: slice,
) -> None:
    """Write the scores of some rows; the cells of the tables are monotone along every axis.

    Args:
        sheet: the sheet.
        method: how it is read.
        task: options of the rows.
        angles: as in `score_segment`.
        read: as in `score_segment`.
        into: the scores of all rows.
        rows: the rows.
    """
    block = score_segments(sheet, angles, task, read)
    arms = {side: score_side(sheet, block, side) for side in SIDES}
    whole = method.arms == "whole"
    worse = np.maximum(*arms.values()) if whole else score_worse_segments(sheet, block)
    table_a = look_up(sheet, "A", *(block[name] for name in sheet.tables["A"].axes))
    into.final[rows] = score_final(sheet, table_a, worse, task.points, method.final_max)
    for name, scores in block.items():
        into.segments[name][rows] = scores
    for side, scores in arms.items():
        into.table_b[side][rows] = scores
