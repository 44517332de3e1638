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
from ergoqp.recordings.formats.rows import Asked, TextLines, blocks, gathered
from ergoqp.recordings.formats.stamps import repeated, seconds
from ergoqp.recordings.motion import JointMotion

_HEAD: Final = 12
"""Lines in which the numbers begin at the latest."""
_COLUMN: Final = re.compile(
    r"(?:(?P<name>.*?)[\s._:/-]*)??(?:pos(?:ition)?[\s._:/-]*)?t?(?P<axis>[xyz])\d*"
    r"\s*(?:[\[(](?P<unit>[a-zµ]*)[\])])?",
    re.IGNORECASE,
)
_TIMES: Final = re.compile(
    r"(?:time|timestamp|time[\s_]?stamps?|t|sec|seconds)\s*(?:[\s_.\[(]*(?P<unit>s|sec|seconds|ms|"
    r"msec|milliseconds|us|µs|usec|microseconds|ns|nsec|nanoseconds)[\])]?)?",
    re.IGNORECASE,
)
_SURE: Final = re.compile(
    r"(?P<name>.*?)[\s._:/-]*(?:confidence|visibility|likelihood|score|quality)"
)
SECONDS: Final = {"s": 1.0, "m": 1e-3, "u": 1e-6, "µ": 1e-6, "n": 1e-9}
METRES: Final = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}


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
        separator = _separator(head[-1] if head else first)
        if separator == ";" and "," in first:
            lines.comma = True
            first = first.replace(",", ".")
        head = [[word.strip().strip('"') for word in row.split(separator)] for row in head]
        layout = _layout(lines, head, first.split(separator), asked)
        points = [column for columns in layout.points.values() for column in columns]
        sure = [layout.sure.get(name, -1) for name in layout.points]
        places, stamps = [], []
        lines.put_back(first)
        for values in blocks(lines, separator, layout.width):
            block = values[:, points].astype(np.float32).reshape(len(values), -1, 3)
            for i, column in enumerate(sure):
                if column >= 0:
                    block[~(values[:, column] > 0), i] = np.nan
            places.append(block)
            if layout.time is not None:
                stamps.append(values[:, layout.time])
        positions = gathered(places)
        del places
    tick = layout.tick
    if layout.time is None:
        stamps = [np.arange(len(positions)) / _rate(path, asked)]
        tick = 1.0
    time, kept, notes = seconds(path.name, np.concatenate(stamps), tick)
    positions = positions if kept.all() else positions[kept]
    if layout.time is None:
        notes = [f"There are {asked.rate:g} frames per second, as stated."]
    return JointMotion(
        tuple(layout.points),
        positions,
        time,
        None,
        (*notes, *repeated(positions)),
        unit=layout.unit,
    )


def _rate(path: Path, asked: Asked) -> float:
    if asked.rate is None:
        raise RecordingError(
            f"{path.name}: got no column of times, allowed one that is called time or timestamp;"
            " or state the frames per second (rate)"
        )
    return asked.rate


def _head(lines: TextLines) -> tuple[list[str], str]:
    """Return the rows above the numbers that are not empty, and the first row of numbers."""
    head: list[str] = []
    while len(head) < _HEAD:
        row = lines.next("a row of numbers")
        if not row.strip(" \t,;"):
            continue
        words = [word for word in re.split(r"[\s,;]+", row.strip(" \t,;")) if word]
        if all(_is_number(word) for word in words):
            return head, row
        head.append(row)
    lines.fail(f"got {_HEAD} lines without a row of numbers, allowed a table of positions")


def _separator(row: str) -> str | None:
    """Return what parts the columns of a row; None for any white space."""
    counts = {mark: row.count(mark) for mark in "\t;,"}
    best = max(counts, key=lambda mark: counts[mark])
    return best if counts[best] else None


def _layout(lines: TextLines, head: list[list[str]], first: list[str], asked: Asked) -> Layout:
    width = len(first)
    if not head:
        return _asked(lines, width, asked)
    row = head[-1]
    # Units below the coordinates, as some programs write them.
    units = [METRES.get(word.lower()) for word in row if word]
    if len(head) > 1 and units and all(units):
        head, unit = head[:-1], units[-1]
        row = head[-1]
    else:
        unit = None
    bare = [word.lower() for word in row if word]
    if len(head) > 1 and sum(word in {"x", "y", "z"} for word in bare) >= 3:
        names = _spread(head[-2], len(row))
        row = [
            f"{name}.{word}" if word.lower() in {"x", "y", "z"} else word
            for name, word in zip(names, row, strict=True)
        ]
    found: dict[str, dict[str, int]] = {}
    sure: dict[str, int] = {}
    time, tick = None, None
    for column, word in enumerate(row):
        if times := _TIMES.fullmatch(word):
            if time is None:
                time = column
                tick = SECONDS[times["unit"][0].lower()] if times["unit"] else None
        elif sureness := _SURE.fullmatch(word.lower()):
            sure[sureness["name"]] = column
        elif (match := _COLUMN.fullmatch(word)) and match["name"]:
            found.setdefault(match["name"], {})[match["axis"].lower()] = column
            unit = METRES.get((match["unit"] or "").lower(), unit)
    points = {
        name: (axes["x"], axes["y"], axes["z"]) for name, axes in found.items() if len(axes) == 3
    }
    if not points:
        lines.fail(
            f"got the columns {some([short(word) for word in row if word], 6)}, allowed three for"
            " each joint, such as neck.x, neck.y, neck.z"
        )
    sure = {name: sure[name.lower()] for name in points if name.lower() in sure}
    return Layout(points, sure, time, tick, unit, max(width, len(row)))


def _asked(lines: TextLines, width: int, asked: Asked) -> Layout:
    """Return the layout of a table without names."""
    if not asked.columns:
        lines.fail(
            f"got {width} numbers and no names above them, allowed a row of names; or state the"
            " names of the points in their order (columns)"
        )
    if len(set(asked.columns)) < len(asked.columns):
        lines.fail("columns: got a name twice, allowed different ones")
    if 3 * len(asked.columns) != width:
        lines.fail(
            f"got {width} numbers and {len(asked.columns)} names (columns), allowed three numbers"
            " for each name"
        )
    points = {name: (3 * i, 3 * i + 1, 3 * i + 2) for i, name in enumerate(asked.columns)}
    return Layout(points, {}, None, None, None, width)


def _spread(names: list[str], width: int) -> list[str]:
    """Return the names above the coordinates, one for each column: blanks belong to the last."""
    found, last = [], ""
    for name in [*names, *[""] * (width - len(names))][:width]:
        last = name or last
        found.append(last.removeprefix("Name:"))
    return found


def _is_number(word: str) -> bool:
    try:
        float(word.replace(",", "."))
    except ValueError:
        return False
    return True
