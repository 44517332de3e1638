"""Poses in files: metres and a quaternion, x, y, z, w."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np


def pose_as_dict(pose: np.ndarray) -> dict[str, list[float]]:
    """Return a pose (4, 4) [m] as ``position_m`` and ``quaternion_xyzw``."""
    wxyz = np.zeros(4)
    mujoco.mju_mat2Quat(wxyz, np.ascontiguousarray(pose[:3, :3]).ravel())
    return {"position_m": pose[:3, 3].tolist(), "quaternion_xyzw": np.roll(wxyz, -1).tolist()}


def pose_from_dict(values: Mapping[str, Any]) -> np.ndarray:
    """Return the pose (4, 4) [m] of `pose_as_dict`.

    Raises:
        KeyError, TypeError, ValueError: if it is not one.
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
    pose, flat = np.eye(4), np.zeros(9)
    mujoco.mju_quat2Mat(flat, np.roll(quaternion / np.linalg.norm(quaternion), 1))
    pose[:3, :3], pose[:3, 3] = flat.reshape(3, 3), position
    return pose
