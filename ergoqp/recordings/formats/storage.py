"""OpenSim's motion files (.mot, .sto), which contain joint angles.

About ten rows stand above the numbers and end with "endheader". The next row names the columns
(OpenSim, "Storage (.sto) and Motion (.mot) Files"). Spreadsheet programs save such files with
commas. Files by SIMM state no version, and their angles are in degrees.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.progress import Progress
from ergoqp.recordings.formats.opening import binary, short
from ergoqp.recordings.formats.rows import (
    Asked,
    Gathered,
    blocks,
    cells,
    count_of,
    separator_of,
)
from ergoqp.recordings.formats.stamps import seconds
from ergoqp.recordings.formats.text_lines import TextLines
from ergoqp.recordings.motion import JointMotion

_HEAD: Final = 200
"""Largest number of rows above the numbers."""
_SPACE: Final = " \t,;"
"""Characters that spreadsheet programs put around the rows above the numbers."""
LENGTHS: Final = ("_tx", "_ty", "_tz", "transx", "transy", "transz")
"""Endings of the names of columns that are lengths and not angles."""


def read_storage(path: Path, progress: Progress, asked: Asked) -> JointMotion:
    """Return the joint angles of a motion file.

    Args:
        path: the file.
        progress: is called with the share of the file that is read.
        asked: unused, because the file has times.

    Raises:
        RecordingError: if it is not such a file, or a number is missing.
    """
    with binary(path) as file:
        lines = TextLines(path, file, path.stat().st_size, progress)
        stated: dict[str, str] = {}
        while (row := lines.next("the line endheader").strip(_SPACE)).lower() != "endheader":
            key, mark, value = row.partition("=")
            if mark:
                stated[key.strip().lower()] = value.strip().lower()
            if lines.line > _HEAD:
                lines.fail(f"got {_HEAD} rows without endheader, allowed a motion file")
        head = ""
        while not head.strip(_SPACE):
            head = lines.next("the names of the columns")
            if lines.line > 2 * _HEAD:
                lines.fail("got no names of columns below endheader, allowed a motion file")
        # In some files tabs separate the names, and spaces the numbers.
        separator = separator_of(first) if (first := lines.peek()) else separator_of(head)
        names = cells(head.strip(" \t"), separator)
        while names and not names[-1]:
            names.pop()
        if not names or names[0].lower() != "time":
            lines.fail(f"got the first column {short(names[0] if names else '')}, allowed time")
        if "" in names:
            lines.fail(f"got no name for column {names.index('') + 1}, allowed a name for each")
        if len(set(names)) < len(names):
            lines.fail("got a column twice, allowed each once")
        rows = Gathered()
        for block in blocks(lines, separator, len(names)):
            rows.add(block, lines.share)
    if not rows:
        raise RecordingError(f"{path.name}: got no row below the names, allowed rows of numbers")
    values = rows.whole
    time, kept, notes = seconds(path.name, values[:, 0], 1.0, [values[:, 1:]])
    if (total := count_of(stated.get("nrows", ""))) not in {None, len(values)}:
        notes.insert(0, f"The file states {total} rows and has {len(values)}: all are read.")
    degrees = stated.get("indegrees", "no") in {"yes", "true", "1"}
    if "indegrees" not in stated:
        degrees = "version" not in stated and path.suffix.lower() == ".mot"
        unit = "degrees, as in SIMM's files" if degrees else "radians"
        notes.append(f"The file does not state the unit of its angles: they are taken as {unit}.")
    angles = {
        name: values[kept, i] * (np.pi / 180 if degrees and not is_length(name) else 1.0)
        for i, name in enumerate(names)
        if i
    }
    if lost := [name for name, each in angles.items() if not np.isfinite(each).all()]:
        raise RecordingError(
            f"{path.name}: column {short(lost[0])} has blanks, allowed a number for each frame"
        )
    return JointMotion(
        (),
        np.empty((len(time), 0, 3)),
        time,
        None,
        tuple(notes),
        angles=angles,
        unit=1.0,
        up="y",
    )


def is_length(name: str) -> bool:
    """Return whether the name of a column is that of a length."""
    return (coordinate_of(name) or name).lower().endswith(LENGTHS)


def coordinate_of(name: str) -> str | None:
    """Return the coordinate whose value a column holds; None for speeds and other paths.

    >>> coordinate_of("/jointset/hip_r/hip_flexion_r/value")
    'hip_flexion_r'
    """
    if "/" not in name:
        return name
    path, _, last = name.rpartition("/")
    return path.rpartition("/")[2] if last.lower() == "value" else None
