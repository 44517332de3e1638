"""The judgement of what a user gives when a whole body is made, and in the loop."""

from __future__ import annotations

from typing import Any

import numpy as np

from ergoqp.errors import InputError
from ergoqp.whole_body.robot import Robot


def check_length(what: str, value: float, low: float, high: float) -> None:
    """Check a length.

    Raises:
        InputError: if it is not a number from `low` to `high` [m].
    """
    if not (isinstance(value, (int, float)) and low <= value <= high):
        raise InputError(f"{what}: got {value!r}, allowed {low} to {high} m")


def start_of(start: Any, robot: Robot) -> np.ndarray:
    """Return joint positions (k,) [rad].

    Raises:
        InputError: if they are not k numbers within the ranges of the arm.
    """
    joints = numbers(start, len(robot.joints))
    if joints is None or (joints < robot.lower).any() or (joints > robot.upper).any():
        raise InputError(f"start: got {start!r}, allowed {len(robot.joints)} joint positions within their ranges")
    return joints


def rigid(what: str, value: Any) -> np.ndarray:
    """Return a rigid motion (4, 4).

    Raises:
        InputError: if it is not one.
    """
    try:
        pose = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{what}: got {type(value).__name__}, allowed a rigid motion (4, 4)") from None
    if pose.shape != (4, 4) or not np.isfinite(pose).all() or np.abs(pose[:3, :3].T @ pose[:3, :3] - np.eye(3)).max() > 1e-6:
        raise InputError(f"{what}: got an array of shape {pose.shape}, allowed a rigid motion (4, 4)")
    return pose


def numbers(value: Any, count: int) -> np.ndarray | None:
    """Return a finite vector of this length, or None."""
    try:
        vector = np.asarray(value, dtype=float)
    except Exception:  # whatever a user's object does when it is read, the loop goes on
        return None
    return vector.copy() if vector.shape == (count,) and np.isfinite(vector).all() else None
