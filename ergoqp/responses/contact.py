"""The contact frame, in which hands and object meet: at the grip, or midway between two grips."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import casadi as ca
import numpy as np

TOOL_AXES: Final[dict[str, tuple[tuple[float, float, float], ...]]] = {
    "along": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "thumb": ((0, 0, 1), (0, 1, 0), (-1, 0, 0)),
}
"""Axes of the contact frame in the grip frame; x is the axis of the tool.

The tool points out of the fist along the forearm, or past the thumb.
"""


def contact_frame(grips: Sequence[tuple[ca.SX, ca.SX]], tool: str) -> tuple[ca.SX, ca.SX]:
    """Return position and rotation of the contact frame from those of the grips.

    One hand: the grip, turned so that x is the axis of the tool. Two hands: midway, with y from the
    right grip to the left one, and x as close to the mean of the two tool axes as possible.
    """
    turn = ca.DM(np.array(TOOL_AXES[tool], dtype=float).T)
    if len(grips) == 1:
        position, rotation = grips[0]
        return position, rotation @ turn
    (right, right_rotation), (left, left_rotation) = grips
    y = _unit(left - right)
    x = (right_rotation @ turn + left_rotation @ turn)[:, 0]
    x = _unit(x - y * ca.dot(x, y))
    return (right + left) / 2, ca.horzcat(x, y, ca.cross(x, y))


def about_tool(axis: ca.SX, free: bool) -> ca.SX:
    """Return the projector (6, 6) on turns about the tool's axis; zero for a rigid grasp."""
    projector = ca.SX(6, 6)
    if free:
        projector[3:, 3:] = axis @ axis.T
    return projector


def carried_to(offset: ca.SX) -> ca.SX:
    """Return the map (6, 6) from a twist to the motion of a fixed point at `offset`."""
    carried = ca.SX.eye(6)
    carried[:3, 3:] = -ca.skew(offset)
    return carried


def pose_matrix(position: ca.SX, rotation: ca.SX) -> ca.SX:
    """Return the pose (4, 4) of a frame."""
    return ca.vertcat(ca.horzcat(rotation, position), ca.SX([[0, 0, 0, 1]]))


def _unit(vector: ca.SX) -> ca.SX:
    return vector / ca.sqrt(ca.sumsqr(vector) + 1e-12)
