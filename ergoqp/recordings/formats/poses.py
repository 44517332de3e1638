"""Poses that files give as position and quaternion."""

from __future__ import annotations

import numpy as np


def poses_of(positions: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Return poses (n, 4, 4), NaN where a place (n, 3) or quaternion (n, 4) x, y, z, w is lost.

    They are as precise as the places.
    """
    poses = np.full((len(positions), 4, 4), np.nan, dtype=positions.dtype)
    poses[:, 3] = [0, 0, 0, 1]
    poses[:, :3, 3] = positions
    seen = np.isfinite(turns).all(axis=1) & (np.linalg.norm(turns, axis=1) > 0.5)
    if seen.any():
        # scipy's are loaded where they are needed: most files have none.
        from scipy.spatial.transform import Rotation

        poses[seen, :3, :3] = Rotation.from_quat(turns[seen]).as_matrix()
    return poses


def unit_turns(turns: np.ndarray) -> np.ndarray:
    """Return quaternions (..., 4) of length 1, NaN where they are none."""
    # Of what is large the square would be infinite.
    sane = (np.abs(turns) < 2).all(axis=-1, keepdims=True)
    size = np.linalg.norm(np.where(sane, turns, 0), axis=-1, keepdims=True)
    return np.where(np.abs(size - 1) < 0.1, turns / np.where(size > 0, size, 1), np.nan)
