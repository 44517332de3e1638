"""A reader: joint centres as text, ``time name.x name.y name.z ...`` above the frames."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.recordings.motion import JointMotion


def read_centres(path: Path) -> JointMotion:
    """Read a file that ends in ``.centres``; lengths are in the file's unit."""
    head, *lines = path.read_text(encoding="utf-8").splitlines()
    names = tuple(column.removesuffix(".x") for column in head.split()[1::3])
    try:
        frames = np.array([[float(word) for word in line.split()] for line in lines])
        positions = frames[:, 1:].reshape(len(frames), len(names), 3)
    except (ValueError, IndexError) as error:
        raise RecordingError(f"{path.name}: got {error}, allowed a table of numbers") from None
    return JointMotion(names, positions, frames[:, 0] - frames[0, 0])
