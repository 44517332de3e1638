"""Poses that a problem allows, and the straight path between two poses."""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np

from ergoqp.errors import InputError
from ergoqp.limits import AXES, AxisCone, WorkspaceBox
from ergoqp.problem.problem import Problem

_TILT = 0.9
"""Largest tilt of places, as a share of the cone's half angle."""


class Workspace:
    """Poses that a problem allows, as points of a cube.

    Args:
        problem: a problem with both a workspace and a tool axis.

    Raises:
        InputError: if one of the two is missing.
    """

    def __init__(self, problem: Problem) -> None:
        """Read the limits."""
        box, cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
        if box is None or cone is None:
            missing = "workspace" if box is None else "tool_axis"
            raise InputError(
                f"problem {problem.name}: got no limits.{missing}, allowed both limits.workspace"
                " and limits.tool_axis where places are looked for"
            )
        self._lower, self._upper = np.asarray(box.lower), np.asarray(box.upper)
        self._middle = frame_of(np.asarray(cone.direction))
        self._half = np.radians(cone.half_angle_deg) * _TILT
        axes = problem.twist_limit.axes
        turns = [("rx" in axes or axis in axes) for axis in ("ry", "rz")]
        self.moves = np.array([*(self._upper > self._lower + 1e-9), *turns])
        self.moves[:3] &= [axis in axes for axis in AXES[:3]]

    def pose(self, point: np.ndarray) -> np.ndarray:
        """Return the pose (4, 4) of a point (5,) of the cube from -1 to 1."""
        point = np.where(self.moves, point, 0.0)
        tilt = point[3:] / max(1.0, float(np.linalg.norm(point[3:]))) * self._half
        pose = np.eye(4)
        pose[:3, 3] = (self._lower + self._upper) / 2 + point[:3] * (self._upper - self._lower) / 2
        pose[:3, :3] = self._middle @ turn_about(1, tilt[0]) @ turn_about(2, tilt[1])
        return pose

    def spread(self, count: int) -> np.ndarray:
        """Return points (n, 5) spread evenly over the cube, from the Halton sequence."""
        from scipy.stats.qmc import Halton

        return 2 * Halton(5, scramble=False).random(count + 1)[1:] - 1


def frame_of(direction: np.ndarray) -> np.ndarray:
    """Return the rotation (3, 3) with x along a direction and y horizontal, to its left."""
    x = direction / np.linalg.norm(direction)
    up = np.array([0.0, 0.0, 1.0]) if abs(x[2]) < 0.99 else np.array([-1.0, 0.0, 0.0])
    y = np.cross(up, x)
    y /= np.linalg.norm(y)
    return np.column_stack([x, y, np.cross(x, y)])


def turn_about(axis: int, angle: float) -> np.ndarray:
    """Return the rotation (3, 3) by an angle [rad] about axis 0, 1 or 2."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rotation = np.eye(3)
    rotation[i, i] = rotation[j, j] = np.cos(angle)
    rotation[i, j], rotation[j, i] = -np.sin(angle), np.sin(angle)
    return rotation


LONGEST_SHIFT = 0.04
LONGEST_TURN = 0.16
"""Longest part of a path [m], [rad]."""


def rotation_vector(have: np.ndarray, want: np.ndarray) -> np.ndarray:
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
    way[3:] = rotation_vector(have[:3, :3], want[:3, :3])
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
