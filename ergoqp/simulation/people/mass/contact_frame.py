"""Frames of a person's model: those of its sites, and that of the object in the hands."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from ergoqp.simulation.people.grasp import contact_of


def contact_in(data: mujoco.MjData, hands: Sequence[str], tool: str) -> np.ndarray:
    """Return the contact frame (4, 4) [m] of a person's hands."""
    return contact_of([site_pose(data, f"{side}_grip") for side in hands], tool)


def site_pose(data: mujoco.MjData, name: str) -> np.ndarray:
    """Return the pose (4, 4) of a frame of a person's model [m]."""
    site, pose = data.site(name), np.eye(4)
    pose[:3, :3], pose[:3, 3] = site.xmat.reshape(3, 3), site.xpos
    return pose
