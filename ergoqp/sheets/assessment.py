"""Exact scores of many postures: the final scores at once, all details and reasons on demand.

Exact scores by a sheet, vectorised: angles give segment scores, tables give the final score. The
functions take a block of joint angles with one contiguous row per joint, so that each comparison
runs over a whole row of postures. All scores are int8.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Final, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ergoqp.errors import InputError
from ergoqp.joints import JOINTS, LOWER, SIDES, UPPER, spoken
from ergoqp.sheets.description import (
    TIE,
    Segment,
    Sheet,
    StepFunction,
    between_elevations,
    by_elevation,
)
from ergoqp.sheets.options import Method, Task, sheet_of

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


_DECIMALS: Final = 4
"""Decimals [deg] to which 32-bit numbers are read; they may be off by 0.00002 deg."""


def read_postures(postures: ArrayLike) -> NDArray[np.float64]:
    """Return postures as a read-only array of shape (n, 32) [rad] that no other code can write to.

    32-bit numbers are rounded to the nearest 0.0001 deg, so that 60 deg are 60 deg.

    An array that already is read-only and owns its data is not copied: an hour of postures is
    110 MB.

    Args:
        postures: shape (n, 32) or (32,).

    Raises:
        InputError: if they are not numbers of that shape.
    """
    try:
        rows = postures if _is_final(postures) else np.array(postures, dtype=float, order="C")
        if rows is not postures and np.asarray(postures).dtype == np.float32:
            rows = np.radians(np.round(np.degrees(rows), _DECIMALS))
    except (TypeError, ValueError) as error:
        raise InputError(
            f"postures: got no array of numbers ({error}), allowed: shape (n, 32) or (32,) rad"
        ) from None
    if rows.shape == (len(JOINTS),):
        rows = rows[np.newaxis]
    if rows.ndim != 2 or rows.shape[1] != len(JOINTS):
        raise InputError(
            f"postures: got shape {rows.shape}, allowed: shape (n, 32) or (32,) rad, in the order"
            " of JOINTS"
        )
    rows.setflags(write=False)
    return rows


def read_ends(
    postures: NDArray[np.float64], low: ArrayLike | None, high: ArrayLike | None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lower and upper ends of joint angles (n, 32) [rad].

    Args:
        postures: from `read_postures`.
        low: shape (n, 32) or (32,) [rad]; NaN: the angle is unknown. None: the postures.
        high: the same.

    Raises:
        InputError: if they are not such numbers, or a posture is not between them.
    """
    ends = []
    for name, given, unknown in (("low", low, LOWER), ("high", high, UPPER)):
        rows = postures if given is None else read_postures(given)
        if rows.shape != postures.shape:
            raise InputError(
                f"{name}: got shape {rows.shape}, allowed: that of postures, {postures.shape}"
            )
        # A known angle may be beyond the range of its joint.
        beyond = (np.fmin if name == "low" else np.fmax)(unknown, postures)
        ends.append(np.where(np.isnan(rows), beyond, rows))
    wrong = (ends[0] > ends[1] + TIE) | (postures < ends[0] - TIE) | (postures > ends[1] + TIE)
    if wrong.any():
        row, joint = (int(each[0]) for each in np.nonzero(wrong))
        got = ", ".join(f"{each[row, joint]:g}" for each in (ends[0], postures, ends[1]))
        raise InputError(
            f"low, high: row {row}, {JOINTS[joint]}: got low, posture and high of {got} rad,"
            " allowed: ascending"
        )
    return ends[0], ends[1]


def _is_final(postures: ArrayLike) -> TypeGuard[NDArray[np.float64]]:
    """Return whether this is an array of numbers that owns its data and cannot be written to."""
    return (
        type(postures) is np.ndarray
        and postures.base is None
        and not postures.flags.writeable
        and postures.dtype == np.float64
        and postures.flags.c_contiguous
    )


def check_angles(angles: NDArray[np.float64], first_row: int) -> NDArray[np.bool_]:
    """Return which postures of a block have no NaN, shape (n,).

    Args:
        angles: shape (32, n), one row per joint [rad].
        first_row: number of the block's first posture, for the message.

    Raises:
        InputError: if an angle is beyond +-180 deg or infinite.
    """
    count = angles.shape[1]
    # Fast path for the usual case. A NaN fails both comparisons.
    if count == 0 or (angles.min() >= -np.pi and angles.max() <= np.pi):
        return np.ones(count, dtype=bool)
    beyond = np.abs(angles) > np.pi + TIE
    if beyond.any():
        row = int(np.argmax(beyond.any(axis=0)))
        joint = int(np.argmax(beyond[:, row]))
        raise InputError(
            f"postures: row {first_row + row}, {JOINTS[joint]}: got {angles[joint, row]:g} rad,"
            " allowed: -pi to pi (degrees given as radians?)"
        )
    return np.logical_not(np.isnan(angles).any(axis=0))


def explain_segment(
    segment: Segment, posture: NDArray[np.float64], task: Task, side: str, score: int
) -> str:
    """Return a sentence that explains the score of a segment.

    An example is ``"neck 24 deg flexion, over 20: 2; twisted left 15 deg: +1"``.

    Args:
        segment: the segment.
        posture: one posture, shape (32,) [rad].
        task: options of this posture, single values.
        side: ``"right"``, ``"left"`` or ``""``.
        score: the exact score. It is named at the end if a clamp changed the sum.
    """
    joint_side = _worse_side(segment, posture) if segment.worse_side else side
    angle = float(posture[segment.joint(segment.base, joint_side)])
    base = segment.base.scores[segment.base.band(angle)]
    if segment.skipped_by is not None and task.flag(segment.skipped_by, side):
        parts = [f"{segment.label(side)} {segment.skipped_by}: {segment.start}"]
        total = segment.start
    else:
        total = segment.start + base
        name = segment.label(side) + (f", {joint_side} knee" if segment.worse_side else "")
        parts = [f"{name} {_amount(segment.base, angle)}, {_band(segment.base, angle)}: {total}"]
    for modifier in segment.modifiers:
        met = []
        for step in modifier.conditions:
            value = float(posture[segment.joint(step, side)])
            if step.scores[step.band(value)]:
                met.append(f"{_word(step, value)} {_magnitude(step, value)} deg")
        if met and not modifier.additive:
            met = [" and ".join(met)]
        parts += [f"{one}: +1" for one in met]
        total += len(met)
    for option in segment.options:
        blocked = option.not_with is not None and bool(task.flag(option.not_with, side))
        if task.flag(option.option, side) and not blocked:
            parts.append(f"{option.words}: {option.points:+d}")
            total += option.points
    if total != score:
        parts.append(f"{'at least' if total < score else 'at most'} {score}: {score - total:+d}")
    return "; ".join(parts).replace("_", " ")


def explain_span(
    segment: Segment, ends: NDArray[np.float64], side: str, low: int, high: int
) -> str:
    """Return a sentence that explains the lowest and the highest score of a segment.

    An example is ``"legs 1 to 3: right knee flexion not known"``.

    Args:
        segment: the segment.
        ends: lower and upper ends of the joint angles (2, 32) [rad].
        side: ``"right"``, ``"left"`` or ``""``.
        low: lowest score.
        high: highest score.
    """
    causes = {}
    for step in segment.steps:
        for each in SIDES if segment.worse_side and step is segment.base else (side,):
            joint = segment.joint(step, each)
            least, most = (int(end(ends[:, joint])) for end in (step.lowest, step.highest))
            if least < most:
                causes[joint] = f"{spoken(JOINTS[joint])} {_known_to(ends[:, joint], joint)}"
    return f"{segment.label(side)} {low} to {high}: {', '.join(causes.values())}".replace("_", " ")


def _known_to(ends: NDArray[np.float64], joint: int) -> str:
    """Return in words what is known of an angle between two ends (2,) [rad]."""
    if ends[0] <= LOWER[joint] + TIE and ends[1] >= UPPER[joint] - TIE:
        return "not known"
    low, high = np.degrees(ends)
    return f"{low:.0f} to {high:.0f} deg"


def _worse_side(segment: Segment, posture: NDArray[np.float64]) -> str:
    def score(side: str) -> int:
        return segment.base.scores[
            segment.base.band(float(posture[segment.joint(segment.base, side)]))
        ]

    return max(SIDES, key=score)


def _amount(step: StepFunction, angle: float) -> str:
    return f"{_magnitude(step, angle)} deg {_word(step, angle)}"


def _word(step: StepFunction, angle: float) -> str:
    return step.words[angle >= 0]


def _magnitude(step: StepFunction, angle: float) -> str:
    """Return the size of an angle with the fewest decimals that keep it in its band.

    This avoids sentences such as "20, over 20".
    """
    degrees = float(np.degrees(angle))
    for decimals in range(9):
        shown = round(degrees, decimals)
        if step.band(float(np.radians(shown))) == step.band(angle):
            return f"{abs(shown):.{decimals}f}"
    return f"{abs(degrees):.9f}"


def _band(step: StepFunction, angle: float) -> str:
    """Return the band of an angle by its ends, in the direction of the angle."""
    band = step.band(angle)
    ends = [-np.inf, *np.degrees(step.edges), np.inf]
    low, high = ends[band], ends[band + 1]
    if high == np.inf:
        return f"over {low:.4g}"
    if low == -np.inf:
        return f"over {-high:.4g}" if high <= 0 else f"under {high:.4g}"
    if high <= 0:
        return f"{-high:.4g} to {-low:.4g}"
    if low < 0:
        both = f"{-low:.4g} {step.words[0]} to {high:.4g} {step.words[1]}"
        return f"within {high:.4g}" if low == -high else both
    return f"{low:.4g} to {high:.4g}"


_BLOCK: Final = 2048
"""Postures per block: 32 rows of float64 stay within the second-level cache."""


@dataclass(frozen=True, eq=False)
class _Scored:
    """Scores of n postures: final (n,), of each segment, and of table B for each arm."""

    final: NDArray[np.int64]
    segments: dict[str, Scores8]
    table_b: dict[str, Scores8]


@dataclass(frozen=True, eq=False)
class Assessment:
    """REBA scores of n postures. An invalid posture (NaN) has 0 everywhere and level -1.

    Attributes:
        postures: the postures, shape (n, 32) [rad], read-only.
        low: lower ends of the joint angles, shape (n, 32) [rad]; the postures if none are given.
        high: upper ends, the same.
        method: how the sheet was read.
        final: REBA score (n,), 1 to 15, and 0 when invalid; int [points].
        final_low: lowest score of all postures between `low` and `high` (n,); int [points]. It is
            given for an invalid posture, too, if there are such ends.
        final_high: highest score of them (n,); int [points].
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
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    method: Method
    final: NDArray[np.int64]
    final_low: NDArray[np.int64]
    final_high: NDArray[np.int64]
    valid: NDArray[np.bool_]
    _task: Task
    _best: _Scored
    _lowest: _Scored
    _highest: _Scored

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

        The arm segments without a side are those of an arm that can be the one that counts.
        """
        return self._of_arms(self._lowest, np.minimum)

    @cached_property
    def segments_high(self) -> dict[str, NDArray[np.int64]]:
        """Highest score (n,) of each segment, the same."""
        return self._of_arms(self._highest, np.maximum)

    def _of_body(self, scored: _Scored) -> dict[str, NDArray[np.int64]]:
        seen = scored.final > 0
        return {
            name: np.where(seen, scores, 0).astype(np.int64)
            for name, scores in scored.segments.items()
        }

    def _of_arms(self, scored: _Scored, end: np.ufunc) -> dict[str, NDArray[np.int64]]:
        found = self._of_body(scored)
        low, high = self._lowest.table_b, self._highest.table_b
        # Of two equal arms the right one counts.
        right_counts, left_counts = high["right"] >= low["left"], high["left"] > low["right"]
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
        posture, task = self.postures[i], self._task.rows(i)
        if not self.valid[i]:
            missing = ", ".join(spoken(JOINTS[j]) for j in np.flatnonzero(np.isnan(posture)))
            return [f"not scored: no angle for {missing}"]
        sentences = [self._segment(segment, side, i) for segment, side in self._sheet.places]
        if self.final_low[i] < self.final_high[i]:
            sentences.append(f"REBA of the likeliest posture, of {self._span(i)} that it may be:")
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
        return [
            self._segment(segment, side, i)
            for segment, side in self._sheet.places
            if side in ("", *counts) and self._best.segments[segment.label(side)][i] > 1
        ] + [f"{name}: +{value}" for name, value in points.items() if value]

    def _index(self, i: int, what: str) -> int:
        if not -len(self.final) <= i < len(self.final):
            raise InputError(f"{what}: got posture {i}, allowed: 0 to {len(self.final) - 1}")
        return i % len(self.final)

    def _span(self, i: int) -> str:
        return f"{self.final_low[i]} to {self.final_high[i]}"

    def _segment(self, segment: Segment, side: str, i: int) -> str:
        label = segment.label(side)
        low, high = (int(each.segments[label][i]) for each in (self._lowest, self._highest))
        if low < high:
            ends = np.stack([self.low[i], self.high[i]])[:, :, None]
            return explain_span(
                segment, _as_read_between(self.method, ends)[..., 0], side, low, high
            )
        return explain_segment(
            segment,
            _as_read(self.method, self.postures[i]),
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
    ends: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None,
) -> Assessment:
    """Score checked postures block by block.

    Args:
        postures: shape (n, 32) [rad], from :func:`ergoqp.sheets.assessment.read_postures`.
        method: how the sheet is read.
        task: options of these postures.
        ends: lower and upper ends of their angles, from `read_ends`; None: the postures.

    Raises:
        InputError: if an angle is beyond +-180 deg.
    """
    sheet, count = sheet_of(method), len(postures)
    valid = np.empty(count, dtype=bool)
    best = _empty(sheet, count)
    lowest, highest = (best, best) if ends is None else (_empty(sheet, count), _empty(sheet, count))
    for start in range(0, count, _BLOCK):
        rows = slice(start, min(start + _BLOCK, count))
        angles, options = np.ascontiguousarray(postures[rows].T), task.rows(rows)
        valid[rows] = check_angles(angles, start)
        _score(sheet, method, options, _as_read(method, angles), StepFunction.score, best, rows)
        if ends is not None:
            both = np.stack([end[rows].T for end in ends])
            for end in both:
                check_angles(end, start)
            both = _as_read_between(method, both)
            _score(sheet, method, options, both, StepFunction.lowest, lowest, rows)
            _score(sheet, method, options, both, StepFunction.highest, highest, rows)
    best.final[:] *= valid
    low, high = ends or (postures, postures)
    finals = (each.final for each in (best, lowest, highest))
    return Assessment(postures, low, high, method, *finals, valid, task, best, lowest, highest)


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
