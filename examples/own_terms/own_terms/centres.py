"""A reader: joint centres as text, ``time name.x name.y name.z ...`` above the frames."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.mocap.recording import JointMotion


def read_centres(path: Path) -> JointMotion:
    """Read a file that ends in ``.centres``; lengths are in the file's unit.

    Raises:
        RecordingError: if it is not such a file.
    """
    try:
        head, *lines = path.read_text(encoding="utf-8").splitlines() or [""]
    except OSError as error:
        raise RecordingError(f"{path.name}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise RecordingError(
            f"{path.name}: got byte {error.start}, which is not UTF-8, allowed a text"
        ) from None
    columns = head.split()
    names = tuple(column.removesuffix(".x") for column in columns[1::3])
    if not names or columns != ["time", *(f"{name}.{axis}" for name in names for axis in "xyz")]:
        raise RecordingError(
            f"{path.name}: got the first line {head[:60]!r}, allowed time name.x name.y name.z ..."
        )
    try:
        frames = np.array([[float(word) for word in line.split()] for line in lines])
    except ValueError as error:
        raise RecordingError(f"{path.name}: got {error}, allowed a table of numbers") from None
    if frames.ndim != 2 or frames.shape[1] != len(columns):
        raise RecordingError(
            f"{path.name}: got {len(lines)} frames that do not fit the first line, allowed"
            f" at least one, each of {len(columns)} numbers"
        )
    positions = frames[:, 1:].reshape(len(frames), len(names), 3)
    return JointMotion(names, positions, frames[:, 0] - frames[0, 0])
