"""Conversion between the simulated pelvis, which tilts, and postures, whose pelvis is upright."""

from __future__ import annotations

from typing import Final

import numpy as np

from ergoqp.joints import INDEX

# Columns of the joints that take up the tilt of a pelvis, and the signs of their axes relative
# to y, x, z.
_CARRIERS: Final = tuple(
    (np.array([INDEX[name] for name in names]), np.array(signs, dtype=float))
    for names, signs in (
        (("trunk_flexion", "trunk_side_bend", "trunk_twist"), (1, -1, 1)),
        (("right_hip_flexion", "right_hip_abduction", "right_hip_rotation"), (-1, -1, 1)),
        (("left_hip_flexion", "left_hip_abduction", "left_hip_rotation"), (-1, 1, -1)),
    )
)


def upright(rotation: np.ndarray) -> np.ndarray:
    """Return the upright frame (3, 3) with the heading of a pelvis (3, 3)."""
    x, y = rotation[0, 0], rotation[1, 0]
    if np.hypot(x, y) < 0.1:  # Face down or up: its left side gives the heading.
        x, y = rotation[1, 1], -rotation[0, 1]
    x, y = np.array([x, y]) / np.hypot(x, y)
    return np.array([[x, -y, 0.0], [y, x, 0.0], [0.0, 0.0, 1.0]])


def reported(rotation: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Return the posture (32,) with an upright pelvis and all other segments in the same pose.

    Args:
        rotation: rotation of the pelvis in the world (3, 3).
        angles: angles of the simulated hinges (32,) [rad].
    """
    tilt = upright(rotation).T @ rotation
    posture = angles.copy()
    for columns, signs in _CARRIERS:
        a, b, c = angles[columns] * signs
        r = tilt @ _turn(a, b, c)
        posture[columns] = signs * [
            np.arctan2(r[0, 2], r[2, 2]),
            np.arcsin(np.clip(-r[1, 2], -1.0, 1.0)),
            np.arctan2(r[1, 0], r[1, 1]),
        ]
    return posture


def _turn(a: float, b: float, c: float) -> np.ndarray:
    """Return the rotation (3, 3) by a about y, then b about its x, then c about its z [rad]."""
    ca, cb, cc = np.cos((a, b, c))
    sa, sb, sc = np.sin((a, b, c))
    return np.array(
        [
            [ca * cc + sa * sb * sc, -ca * sc + sa * sb * cc, sa * cb],
            [cb * sc, cb * cc, -sb],
            [-sa * cc + ca * sb * sc, sa * sc + ca * sb * cc, ca * cb],
        ]
    )
