"""Orientations and poses from the quaternions of a file."""

from __future__ import annotations

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


def unit_turns(turns: np.ndarray) -> np.ndarray:
    """Return quaternions (..., 4) of length 1, NaN where their length is not 1 to within 0.1."""
    # Large numbers are excluded first, because their squares could be infinite.
    sane = (np.abs(turns) < 2).all(axis=-1, keepdims=True)
    size = np.linalg.norm(np.where(sane, turns, 0), axis=-1, keepdims=True)
    return np.where(np.abs(size - 1) < 0.1, turns / np.where(size > 0, size, 1), np.nan)
