"""Markers that programs write at the origin if they are not seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from ergoqp.recordings.motion import JointMotion

_BLOCK: Final = 8192
"""Frames that are processed at once."""
_MOST: Final = 6
"""Largest number of markers that a sentence names."""


def off_origin(motion: JointMotion, which: Sequence[int]) -> JointMotion:
    """Return a motion in which markers at exactly 0, 0, 0 are not seen, with a note about it.

    The given array is not changed.

    Args:
        motion: the markers.
        which: indices of the markers that are checked.
    """
    columns, positions = np.array(which, dtype=int), motion.positions
    counts = np.zeros(len(columns), dtype=int)
    for start in range(0, len(positions), _BLOCK):
        block = motion.positions[start : start + _BLOCK]
        # Most files have no such marker, so two coordinates are tested first, for speed.
        lost = (block[:, columns, 0] == 0) & (block[:, columns, 1] == 0)
        if not lost.any():
            continue
        lost &= block[:, columns, 2] == 0
        if not lost.any():
            continue
        if positions is motion.positions:
            positions = positions.copy()
        frames, at = np.nonzero(lost)
        positions[start + frames, columns[at]] = np.nan
        counts += lost.sum(axis=0)
    if positions is motion.positions:
        return motion
    names = [motion.names[i] for i in which]
    found = sorted(zip(counts.tolist(), names, strict=True), key=lambda each: -each[0])
    found = [each for each in found if each[0]]
    shares = ", ".join(f"{name} in {count}" for count, name in found[:_MOST])
    more = f" and {len(found) - _MOST} more markers" if len(found) > _MOST else ""
    said = (
        f"Of {len(positions)} frames, markers at exactly 0, 0, 0 are taken as not seen:"
        f" {shares}{more}."
    )
    return replace(motion, positions=positions, notes=(*motion.notes, said))
