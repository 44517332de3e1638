"""Track Row Column files (.trc): marker positions, as programs export them for OpenSim.

Three rows state rate, counts and unit; the fourth names the markers above their three columns; the
fifth numbers the coordinates (Motion Analysis' format; OpenSim, "Marker (.trc) Files").
Spreadsheets save them with commas.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.progress import Progress
from ergoqp.recordings.formats.opening import binary, short
from ergoqp.recordings.formats.rows import Asked, TextLines, blocks, gathered
from ergoqp.recordings.formats.stamps import repeated, seconds
from ergoqp.recordings.motion import JointMotion

UNITS: Final = {"mm": 0.001, "cm": 0.01, "m": 1.0, "dm": 0.1, "in": 0.0254, "inches": 0.0254}
UNITS_WORDS: Final = {"millimeters": 0.001, "centimeters": 0.01, "meters": 1.0}


def read_trc(path: Path, progress: Progress, asked: Asked) -> JointMotion:
    """Return the markers of a file.

    Args:
        path: the file.
        progress: told how much of it is read.
        asked: unused, the file has times.

    Raises:
        RecordingError: it is no such file.
    """
    with binary(path) as file:
        lines = TextLines(path, file, path.stat().st_size, progress)
        first = lines.next("the line PathFileType")
        separator = "\t" if "\t" in first else "," if "," in first else None
        if not first.startswith("PathFileType"):
            lines.fail(f"got {short(first)}, allowed PathFileType")
        keys = lines.next("the names of what is stated").split(separator)
        values = lines.next("what is stated").split(separator)
        stated = {k.strip().lower(): v.strip() for k, v in zip(keys, values, strict=False)}
        head = [word.strip() for word in lines.next("the names of the markers").split(separator)]
        if [word.lower() for word in head[:1]] != ["frame#"]:
            lines.fail(f"got {short(head[0] if head else '')}, allowed Frame#")
        lines.next("the names of the coordinates")
        names = [word for word in head[2:] if word]
        if not names:
            lines.fail("got no marker, allowed a name above each three columns")
        if twice := {name for name in names if names.count(name) > 1}:
            lines.fail(f"got the marker {short(min(twice))} twice, allowed each once")
        width = 2 + 3 * len(names)
        stamps, places = [], []
        for rows in blocks(lines, separator, width):
            stamps.append(rows[:, 1])
            places.append(rows[:, 2:].astype(np.float32).reshape(len(rows), -1, 3))
    if not stamps:
        raise RecordingError(f"{path.name}: got no row of numbers, allowed a movement")
    positions = gathered(places)
    time, kept, notes = seconds(path.name, np.concatenate(stamps), 1.0)
    positions = positions[kept]
    for key, found, what in (
        ("numframes", len(kept), "frames"),
        ("nummarkers", len(names), "markers"),
    ):
        if stated.get(key, "").isdigit() and int(stated[key]) != found:
            notes.append(f"The file states {stated[key]} {what} and has {found}: all are read.")
    unit = stated.get("units", "").lower()
    return JointMotion(
        tuple(names),
        positions,
        time,
        None,
        (*notes, *repeated(positions)),
        markers=True,
        unit=UNITS.get(unit, UNITS_WORDS.get(unit)),
    )
