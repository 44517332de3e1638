"""Tables of joint or marker positions: a column for each coordinate, a row for each frame.

Depth cameras and body trackers write such tables (Kinect, Nuitrack, ZED, MediaPipe), and so do
motion-capture programs. Names stand before the coordinate ("NECK.x", "neck_x", "neck x (mm)"), or
in a row above the coordinates. Several people may have a row each per frame, with a column that
states the person.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from ergoqp.arguments import Progress
from ergoqp.errors import RecordingError
from ergoqp.mocap.formats.columns import (
    ClockTimeParser,
    ColumnLayout,
    ConfidenceFilter,
    People,
    layout_from_header,
    layout_without_header,
    parse_tracking_state,
    side_by_side,
)
from ergoqp.mocap.formats.text import (
    EMPTY,
    ChosenColumn,
    TableOptions,
    TextLines,
    cells,
    commas,
    is_nothing,
    is_number,
    points_of,
    read_rows,
    separator_of,
    short,
    some,
    text_lines,
)
from ergoqp.mocap.formats.times import FASTEST, SLOWEST, count_repeated_frames, uniform_times
from ergoqp.mocap.recording import JointMotion, with_times

_HEADER_LINES: Final = 20
"""Largest number of lines above the numbers that are not empty; Qualisys writes twelve."""
_BLANK: Final = 1000
"""Largest number of empty lines above the numbers."""
_RATE: Final = "; or state the frames per second (rate)"


def read_table(path: Path, progress: Progress, asked: TableOptions) -> JointMotion:
    """Return the points of a table of positions.

    Positions with a low confidence are taken as not seen, if the table states a confidence. With
    several people, the names of the points get the person as a prefix: "2:NECK".

    Args:
        path: the file.
        progress: is called with the share of the file that is read.
        asked: names of the columns, if the file has none, and frames per second, used instead of
            its times.

    Raises:
        RecordingError: if it is not such a table, with the line.
    """
    with text_lines(path, progress) as lines:
        header, first, line = _read_header(lines)
        separator = separator_of(first, *reversed(header))
        words, named = cells(first, separator), [cells(row, separator) for row in header]
        if header:
            _check_width(lines, named, words, separator, line)
        layout = (
            layout_from_header(lines, named, len(words))
            if header
            else layout_without_header(lines, words, asked)
        )
        rate = asked.rate
        if layout.time is None and rate is None and (rate := _stated_rate(named)) is None:
            raise RecordingError(
                f"{path.name}: got no column of times, allowed one that is called time or"
                f" timestamp{_RATE}"
            )
        table = _Table(path.name, layout, rate, words)
        chosen = table.chosen(lines, line)
        arrays = read_rows(
            lines,
            separator,
            layout.width,
            lambda rows: table.split(rows, lines.share),
            layout.time is None,
            chosen,
        )
    notes = table.unread()
    if header and asked.columns:
        notes.append("The stated names (columns) are not used: the table has its own.")
    return replace(table.motion(*arrays, notes=notes), columns=table.columns())


def _stated_rate(header: list[list[str]]) -> float | None:
    """Return the rate [Hz] that a row of the head states, as in "100,Hz"; None if none does."""
    for row in header:
        word, *unit = " ".join(row).replace(",", ".").split() or [""]
        if unit == ["Hz"] and is_number(word) and SLOWEST <= float(word) <= FASTEST:
            return float(word)
    return None


def _check_width(
    lines: TextLines, header: list[list[str]], first: list[str], separator: str | None, line: int
) -> None:
    """Raise if a row of numbers is wider than the head, whose names would be of other columns.

    Args:
        lines: the file, for messages.
        header: the rows above the numbers, in words.
        first: the first row of numbers, in words.
        separator: separator of the columns.
        line: number of the line of that row.
    """
    width = max(map(len, header))
    count = max((i for i, word in enumerate(first, 1) if word), default=0)
    if count > width:
        way = commas(separator, count, width) or "; name every column"
        lines.fail(
            f"got a row of {count} numbers below a head of {width} names, allowed as many{way}",
            line,
        )


class _Table:
    """The numbers of a table, as they are read."""

    def __init__(
        self, where: str, layout: ColumnLayout, rate: float | None, words: list[str]
    ) -> None:
        """Begin before the first row of numbers, whose words are given."""
        self._where, self._layout, self._rate, self._words = where, layout, rate, words
        self._texts = {
            i for i, word in enumerate(words) if not is_nothing(word) and not is_number(word)
        }
        self._people = People()
        self._confidence = ConfidenceFilter(layout.confidence)
        named = [*layout.points.items(), *layout.again]
        self._names = tuple(name for name, _ in named)
        self._points = [column for _, columns in named for column in columns]
        several = layout.whose is not None
        # Frame numbers identify the frames of several people, however coarse the times are.
        self._numbered = (
            several and layout.frame is not None and (layout.time is None or rate is not None)
        )
        if self._numbered:
            self._key = layout.frame
        else:
            self._key = layout.time if rate is None or several else None
        self._fine = layout.fine if self._key is not None and not self._numbered else None

    def chosen(self, lines: TextLines, line: int) -> list[ChosenColumn]:
        """Return the columns that are read.

        Args:
            lines: the file, for messages.
            line: number of the line of the first row of numbers.

        Raises:
            RecordingError: if there is a word in place of a number.
        """
        layout, key, texts = self._layout, self._key, self._texts
        if wrong := [column for column in self._points if column in texts]:
            lines.fail(
                f"got {short(self._words[wrong[0]])} in the column"
                f" {short(layout.name_of(wrong[0]))}, allowed a number",
                line,
            )
        columns: list[ChosenColumn] = [(column, None) for column in self._points]
        for each in layout.confidence:
            columns.append((each.column, parse_tracking_state if each.column in texts else None))
        if key is not None:
            columns.append((key, ClockTimeParser(layout.name_of(key)) if key in texts else None))
        if self._fine is not None:
            columns.append((self._fine, None))
        if layout.whose is not None:
            columns.append((layout.whose, self._people))
        return columns

    def columns(self) -> dict[str, str]:
        """Return the column of the table that is no coordinate -> what it is used as."""
        layout = self._layout
        used = {each.column: "confidence" for each in layout.confidence}
        used |= {
            column: what
            for column, what in (
                (layout.time if self._rate is None else None, "time"),
                (self._fine, "time"),
                (layout.frame if self._numbered else None, "frame"),
                (layout.whose, "person"),
            )
            if column is not None
        }
        points = set(self._points)
        every = range(min(layout.width, len(layout.names)))
        return {layout.names[i]: used.get(i, "") for i in every if i not in points}

    def unread(self) -> list[str]:
        """Return a sentence with the columns that are not read although a user may expect it."""
        layout = self._layout
        used = {*self._points, *(each.column for each in layout.confidence)}
        used |= {layout.time, layout.fine, layout.frame, layout.whose}
        if not (columns := sorted({*layout.unread, *(self._texts - used)})):
            return []
        if len(columns) == 1:
            return [f"The column {layout.name_of(columns[0])} is not read."]
        return [f"The columns {some([layout.name_of(each) for each in columns], 6)} are not read."]

    def split(self, rows: np.ndarray, share: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return positions (n, m, 3), keys (n,) and people (n,) of rows of the chosen columns.

        Args:
            rows: the rows.
            share: share of the file that is read up to them.
        """
        first = len(self._points) + len(self._layout.confidence)
        if self._layout.confidence:
            self._confidence.add(rows[:, len(self._points) : first], share)
        keys = rows[:, first] if self._key is not None else np.zeros(len(rows))
        if self._fine is not None:
            keys = keys + 1e-9 * rows[:, first + 1]
        return points_of(rows[:, : len(self._points)]), keys, rows[:, -1]

    def motion(
        self, positions: np.ndarray, stamps: np.ndarray, whose: np.ndarray, notes: list[str]
    ) -> JointMotion:
        """Return the motion that was read, with further sentences.

        Args:
            positions: positions of the points (n, m, 3).
            stamps: times or numbers of the frames (n,), if there are any.
            whose: numbers of the people (n,), if there are any.
            notes: further sentences.
        """
        layout, names = self._layout, self._names
        if layout.time is None:
            # The frames after the last one in which a point is seen are not counted.
            last = len(positions)
            while last > 1 and np.isnan(positions[last - 1]).all():
                last -= 1
            positions, stamps = positions[:last], stamps[:last]
        keys = stamps if self._key is not None else None
        notes += self._confidence.mask_low_confidence(positions)
        numbered = False
        if layout.whose is not None and self._people.are_several(keys):
            if keys is None:
                raise RecordingError(
                    f"{self._where}: got the rows of {len(self._people.labels)} people without"
                    " times, allowed a column of times, or a column of frame numbers and stated"
                    " frames per second (rate)"
                )
            names, positions, keys, said = side_by_side(
                self._where,
                names,
                positions,
                whose[: len(positions)],
                self._people,
                keys,
                _RATE if layout.frame is not None else "",
            )
            notes += said
            numbered = self._numbered
        elif layout.whose is not None and (self._people.counts or len(self._people.labels) > 1):
            notes.append(
                f"The column {layout.name_of(layout.whose)} has another value in each row and is"
                " not used."
            )
        if self._rate is None:
            assert keys is not None
            motion = JointMotion(names, positions, keys, notes=tuple(notes), unit=layout.unit)
            return with_times(self._where, motion.once(), layout.tick, remedy=_RATE)
        time, said = uniform_times(self._where, len(positions), self._rate)
        if keys is not None and numbered:
            time = (keys - keys[0]) / self._rate
        if layout.time is not None:
            said.append(
                f"The times of the column {layout.name_of(layout.time)} are not used: the frames"
                " per second are stated (rate)."
            )
        notes = [*said, *notes, *count_repeated_frames(positions)]
        return JointMotion(names, positions, time, notes=tuple(notes), unit=layout.unit).once()


def _read_header(lines: TextLines) -> tuple[list[str], str, int]:
    """Return the rows above the numbers that are not empty, the first row of numbers and its line.

    The first row of numbers remains to be read, and so do empty rows above it, which may be frames.
    The numbers begin with the first of a run of rows that are mostly numbers.
    """
    header: list[str] = []
    rows: list[str] = []
    numbers, empty = 0, 0
    while len(header) + numbers < _HEADER_LINES and empty < _BLANK:
        taken = lines.take(1)
        if not taken and numbers:
            break
        row = taken[0] if taken else lines.next("a row of numbers")
        rows.append(row)
        if not row.strip(EMPTY):
            # Empty rows are taken together, because there may be many before anybody is seen.
            more = lines.take(max(_BLANK - empty - 1, 1))
            end = next((i for i, each in enumerate(more) if each.strip(EMPTY)), len(more))
            lines.put_back(*more[end:])
            rows += more[:end]
            empty += sum(not each.strip() for each in [row, *more[:end]])
            continue
        words = [word.strip('"') for word in re.split(r"[\s,;]+", row.strip(EMPTY))]
        seen = [word for word in words if not is_nothing(word)]
        known = sum(map(is_number, seen))
        if seen and known == len(seen):
            numbers += 1
            break
        if known >= 3 and 2 * known >= len(seen):
            numbers += 1
            continue
        header += [each for each in rows if each.strip(EMPTY)]
        rows, numbers = [], 0
    if not numbers:
        lines.fail(f"got {lines.line} lines without a row of numbers, allowed a table of positions")
    lines.put_back(*rows)
    at, first = next((i, row) for i, row in enumerate(rows, 1) if row.strip(EMPTY))
    return header, first, lines.line + at
