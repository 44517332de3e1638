"""The straight path between two poses."""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np

LONGEST_SHIFT = 0.04
LONGEST_TURN = 0.16
"""Longest part of a path [m], [rad]."""


def turn_between(have: np.ndarray, want: np.ndarray) -> np.ndarray:
    """Return the world-aligned turn (3,) [rad] that leads from one rotation (3, 3) to another."""
    quaternion, turn = np.empty(4), np.empty(3)
    mujoco.mju_mat2Quat(quaternion, (want @ have.T).ravel())
    mujoco.mju_quat2Vel(turn, quaternion, 1.0)
    return turn


def turned(rotation: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Return a rotation (3, 3) turned by a world-aligned rotation vector (3,) [rad]."""
    quaternion, matrix = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(9)
    mujoco.mju_quatIntegrate(quaternion, turn, 1.0)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3) @ rotation


def pose_error(have: np.ndarray, want: np.ndarray) -> np.ndarray:
    """Return the world-aligned motion (6,) [m, rad] that leads from one pose (4, 4) to another."""
    way = np.empty(6)
    way[:3] = want[:3, 3] - have[:3, 3]
    way[3:] = turn_between(have[:3, :3], want[:3, :3])
    return way


def between(have: np.ndarray, want: np.ndarray, share: float) -> np.ndarray:
    """Return the pose (4, 4) at a share (0 to 1) of the straight path from one pose to another."""
    way, pose = pose_error(have, want), have.copy()
    pose[:3, 3] += share * way[:3]
    pose[:3, :3] = turned(have[:3, :3], share * way[3:])
    return pose


def straight(have: np.ndarray, want: np.ndarray) -> Iterator[np.ndarray]:
    """Yield poses (4, 4) along the straight path between two poses; the last is its end."""
    way = pose_error(have, want)
    parts = max(
        1,
        int(np.ceil(np.linalg.norm(way[:3]) / LONGEST_SHIFT)),
        int(np.ceil(np.linalg.norm(way[3:]) / LONGEST_TURN)),
    )
    for part in range(1, parts):
        yield between(have, want, part / parts)
    yield want.copy()
