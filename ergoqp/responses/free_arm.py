"""An arm that holds nothing: it hangs straight down whatever the trunk does, or stays as it is.

The sheet measures the upper arm relative to the trunk and scores both arms. So an arm that hangs
beside a trunk that leans forward counts as an upper arm in flexion.
"""

from __future__ import annotations

from typing import Final

import casadi as ca

from ergoqp.joints import INDEX, JOINTS

HANGING_DEG: Final[dict[str, float]] = {"shoulder_abduction": 5.0, "elbow_flexion": 12.0}
"""Angles of an arm that hangs beside an upright trunk [deg]; all others are zero."""

_TRUNK: Final = ("trunk_flexion", "trunk_side_bend", "trunk_twist")
TRUNK: Final = [INDEX[joint] for joint in _TRUNK]
"""Numbers of the joints of the trunk."""

_ASIDE: Final = {"right": -1.0, "left": 1.0}
_NEARLY: Final = 1 - 1e-9


def arm_of(side: str) -> list[int]:
    """Return the numbers of the seven joints of an arm."""
    chain = ("shoulder", "elbow", "forearm", "wrist")
    return [
        INDEX[joint]
        for joint in JOINTS[:20]
        if joint.startswith(tuple(f"{side}_{p}" for p in chain))
    ]


def swinging(side: str) -> list[int]:
    """Return the numbers of the joints that gravity turns: the first two of the shoulder."""
    return [INDEX[f"{side}_shoulder_flexion"], INDEX[f"{side}_shoulder_abduction"]]


def hanging(trunk: ca.SX, side: str, ease: ca.SX) -> ca.SX:
    """Return flexion and abduction (2,) [rad] of an arm that hangs beside a trunk.

    Args:
        trunk: flexion, side bend and twist of the trunk (3,) [rad].
        side: side of the arm.
        ease: the two angles beside an upright trunk (2,) [rad].
    """
    aside = _ASIDE[side]
    flexion, abduction = ease[0], ease[1]
    upright = ca.vertcat(
        ca.sin(flexion) * ca.cos(abduction),
        aside * ca.sin(abduction),
        -ca.cos(flexion) * ca.cos(abduction),
    )
    # The arm turns with the trunk about the vertical, and does not lean with it.
    forward, sideways, twist = trunk[0], trunk[1], trunk[2]
    down = (
        _about(2, -twist) @ _about(0, sideways) @ _about(1, -forward) @ _about(2, twist) @ upright
    )
    across = ca.fmax(ca.fmin(aside * down[1], _NEARLY), -_NEARLY)
    return ca.vertcat(ca.atan2(down[0], -down[2]), ca.asin(across))


def _about(axis: int, angle: ca.SX) -> ca.SX:
    """Return the rotation (3, 3) by an angle [rad] about axis 0, 1 or 2."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rotation = ca.SX.eye(3)
    rotation[i, i] = rotation[j, j] = ca.cos(angle)
    rotation[i, j], rotation[j, i] = -ca.sin(angle), ca.sin(angle)
    return rotation
