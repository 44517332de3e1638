"""Rotations as quaternions, and poses in files: metres and a quaternion x, y, z, w."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np


def quaternion_of(rotation: np.ndarray) -> np.ndarray:
    """Return the quaternion (4,), w first, of a rotation (3, 3)."""
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(rotation, dtype=float).ravel())
    return quaternion


def matrix_of(quaternion: np.ndarray) -> np.ndarray:
    """Return the rotation (3, 3) of a quaternion (4,), w first."""
    flat = np.zeros(9)
    mujoco.mju_quat2Mat(flat, np.asarray(quaternion, dtype=float))
    return flat.reshape(3, 3)


def pose_as_dict(pose: np.ndarray) -> dict[str, list[float]]:
    """Return a pose (4, 4) [m] as ``position_m`` and ``quaternion_xyzw``."""
    wxyz = quaternion_of(pose[:3, :3])
    return {"position_m": pose[:3, 3].tolist(), "quaternion_xyzw": np.roll(wxyz, -1).tolist()}


def pose_from_dict(values: Mapping[str, Any]) -> np.ndarray:
    """Return the pose (4, 4) [m] from the result of `pose_as_dict`.

    Raises:
        KeyError, TypeError, ValueError: if it does not describe a pose.
    """
    position, quaternion = (
        np.array(values[name], dtype=float) for name in ("position_m", "quaternion_xyzw")
    )
    if (
        position.shape != (3,)
        or quaternion.shape != (4,)
        or not abs(np.linalg.norm(quaternion) - 1) < 1e-6
    ):
        raise ValueError("pose")
    pose = np.eye(4)
    pose[:3, :3] = matrix_of(np.roll(quaternion / np.linalg.norm(quaternion), 1))
    pose[:3, 3] = position
    return pose
