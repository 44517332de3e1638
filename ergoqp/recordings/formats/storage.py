"""OpenSim's motion files (.mot, .sto): joint angles that are ready.

Ten or so rows stand above the numbers and end with "endheader"; the next row names the columns
(OpenSim, "Storage (.sto) and Motion (.mot) Files"). Spreadsheets save them with commas.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.progress import Progress
from ergoqp.recordings.formats.opening import binary, short
from ergoqp.recordings.formats.rows import Asked, TextLines, blocks, gathered
from ergoqp.recordings.formats.stamps import seconds
from ergoqp.recordings.motion import JointMotion

_HEAD: Final = 200
"""Rows above the numbers, at most."""
LENGTHS: Final = ("_tx", "_ty", "_tz", "transx", "transy", "transz")
"""How names of columns end that are lengths and no angles."""


def read_storage(path: Path, progress: Progress, asked: Asked) -> JointMotion:
    """Return the joint angles of a motion file.

    Args:
        path: the file.
        progress: told how much of it is read.
        asked: unused, the file has times.

    Raises:
        RecordingError: it is no such file, or has fewer rows than it states.
    """
    with binary(path) as file:
        lines = TextLines(path, file, path.stat().st_size, progress)
        stated: dict[str, str] = {}
        while (row := lines.next("the line endheader").strip(", \t")).lower() != "endheader":
            key, mark, value = row.partition("=")
            if mark:
                stated[key.strip().lower()] = value.strip().lower()
            if lines.line > _HEAD:
                lines.fail(f"got {_HEAD} rows without endheader, allowed a motion file")
        head = ""
        while not head.strip(", \t"):
            head = lines.next("the names of the columns")
        separator = next((mark for mark in "\t," if mark in head), None)
        names = [word.strip() for word in head.strip().split(separator)]
        while names and not names[-1]:
            names.pop()
        if names[0].lower() != "time":
            lines.fail(f"got the first column {short(names[0])}, allowed time")
        if len(set(names)) < len(names):
            lines.fail("got a column twice, allowed each once")
        parts = list(blocks(lines, separator, len(names)))
    if not parts:
        raise RecordingError(f"{path.name}: got no row below the names, allowed a movement")
    values = gathered(parts)
    notes = []
    if (total := stated.get("nrows", "")).isdigit() and int(total) != len(values):
        notes.append(f"The file states {total} rows and has {len(values)}: all are read.")
    time, kept, said = seconds(path.name, values[:, 0], 1.0)
    degrees = stated.get("indegrees", "no") in {"yes", "true", "1"}
    angles = {
        name: values[kept, i] * (np.pi / 180 if degrees and not is_length(name) else 1.0)
        for i, name in enumerate(names)
        if i
    }
    if lost := [name for name, each in angles.items() if not np.isfinite(each).all()]:
        raise RecordingError(
            f"{path.name}: column {lost[0]} has blanks, allowed a number for each frame"
        )
    return JointMotion(
        (),
        np.empty((len(time), 0, 3)),
        time,
        None,
        (*notes, *said),
        angles=angles,
        unit=1.0,
        up="y",
    )


def is_length(name: str) -> bool:
    """Return whether a column is a length, by its name."""
    return name.lower().endswith(LENGTHS)
