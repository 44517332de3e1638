"""Where the object is in the hands: its contact frame, read off the grips."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import mujoco
import numpy as np

AXIS: Final = {"along": (1.0, 0.0, 0.0), "thumb": (0.0, 0.0, 1.0)}
"""The tool's axis in a grip's frame: out of the fist, or past the thumb."""


def contact_of(grips: Sequence[np.ndarray], tool: str) -> np.ndarray:
    """Return the contact frame (4, 4) [m] of grips (4, 4): x is the tool's axis.

    One hand: at the grip. Two hands: midway, y from the right grip to the left one, x as near as
    that allows to the mean of the two tools' axes.
    """
    frame = np.eye(4)
    frame[:3, 3] = np.mean([grip[:3, 3] for grip in grips], axis=0)
    x = np.sum([grip[:3, :3] @ AXIS[tool] for grip in grips], axis=0)
    if len(grips) == 1:
        frame[:3, 0], frame[:3, 1] = x, grips[0][:3, 1]
    else:
        y = grips[1][:3, 3] - grips[0][:3, 3]
        frame[:3, 1] = y / np.linalg.norm(y)
        x = x - frame[:3, 1] * (frame[:3, 1] @ x)
        frame[:3, 0] = x / np.linalg.norm(x)
    frame[:3, 2] = np.cross(frame[:3, 0], frame[:3, 1])
    return frame


def contact_in(data: mujoco.MjData, hands: Sequence[str], tool: str) -> np.ndarray:
    """Return the contact frame (4, 4) [m] of a person's hands."""
    return contact_of([site_pose(data, f"{side}_grip") for side in hands], tool)


def site_pose(data: mujoco.MjData, name: str) -> np.ndarray:
    """Return the pose (4, 4) of a frame of a person's model [m]."""
    site, pose = data.site(name), np.eye(4)
    pose[:3, :3], pose[:3, 3] = site.xmat.reshape(3, 3), site.xpos
    return pose
