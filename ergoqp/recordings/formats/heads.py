"""Meaning of the columns in a table of positions, from the rows above the numbers."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final

from ergoqp.recordings.formats.opening import short, some
from ergoqp.recordings.formats.row_people import is_whose
from ergoqp.recordings.formats.rows import Asked
from ergoqp.recordings.formats.stamps import tick_of, time_head
from ergoqp.recordings.formats.sureness import Sure
from ergoqp.recordings.formats.text_lines import TextLines
from ergoqp.recordings.names import squashed

_LONGEST: Final = 100
"""Largest number of letters in a name; longer words are ignored, because parsing them is slow."""
_AXIS: Final = re.compile(r"t?(?P<axis>[xyz])\d*", re.IGNORECASE)
_COLUMN: Final = re.compile(
    r"(?P<name>.*?)[\s._:/-]*(?:pos(?:ition)?[\s._:/-]*|(?<=[\s._:/-])t)?(?P<axis>[xyz])\d*"
    r"\s*(?:[\[(](?P<unit>[a-zµ]*)[\])])?",
    re.IGNORECASE,
)
_NO_PLACE: Final = re.compile(
    r"(?:(?:.*[\s._:/-])?(?i:q|quat|quaternion|rot|rotation|ori|orient|orientation|euler|angles?|"
    r"vel|velocity|acc|accel|acceleration|gyro|mag)|.*(?:Quat|Quaternion|Rot|Rotation|Orientation|"
    r"Vel|Velocity|Acc|Acceleration))"
)
"""Names of columns with x, y and z that are not positions."""
_OTHER: Final = re.compile(
    r"(?:q|quat|quaternion|rot|rotation|ori|orient|orientation|euler|angles?|v|vel|velocity|a|acc|"
    r"accel|acceleration|w|gyro|mag|roll|pitch|yaw|(?:joint[\s_]?)?id)[\s._:/-]*[wxyz0-3]?",
    re.IGNORECASE,
)
"""Known heads of a joint's columns that are neither positions nor confidences."""
_SURE: Final = re.compile(
    r"(?P<name>.*?)[\s._:/-]*(?P<head>confidence(?:[\s_]?level)?|visibility|likelihood|score|"
    r"quality|(?:joint)?tracking[\s_]?state|(?:(?<=[\s._:/-])|\A)(?:conf|state|tracked|valid|"
    r"visible|probability|prob|p|c))\s*(?:[\[(].*[\])])?",
)
_FRAMES: Final = frozenset({"frame", "frameid", "frameno", "framenumber", "frame#", "frameindex"})
_NANO: Final = re.compile(r"(?P<stem>(?:.*[\s._:/-])?)(?:nano_?sec(?:ond)?s?|nsecs?)", re.I)
_METRES: Final = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}


@dataclass(frozen=True)
class Layout:
    """Meaning of the columns of a table.

    Attributes:
        points: name -> the columns of x, y and z.
        width: number of columns.
        heads: names of the columns in messages.
        sure: the confidence columns.
        time: the column of the times, or None.
        fine: the column of nanoseconds that are added to the times, or None.
        tick: unit of the times [s], or None.
        frame: the column of the frame numbers, or None.
        whose: the column that states the person of a row, or None.
        unit: unit of length [m], or None.
        unread: columns of points whose meaning is unknown.
    """

    points: dict[str, tuple[int, int, int]]
    width: int
    heads: Sequence[str] = ()
    sure: Sequence[Sure] = ()
    time: int | None = None
    fine: int | None = None
    tick: float | None = None
    frame: int | None = None
    whose: int | None = None
    unit: float | None = None
    unread: Sequence[int] = ()

    def head(self, column: int) -> str:
        """Return the name of a column for messages."""
        named = self.heads[column] if column < len(self.heads) else ""
        return named or f"number {column + 1}"


@dataclass
class _Found:
    """Meaning of the words in the row of names, by column."""

    axes: dict[str, dict[str, int]] = field(default_factory=dict)
    twice: dict[str, str] = field(default_factory=dict)
    sure: list[tuple[str, str, int]] = field(default_factory=list)
    others: list[int] = field(default_factory=list)
    time: int | None = None
    frame: int | None = None
    whose: int | None = None
    unit: float | None = None
    tick: float | None = None

    def add(self, column: int, word: str) -> None:
        """Add a column with its word."""
        is_time, tick = time_head(word)
        bare = squashed(word)
        if is_time:
            if self.time is None:
                self.time, self.tick = column, tick or self.tick
        elif is_whose(bare):
            self.whose = column if self.whose is None else self.whose
        elif bare in _FRAMES:
            self.frame = column if self.frame is None else self.frame
        elif sure := _SURE.fullmatch(word.lower()):
            self.sure.append((sure["name"], sure["head"], column))
        elif (match := _COLUMN.fullmatch(word)) and _is_place(name := match["name"]):
            axes = self.axes.setdefault(name, {})
            if match["axis"].lower() in axes:
                self.twice.setdefault(name, word)
            axes[match["axis"].lower()] = column
            self.unit = _METRES.get((match["unit"] or "").lower(), self.unit)
        else:
            self.others.append(column)


def layout_of(lines: TextLines, head: list[list[str]], width: int) -> Layout:
    """Return the layout that the rows above the numbers state.

    Args:
        lines: the file, for messages.
        head: the rows, in words.
        width: number of words in the first row of numbers.

    Raises:
        RecordingError: if they name no points.
    """
    head, unit, tick = _without_units(head)
    row = _named(head)
    found = _Found(unit=unit, tick=tick)
    for column, word in enumerate(row):
        if len(word) <= _LONGEST:
            found.add(column, word)
    points = {
        name: (axes["x"], axes["y"], axes["z"])
        for name, axes in found.axes.items()
        if len(axes) == 3
    }
    if not points:
        lines.fail(
            f"got the columns {some([short(word) for word in row if word], 6)}, allowed three"
            " columns for each joint, such as neck.x, neck.y, neck.z"
        )
    if again := [word for name, word in found.twice.items() if name in points]:
        lines.fail(f"got the column {short(again[0])} twice, allowed each once")
    alike: dict[str, list[int]] = {}
    for i, name in enumerate(points):
        alike.setdefault(name.lower(), []).append(i)
    sure = [Sure(column, i, head) for stem, head, column in found.sure for i in alike.get(stem, ())]
    time, fine = _with_nanoseconds(row, found.time)
    return Layout(
        points,
        max(width, len(row)),
        row,
        sure,
        time,
        fine,
        found.tick if fine is None else 1.0,
        found.frame,
        found.whose,
        found.unit,
        _unread(row, points, found.others),
    )


def layout_asked(lines: TextLines, first: list[str], asked: Asked) -> Layout:
    """Return the layout of a table without names.

    Args:
        lines: the file, for messages.
        first: its first row of numbers.
        asked: the names.

    Raises:
        RecordingError: if there are no names, or their number is not a third of the numbers.
    """
    line, width = lines.line + 1, 3 * len(asked.columns)
    while len(first) > width and not first[-1]:
        first.pop()
    if not asked.columns:
        lines.fail(
            f"got {len(first)} numbers and no names above them, allowed a row of names; or state"
            " the names of the points in their order (columns)",
            line,
        )
    if len(set(asked.columns)) < len(asked.columns):
        lines.fail("columns: got a name twice, allowed different names", line)
    if width != len(first):
        lines.fail(
            f"got {len(first)} numbers and {len(asked.columns)} names (columns), allowed three"
            " numbers for each name",
            line,
        )
    points = {name: (3 * i, 3 * i + 1, 3 * i + 2) for i, name in enumerate(asked.columns)}
    return Layout(points, width)


def _without_units(
    head: list[list[str]],
) -> tuple[list[list[str]], float | None, float | None]:
    """Return the rows without a last row of units, and its units of length [m] and time [s]."""
    units = [word.strip("[]()").lower() for word in head[-1] if word]
    lengths = [_METRES[word] for word in units if word in _METRES]
    ticks = [tick_of(word) for word in units if word not in _METRES]
    if len(head) > 1 and lengths and None not in ticks:
        return head[:-1], lengths[-1], ticks[0] if ticks else None
    return head, None, None


def _named(head: list[list[str]]) -> list[str]:
    """Return the names of the columns; the joints' names may be in a row above the axes."""
    row = head[-1]
    axes = [_AXIS.fullmatch(word) for word in row]
    if len(head) < 2 or sum(map(bool, axes)) < 3:
        return row
    above = [*head[-2], *[""] * len(row)][: len(row)]
    return [
        f"{name}.{axis['axis'] if axis else word}"
        if axis or _SURE.fullmatch(word.lower())
        else f"{over} ({word})"
        if tick_of(word) and time_head(over)[0]
        else word or over
        for name, over, word, axis in zip(_spread(above), above, row, axes, strict=True)
    ]


def _is_place(name: str) -> bool:
    return bool(name) and not _NO_PLACE.fullmatch(name)


def _spread(names: list[str]) -> list[str]:
    """Return the names above the coordinates, one per column; a blank repeats the last name."""
    found, last = [], ""
    for name in names:
        last = name or last
        found.append(last.removeprefix("Name:"))
    return found


def _with_nanoseconds(row: list[str], time: int | None) -> tuple[int | None, int | None]:
    """Return the columns of the times and of nanoseconds that belong to a column of seconds."""
    places = {word.lower(): column for column, word in reversed(list(enumerate(row)))}
    for word, column in reversed(places.items()):
        if len(word) <= _LONGEST and (match := _NANO.fullmatch(word)):
            for seconds in ("sec", "secs", "second", "seconds"):
                whole = places.get(match["stem"] + seconds)
                if whole is not None and time in {None, whole}:
                    return whole, column
    return time, None


def _unread(row: list[str], points: Iterable[str], others: list[int]) -> list[int]:
    """Return the columns that belong to a point by their heads, but have no known meaning."""
    known = {name.lower() for name in points}
    found = []
    for column in others:
        word = row[column].lower()
        ends = [mark.start() for mark in re.finditer(r"[\s._:/-]", word)]
        if any(
            word[:end].rstrip(" ._:/-") in known and not _OTHER.fullmatch(word[end + 1 :])
            for end in ends
        ):
            found.append(column)
    return found
