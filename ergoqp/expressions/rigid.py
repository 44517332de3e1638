"""Rigid motions as expressions, and rotations as quaternions in files."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import casadi as ca
import mujoco
import numpy as np

from ergoqp.arguments import shown, unmasked
from ergoqp.errors import InputError


def exp_rotation(pose: ca.SX, displacement: ca.SX) -> ca.SX:
    """Return `pose` (4, 4) moved by a world-aligned displacement (6,).

    The rotation stays orthonormal for any number of moves.
    """
    moved = shifted(pose, displacement)
    moved[:3, :3] = _straightened(moved[:3, :3])
    return moved


def shifted(pose: ca.SX, displacement: ca.SX) -> ca.SX:
    """Return `pose` (4, 4) shifted and rotated by a world-aligned displacement (6,).

    The first three entries of the displacement shift the pose, the last three rotate it.

    The rotation is the exact exponential.
    """
    bottom = ca.SX([[0, 0, 0, 1]])
    return ca.vertcat(
        ca.horzcat(turned(displacement[3:], pose[:3, :3]), pose[:3, 3] + displacement[:3]), bottom
    )


def turned(turn: ca.SX, vectors: ca.SX) -> ca.SX:
    """Return vectors (3, n) rotated by a rotation vector (3,) [rad]."""
    angle = ca.sqrt(ca.sumsqr(turn) + 1e-30)
    cross = ca.skew(turn)
    rotation = (
        ca.SX.eye(3)
        + ca.sin(angle) / angle * cross
        + (2 * ca.sin(angle / 2) ** 2) / angle**2 * (cross @ cross)
    )
    return rotation @ vectors


def rotation_error(rotation: ca.SX) -> ca.SX:
    """Return the distance of a 3 x 3 matrix from a rotation: the largest entry of R'R - I.

    It is 2 for a reflection and for NaN.
    """
    apart = ca.mmax(ca.fabs(ca.reshape(rotation.T @ rotation - ca.SX.eye(3), 9, 1)))
    # mmax ignores NaN, but the determinant is then NaN, which is not above zero.
    return ca.if_else(ca.det(rotation) > 0, apart, 2.0)


def is_rigid(pose: ca.SX) -> ca.SX:
    """Return whether a matrix (4, 4) is a rigid motion, finite and within 100 m."""
    bottom = ca.sumsqr(pose[3, :] - ca.DM([[0, 0, 0, 1]])) < 1e-6
    return ca.logic_and(
        ca.logic_and(rotation_error(pose[:3, :3]) < 1e-3, bottom), ca.sumsqr(pose[:3, 3]) < 1e4
    )


def normalised(pose: ca.SX) -> ca.SX:
    """Return the nearest rigid motion (4, 4) to a matrix that `is_rigid`, up to rounding."""
    bottom = ca.SX([[0, 0, 0, 1]])
    # Two steps reduce the error from 1e-3 to 4e-7 to 1e-13.
    return ca.vertcat(ca.horzcat(_straightened(_straightened(pose[:3, :3])), pose[:3, 3]), bottom)


def read_pose(what: str, value: Any) -> np.ndarray:
    """Return a user's pose (4, 4) for the control step, see `is_rigid` and `normalised`.

    Args:
        what: name of the value, for the message.
        value: the value, of any type.

    Raises:
        InputError: if it is not a rigid motion within 100 m.
    """
    try:
        pose = np.array(unmasked(value), dtype=float)
    except Exception:  # not an array
        raise InputError(f"{what}: got {shown(value)}, allowed a pose (4, 4)") from None
    if pose.shape != (4, 4):
        raise InputError(f"{what}: got shape {pose.shape}, allowed a pose (4, 4)")
    read, rigid = _read_pose()(pose)
    if not rigid:
        raise InputError(
            f"{what}: got a pose that is {_what_is_wrong(pose)}, allowed a rotation and a position"
            " within 100 m"
        )
    return np.array(read)


@cache
def _read_pose() -> ca.Function:
    pose = ca.SX.sym("pose", 4, 4)
    return ca.Function("read_pose", [pose], [ca.densify(normalised(pose)), is_rigid(pose)])


def _what_is_wrong(pose: np.ndarray) -> str:
    if not np.isfinite(pose).all():
        return "not finite"
    if not np.allclose(pose[3], [0, 0, 0, 1], atol=1e-3):
        return f"not a rigid motion: its last row is {pose[3].tolist()}"
    if np.linalg.det(pose[:3, :3]) < 0:
        return "a mirror"
    if np.linalg.norm(pose[:3, 3]) >= 100:
        return "far away"
    return "not a rigid motion"


def _straightened(rotation: ca.SX) -> ca.SX:
    """Return the rotation after one Newton step toward the nearest rotation."""
    return 1.5 * rotation - 0.5 * rotation @ (rotation.T @ rotation)


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
