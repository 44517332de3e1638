"""Orientations and poses from the quaternions of a file."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation


def poses_of(positions: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Return poses (n, 4, 4) from positions (n, 3) and quaternions x, y, z, w (n, 4).

    NaN where one of them is not seen. The data type is that of the positions.
    """
    poses = np.full((len(positions), 4, 4), np.nan, dtype=positions.dtype)
    poses[:, 3] = [0, 0, 0, 1]
    poses[:, :3, 3] = positions
    seen = np.isfinite(turns).all(axis=1) & (np.linalg.norm(turns, axis=1) > 0.5)
    if seen.any():
        poses[seen, :3, :3] = Rotation.from_quat(turns[seen]).as_matrix()
    return poses


_FAR: Final = 0.1
"""Difference from 1 from which a length is another one."""


def unit_turns(turns: np.ndarray) -> np.ndarray:
    """Return quaternions (..., 4) of length 1, NaN where their length is not 1 to within 0.1."""
    # Large numbers are excluded first, because their squares could be infinite.
    sane = (np.abs(turns) < 2).all(axis=-1, keepdims=True)
    size = np.linalg.norm(np.where(sane, turns, 0), axis=-1, keepdims=True)
    return np.where(np.abs(size - 1) < _FAR, turns / np.where(size > 0, size, 1), np.nan)


_ALIKE: Final = 0.01
"""Relative difference of lengths that are the same."""
_MOSTLY: Final = 0.9
"""Share of the quaternions that have to have the same length, if it is not 1."""
_SANE: Final = (1e-3, 1e6)
"""Lengths that may be a scale."""


class UnitTurns:
    """Quaternions of a file, block by block, of length 1; those of another length are counted."""

    def __init__(self) -> None:
        """Begin without quaternions."""
        self._scale: float | None = None
        self._count = self._lost = 0

    def of(self, turns: np.ndarray) -> np.ndarray:
        """Return quaternions (..., 4) of length 1, NaN where they have another length.

        If those of the first block have one length that is not 1, it is the scale of the file.
        """
        seen = np.isfinite(turns).all(axis=-1) & (turns != 0).any(axis=-1)
        if self._scale is None and seen.any():
            self._scale = _scale_of(turns[seen])
        found = unit_turns(turns / (self._scale or 1.0))
        self._count += int(seen.sum())
        self._lost += int((seen & ~np.isfinite(found).all(axis=-1)).sum())
        return found

    def said(self) -> list[str]:
        """Return sentences about lengths that are not 1."""
        notes = []
        if self._scale not in {None, 1.0}:
            notes.append(
                f"The orientations have the length {self._scale:.3g} and not 1: they are scaled."
            )
        if self._lost:
            notes.append(
                f"{self._lost} of {self._count} orientations have another length and are not seen."
            )
        return notes


def _scale_of(turns: np.ndarray) -> float:
    """Return the length that nearly all quaternions (n, 4) have; 1 if they have none."""
    size = np.abs(turns).max(axis=1)
    sane = (size > _SANE[0]) & (size < _SANE[1])
    if not sane.any():
        return 1.0
    lengths = np.linalg.norm(turns[sane], axis=1)
    usual = float(np.median(lengths))
    same = np.abs(lengths / usual - 1) < _ALIKE
    return usual if same.mean() >= _MOSTLY and abs(usual - 1) >= _FAR else 1.0
