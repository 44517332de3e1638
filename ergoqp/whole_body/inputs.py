"""Checks of a user's inputs, when a whole body is made and in the loop."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from ergoqp.arguments import shown, unmasked
from ergoqp.errors import InputError
from ergoqp.joints import JOINTS
from ergoqp.whole_body.robot import Robot, load_robot

_PLAUSIBLE: Final = 2.0
"""A joint measured faster than its largest speed times this is a measurement error."""


_TURN: Final = 2 * np.pi
"""A joint measured farther outside its range than this is a measurement error [rad]."""


def size_of(value: Any) -> tuple[float, float, float]:
    """Return the side lengths of a box [m].

    Raises:
        InputError: if they are not three numbers from 0.001 to 1 m.
    """
    sides = numbers(value, 3)
    if sides is None or (sides < 0.001).any() or (sides > 1.0).any():
        raise InputError(
            f"object_size: got {shown(value)}, allowed three side lengths from 0.001 to 1 m"
        )
    return float(sides[0]), float(sides[1]), float(sides[2])


def posture_of(value: Any) -> np.ndarray:
    """Return a posture (32,) [rad].

    Raises:
        InputError: if it is not 32 finite numbers.
    """
    angles = numbers(value, len(JOINTS))
    if angles is None:
        shape = (
            f"an array of shape {value.shape}"
            if isinstance(value, np.ndarray)
            else f"a {type(value).__name__}"
        )
        raise InputError(f"posture: got {shape}, allowed {len(JOINTS)} finite numbers")
    return angles


def robot_of(robot: Any, frame: str | None) -> Robot:
    """Return a given robot, or load one from a file.

    Raises:
        InputError: if a frame is given in addition to a robot that has one, or as in `load_robot`.
    """
    if not isinstance(robot, Robot):
        return load_robot(robot, frame)
    if frame is not None:
        raise InputError(
            f"frame: got {shown(frame)} beside a robot whose frame is {robot.frame!r}, allowed"
            " None: name it to load_robot"
        )
    return robot


def start_of(start: Any, robot: Robot) -> np.ndarray:
    """Return joint positions (k,) [rad].

    Raises:
        InputError: if they are not k numbers within the ranges of the arm.
    """
    joints = numbers(start, len(robot.joints))
    if joints is None or (joints < robot.lower).any() or (joints > robot.upper).any():
        raise InputError(
            f"start: got {shown(start)}, allowed {len(robot.joints)} joint positions within their"
            " ranges"
        )
    return joints


def implausible_position(robot: Robot, positions: np.ndarray) -> str | None:
    """Return in words which joint is measured at an impossible position, or None.

    Args:
        robot: robot with the ranges.
        positions: positions of the joints (k,) [rad].
    """
    over = np.maximum(robot.lower - positions, positions - robot.upper) - _TURN
    worst = int(np.argmax(over))
    if over[worst] <= 0:
        return None
    low, high = robot.lower[worst], robot.upper[worst]
    return (
        f"arm: {robot.joints[worst]} is {positions[worst]:.4g} rad, allowed {low:.4g} to"
        f" {high:.4g}, and a turn beyond"
    )


def implausible_speed(robot: Robot, speeds: np.ndarray) -> str | None:
    """Return in words which joint is measured at an impossible speed, or None.

    Args:
        robot: robot with the largest speeds.
        speeds: speeds of the joints (k,) [rad/s].
    """
    over = np.abs(speeds) - _PLAUSIBLE * robot.velocity
    worst = int(np.argmax(over))
    if over[worst] <= 0:
        return None
    most = _PLAUSIBLE * robot.velocity[worst]
    return (
        f"arm_speed: {robot.joints[worst]} is {speeds[worst]:.4g} rad/s, allowed within"
        f" +-{most:.4g}, twice its largest speed"
    )


def numbers(value: Any, count: int) -> np.ndarray | None:
    """Return a finite vector of this length, or None."""
    try:
        vector = np.asarray(unmasked(value), dtype=float)
    except Exception:  # any error of a user's object; the loop goes on
        return None
    return vector.copy() if vector.shape == (count,) and np.isfinite(vector).all() else None
