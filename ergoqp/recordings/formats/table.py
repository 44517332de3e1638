"""Tables of joint or marker positions: a column for each coordinate, a row for each frame.

Depth cameras and body trackers write such tables (Kinect, Nuitrack, ZED, MediaPipe), and so do
motion-capture programs. Names stand before the coordinate ("NECK.x", "neck_x", "neck x (mm)"), or
in a row above the coordinates.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.progress import Progress
from ergoqp.recordings.formats.opening import binary, short, some
from ergoqp.recordings.formats.rows import (
    Asked,
    Gathered,
    TextLines,
    blocks,
    cells,
    is_nothing,
    is_number,
    separator_of,
)
from ergoqp.recordings.formats.stamps import repeated, seconds, steady
from ergoqp.recordings.motion import JointMotion

_HEAD: Final = 20
"""Lines above the numbers that are not empty, at most: Qualisys writes twelve."""
_BLANK: Final = 1000
"""The same where most lines are empty."""
_LONGEST: Final = 100
"""Letters in a name, at most: what is longer is no name, and slow to be taken apart."""
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
"""How names of columns with x, y and z end that are no places."""
_UNIT: Final = r"s|sec|seconds|ms|msec|milliseconds|us|µs|usec|microseconds|ns|nsec|nanoseconds"
_TIMES: Final = re.compile(
    r"(?:time[\s_]?stamps?|time|ts?|sec|seconds)"
    rf"(?:\s*[\[(]\s*(?P<unit>{_UNIT})\s*[\])]|[\s_.]+(?P<tail>{_UNIT}))?",
    re.IGNORECASE,
)
_SURE: Final = re.compile(
    r"(?P<name>.*?)[\s._:/-]*(?:confidence|visibility|likelihood|score|quality)"
)
_SECONDS: Final = {"s": 1.0, "m": 1e-3, "u": 1e-6, "μ": 1e-6, "n": 1e-9}
"""First letter of a unit of time -> it [s]; the letter my is the Greek one, as `casefold` says."""
_METRES: Final = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}


@dataclass(frozen=True)
class Layout:
    """What the columns of a table are.

    Attributes:
        points: name -> the columns of x, y and z.
        sure: name -> the column that says how surely it is seen.
        time: the column of the times, or None.
        tick: unit of the times [s], or None.
        unit: unit of length [m], or None.
        width: columns.
    """

    points: dict[str, tuple[int, int, int]]
    sure: dict[str, int]
    time: int | None
    tick: float | None
    unit: float | None
    width: int


def read_table(path: Path, progress: Progress, asked: Asked) -> JointMotion:
    """Return the points of a table of positions.

    A place with a confidence of zero is not seen.

    Args:
        path: the file.
        progress: told how much of it is read.
        asked: names of the columns and frames per second, where the file has none.

    Raises:
        RecordingError: it is no such table; says where.
    """
    with binary(path) as file:
        lines = TextLines(path, file, path.stat().st_size, progress)
        head, first = _head(lines)
        separator = separator_of(first, *reversed(head))
        width = len(first.split(separator))
        layout = (
            _layout(lines, [cells(row, separator) for row in head], width)
            if head
            else _asked(lines, cells(first, separator), asked)
        )
        if layout.time is None and asked.rate is None:
            raise RecordingError(
                f"{path.name}: got no column of times, allowed one that is called time or"
                " timestamp; or state the frames per second (rate)"
            )
        points = [column for columns in layout.points.values() for column in columns]
        sure = [layout.sure.get(name, -1) for name in layout.points]
        places, stamps = Gathered(), Gathered()
        for values in blocks(lines, separator, layout.width, blanks=layout.time is None):
            block = values[:, points].astype(np.float32).reshape(len(values), -1, 3)
            for i, column in enumerate(sure):
                if column >= 0:
                    block[~(values[:, column] > 0), i] = np.nan
            places.add(block, lines.share)
            if layout.time is not None:
                stamps.add(values[:, layout.time], lines.share)
    positions = places.whole
    if layout.time is None:
        assert asked.rate is not None
        positions = positions[: _seen(positions)]
        time, notes = steady(path.name, len(positions), asked.rate)
    else:
        time, kept, notes = seconds(path.name, stamps.whole, layout.tick)
        positions = positions if kept.all() else positions[kept]
    return JointMotion(
        tuple(layout.points),
        positions,
        time,
        None,
        (*notes, *repeated(positions)),
        unit=layout.unit,
    )


def _seen(positions: np.ndarray) -> int:
    """Return how many frames there are up to the last in which anything is seen, at least one."""
    count = len(positions)
    while count > 1 and np.isnan(positions[count - 1]).all():
        count -= 1
    return count


def _head(lines: TextLines) -> tuple[list[str], str]:
    """Return the rows above the numbers that are not empty, and the first row of numbers.

    That one stays to be read.
    """
    head: list[str] = []
    while len(head) < _HEAD and lines.line < _BLANK:
        row = lines.next("a row of numbers")
        if not row.strip(" \t,;"):
            continue
        words = [word.strip('"') for word in re.split(r"[\s,;]+", row.strip(" \t,;"))]
        seen = [word for word in words if not is_nothing(word)]
        if seen and all(map(is_number, seen)):
            lines.put_back(row)
            return head, row
        head.append(row)
    lines.fail(f"got {lines.line} lines without a row of numbers, allowed a table of positions")


def _layout(lines: TextLines, head: list[list[str]], width: int) -> Layout:
    """Return the layout that the rows above the numbers state."""
    row, unit, tick = head[-1], None, None
    # Units below the coordinates, as some programs write them.
    units = [word.strip("[]()").lower() for word in row if word]
    lengths = [_METRES[word] for word in units if word in _METRES]
    ticks = [word for word in units if word not in _METRES and re.fullmatch(_UNIT, word, re.I)]
    if len(head) > 1 and lengths and len(lengths) + len(ticks) == len(units):
        head, unit = head[:-1], lengths[-1]
        tick = _SECONDS[ticks[0].casefold()[0]] if ticks else None
        row = head[-1]
    axes = [_AXIS.fullmatch(word) for word in row]
    if len(head) > 1 and sum(map(bool, axes)) >= 3:
        above = [*head[-2], *[""] * len(row)][: len(row)]
        row = [
            f"{name}.{axis['axis'] if axis else word}"
            if axis or _SURE.fullmatch(word.lower())
            else word or over
            for name, over, word, axis in zip(_spread(above), above, row, axes, strict=True)
        ]
    found: dict[str, dict[str, int]] = {}
    sure: dict[str, int] = {}
    twice: dict[str, str] = {}
    time = None
    for column, word in enumerate(row):
        if len(word) > _LONGEST:
            continue
        if times := _TIMES.fullmatch(word):
            if time is None:
                time = column
                stated = times["unit"] or times["tail"]
                tick = _SECONDS[stated.casefold()[0]] if stated else tick
        elif sureness := _SURE.fullmatch(word.lower()):
            sure[sureness["name"]] = column
        elif (match := _COLUMN.fullmatch(word)) and _is_place(name := match["name"]):
            axes_found = found.setdefault(name, {})
            if match["axis"].lower() in axes_found:
                twice.setdefault(name, word)
            axes_found[match["axis"].lower()] = column
            unit = _METRES.get((match["unit"] or "").lower(), unit)
    points = {
        name: (axes["x"], axes["y"], axes["z"]) for name, axes in found.items() if len(axes) == 3
    }
    if not points:
        lines.fail(
            f"got the columns {some([short(word) for word in row if word], 6)}, allowed three for"
            " each joint, such as neck.x, neck.y, neck.z"
        )
    if again := [word for name, word in twice.items() if name in points]:
        lines.fail(f"got the column {short(again[0])} twice, allowed each once")
    sure = {name: sure[name.lower()] for name in points if name.lower() in sure}
    return Layout(points, sure, time, tick, unit, max(width, len(row)))


def _is_place(name: str) -> bool:
    return bool(name) and not _NO_PLACE.fullmatch(name)


def _asked(lines: TextLines, first: list[str], asked: Asked) -> Layout:
    """Return the layout of a table without names."""
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
        lines.fail("columns: got a name twice, allowed different ones", line)
    if width != len(first):
        lines.fail(
            f"got {len(first)} numbers and {len(asked.columns)} names (columns), allowed three"
            " numbers for each name",
            line,
        )
    points = {name: (3 * i, 3 * i + 1, 3 * i + 2) for i, name in enumerate(asked.columns)}
    return Layout(points, {}, None, None, None, width)


def _spread(names: list[str]) -> list[str]:
    """Return the names above the coordinates, one for each column: blanks belong to the last."""
    found, last = [], ""
    for name in names:
        last = name or last
        found.append(last.removeprefix("Name:"))
    return found
