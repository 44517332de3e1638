"""The joint angles of a recording as files for other programs.

``angles.csv`` has one row per frame: ``time_s``; ``scored`` 1 or 0; every joint of
`ergoqp.joints.JOINTS` as ``<joint>_deg``; ``<side>_elevation_deg`` and
``<side>_elevation_plane_deg`` of both upper arms (see `ergoqp.sheets.elevation`); and
``<centre>_error_mm``, the distance of the fitted body's joint centre from that of the
recording, empty if it is not seen.

``angles.mot`` has the same joints and elevations in degrees, in OpenSim's format for motions.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from ergoqp.files.whole import whole
from ergoqp.joints import JOINTS, SIDES
from ergoqp.progress import Progress, part_of, unseen
from ergoqp.recordings import Recording
from ergoqp.sheets.elevation import elevation_of

_BLOCK: Final = 4096
"""Number of frames that are converted to text at once."""
_ANGLES: Final = (
    *JOINTS,
    *(f"{side}_{what}" for what in ("elevation", "elevation_plane") for side in SIDES),
)


def write_angles(
    recording: Recording, folder: Path, progress: Progress = unseen
) -> tuple[Path, Path]:
    """Write ``angles.csv`` and ``angles.mot``.

    Args:
        recording: recording with n frames.
        folder: folder of the files; it exists.
        progress: called with the share that is written.

    Returns:
        The two files.

    Raises:
        OSError: if they cannot be written.
    """
    table, motion = folder / "angles.csv", folder / "angles.mot"
    head = ["time_s", "scored", *(f"{name}_deg" for name in _ANGLES)]
    head += [f"{centre}_error_mm" for centre in recording.errors]
    with whole(table) as scratch, scratch.open("w", encoding="utf-8") as file:
        file.write(",".join(head) + "\n")
        for rows in _blocks(recording, part_of(progress, 0.0, 0.5)):
            scored = recording.scored[rows].astype(float)[:, None]
            errors = [1e3 * each[rows, None] for each in recording.errors.values()]
            values = np.hstack(
                [recording.time[rows, None], scored, _degrees(recording, rows), *errors]
            )
            formats = ["%.6f", "%d", *["%.4f"] * len(_ANGLES), *["%.2f"] * len(errors)]
            lines = _text(values, ",".join(formats))
            file.write(lines.replace("nan", ""))
    with whole(motion) as scratch, scratch.open("w", encoding="utf-8") as file:
        size = (f"nRows={len(recording.time)}", f"nColumns={1 + len(_ANGLES)}")
        file.write("\n".join(["ergoqp", "version=1", *size, "inDegrees=yes", "endheader\n"]))
        file.write("\t".join(["time", *_ANGLES]) + "\n")
        for rows in _blocks(recording, part_of(progress, 0.5, 1.0)):
            values = np.hstack([recording.time[rows, None], _degrees(recording, rows)])
            file.write(_text(values, "\t".join(["%.6f", *["%.6f"] * len(_ANGLES)])))
    return table, motion


def _blocks(recording: Recording, progress: Progress) -> Iterator[slice]:
    count = len(recording.time)
    for start in range(0, count, _BLOCK):
        yield slice(start, start + _BLOCK)
        progress(min(1.0, (start + _BLOCK) / count))


def _degrees(recording: Recording, rows: slice) -> np.ndarray:
    """Return the columns of `_ANGLES` [deg]."""
    postures = recording.postures[rows]
    return np.degrees(np.hstack([postures, *elevation_of(postures)]))


def _text(values: np.ndarray, line: str) -> str:
    """Return rows (n, m) as lines of text."""
    return ((line + "\n") * len(values)) % tuple(values.ravel().tolist())
