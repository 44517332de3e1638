"""The segments that markers may be fixed to, as expressions of pelvis, posture and growth."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import casadi as ca

from ergoqp.human import Body, Kinematics
from ergoqp.human.body import GROWTH
from ergoqp.human.kinematics import base_jacobian
from ergoqp.joints import JOINTS, SIDES

SIZE: Final = 4 + len(JOINTS)
"""Number of variables of a pelvis and a posture."""
SEGMENTS: Final = (
    "pelvis",
    "trunk",
    "head",
    *(
        f"{side}_{name}"
        for side in SIDES
        for name in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
    ),
)
"""One frame of each segment that markers may be fixed to."""


def inputs() -> tuple[ca.SX, ca.SX]:
    """Return symbols of pelvis and posture (36,), x, y, z [m] and angles [rad]; growth (14,)."""
    return ca.SX.sym("z", SIZE), ca.SX.sym("growth", len(GROWTH))


def segments(z: ca.SX, growth: ca.SX) -> Iterator[tuple[ca.SX, ca.SX, ca.SX]]:
    """Yield position (3,) [m], axes (3, 3) and Jacobian (6, 36) of `SEGMENTS` in the world.

    Args:
        z: pelvis and posture, from `inputs`.
        growth: growth of the body, from `inputs`.
    """
    kinematics = Kinematics(Body(), growth)
    cos, sin = ca.cos(z[3]), ca.sin(z[3])
    yaw = ca.blockcat([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    for frame in SEGMENTS:
        place, turn, jacobian = kinematics.at(frame, z[4:])
        own = ca.vertcat(yaw @ jacobian[:3, :], yaw @ jacobian[3:, :])
        moved = ca.horzcat(base_jacobian(yaw @ place), own)
        yield z[:3] + yaw @ place, yaw @ turn, moved
