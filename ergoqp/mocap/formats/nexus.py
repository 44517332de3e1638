"""Vicon Nexus' ASCII export: the trajectories of markers as CSV, below other sections or alone.

A section is its name, its rate, a row of names, "Frame, Sub Frame, X, Y, Z, ...", a row of units,
the numbers and an empty line (Vicon, "Nexus User Guide", ASCII export). It was not tried on a file
by others.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from ergoqp.arguments import Progress
from ergoqp.mocap.formats.text import (
    TableOptions,
    TextLines,
    cells,
    is_number,
    points_of,
    read_rows,
    separator_of,
    short,
    text_lines,
)
from ergoqp.mocap.naming import nameless
from ergoqp.mocap.recording import JointMotion, with_times

SECTIONS: Final = ("Trajectories", "Devices", "Model Outputs", "Joints", "Segments", "Events")
"""Names of sections; a file begins with one."""
_UNITS: Final = {"mm": 0.001, "cm": 0.01, "m": 1.0}
_FASTEST: Final = 10_000.0


def section_of(row: str) -> str | None:
    """Return the section that a row begins; None if it begins none."""
    word = row.strip(' \t\r\n,;"')
    return word if word in SECTIONS else None


def read_nexus(path: Path, progress: Progress, asked: TableOptions) -> JointMotion:
    """Return the labelled markers of a trial.

    Args:
        path: the file.
        progress: is called with the share of the file that is read.
        asked: unused, because the file states its rate.

    Raises:
        RecordingError: if it is not such a file, or has no trajectories.
    """
    with text_lines(path, progress) as lines:
        while section_of(row := lines.next("the section Trajectories")) != "Trajectories":
            pass
        stated = (row := lines.next("the frames per second")).strip(' \t,;"').replace(",", ".")
        if not is_number(stated) or not 1.0 <= float(stated) <= _FASTEST:
            lines.fail(f"got {short(row)}, allowed frames per second from 1 to 10000")
        names_row, axes_row = lines.next("the names of the markers"), lines.next("Frame, Sub Frame")
        separator = separator_of(axes_row)
        axes = [word.lower() for word in cells(axes_row, separator)]
        if axes[:2] != ["frame", "sub frame"]:
            lines.fail(f"got {short(axes_row)}, allowed Frame, Sub Frame, X, Y, Z and so on")
        points, lost = _points(lines, cells(names_row, separator), axes)
        units = {word for word in cells(lines.next("the units"), separator) if word}
        if len(units) != 1 or not units <= set(_UNITS):
            lines.fail(f"got the units {short(', '.join(sorted(units)))}, allowed mm, cm or m")
        columns = [first + i for first, _ in points for i in range(3)]
        frames, positions = read_rows(
            lines, separator, len(axes), lambda rows: (rows[:, 0], points_of(rows[:, columns]))
        )
    motion = JointMotion(
        tuple(name for _, name in points),
        positions,
        frames / float(stated),
        notes=(f"{lost} trajectories have no label and are left out.",) if lost else (),
        markers=True,
        unit=_UNITS[units.pop()],
    )
    return with_times(path.name, motion.once())


def _points(
    lines: TextLines, names: list[str], axes: list[str]
) -> tuple[list[tuple[int, str]], int]:
    """Return column of the x and name of each labelled marker, and how many have no label."""
    found = [
        (i, name) for i, name in enumerate(names) if name and axes[i : i + 3] == ["x", "y", "z"]
    ]
    points = [(i, name) for i, name in found if not nameless(name)]
    if not points:
        lines.fail("got no marker with a name, allowed a name above each X, Y, Z")
    return points, len(found) - len(points)
