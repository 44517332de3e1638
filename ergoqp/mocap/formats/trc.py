"""Track Row Column files (.trc): marker positions, as programs export them for OpenSim.

Three rows state rate, counts and unit. The fourth names the markers above their three columns. The
fifth numbers the coordinates (Motion Analysis' format; OpenSim, "Marker (.trc) Files"). Spreadsheet
programs save such files with commas.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

from ergoqp.arguments import Progress
from ergoqp.mocap.formats.text import (
    TableOptions,
    cells,
    is_number,
    points_of,
    read_rows,
    separator_of,
    short,
    text_lines,
)
from ergoqp.mocap.formats.times import unit_by_rate
from ergoqp.mocap.recording import JointMotion, count_note, with_times

UNITS: Final = {"mm": 0.001, "cm": 0.01, "m": 1.0, "dm": 0.1, "in": 0.0254, "inches": 0.0254} | {
    "millimeters": 0.001,
    "centimeters": 0.01,
    "meters": 1.0,
}


def read_trc(path: Path, progress: Progress, asked: TableOptions) -> JointMotion:
    """Return the markers of a file.

    Args:
        path: the file.
        progress: is called with the share of the file that is read.
        asked: unused, because the file has times.

    Raises:
        RecordingError: if it is not such a file.
    """
    with text_lines(path, progress) as lines:
        first = lines.next("the line PathFileType")
        if not first.startswith("PathFileType"):
            lines.fail(f"got {short(first)}, allowed PathFileType")
        keys, values = lines.next("the row of keys"), lines.next("the row of values")
        row = lines.next("the names of the markers")
        separator = separator_of(row)
        pairs = zip(cells(keys, separator), cells(values, separator), strict=False)
        stated = {key.lower(): value for key, value in pairs}
        head = cells(row, separator)
        if [word.lower() for word in head[:1]] != ["frame#"]:
            lines.fail(f"got {short(head[0] if head else '')}, allowed Frame#")
        named = {i: word for i, word in enumerate(head[2:]) if word}
        if not named:
            lines.fail("got no marker, allowed a name above each three columns")
        at, names = list(named), list(named.values())
        # Some programs write the names directly after each other.
        if any(i % 3 for i in at):
            if at != list(range(len(at))):
                lines.fail(
                    "got names that are not three columns apart, allowed one for each marker"
                )
            at = [3 * i for i in at]
        if "x" not in (below := lines.next("the names of the coordinates")).lower():
            lines.fail(f"got {short(below)}, allowed X1, Y1, Z1 and so on")
        # Cortex writes markers without a name: their columns have coordinates and no name above.
        count = max(at[-1] // 3 + 1, _coordinates(cells(below, separator)) // 3)
        which = [2 + column + i for column in at for i in range(3)]
        further: list[int] = []
        stamps, positions = read_rows(
            lines,
            separator,
            2 + 3 * count,
            lambda rows: (rows[:, 1], points_of(rows[:, which])),
            further=further,
        )
    # Some programs write other units than seconds, which follow from the rate.
    rate = stated.get("datarate", "").replace(",", ".")
    second, notes = unit_by_rate(stamps, float(rate)) if is_number(rate) else (1.0, [])
    lost = count - len(names)
    counts = [
        *([f"{lost} markers have no name and are left out."] if lost else []),
        *([_said_further(further, len(positions))] if further else []),
        *count_note(stated.get("numframes", ""), len(positions), "frames"),
        *count_note(stated.get("nummarkers", ""), count, "markers"),
    ]
    motion = JointMotion(
        tuple(names),
        positions,
        stamps,
        notes=tuple(counts),
        markers=True,
        unit=UNITS.get(stated.get("units", "").lower()),
    )
    motion = with_times(path.name, motion.once(), second)
    return replace(motion, notes=(*notes, *motion.notes))


def _said_further(further: list[int], count: int) -> str:
    """Return a sentence about rows with further points, which Cortex writes where it sees them.

    Args:
        further: the number of points, of the rows that have some.
        count: number of rows.
    """
    return (
        f"{len(further)} of {count} rows have up to {max(further)} more markers than the head"
        " names: these are left out."
    )


def _coordinates(words: list[str]) -> int:
    """Return the number of coordinates (X1, Y1, Z1 and so on) in a row."""
    return sum(word[:1].upper() in {"X", "Y", "Z"} for word in words)
