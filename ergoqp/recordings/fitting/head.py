"""Heads of skeletons whose neck leans forward while the person looks straight ahead.

The body's neck stands straight on the trunk at zero. Many skeletons put their neck and head joints
on the spine, whose upper end leans forward in everyone; read as it is, an upright head would be
scored as bent. A skeleton whose rest pose is known to look straight ahead tells how much.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

_HEAD: Final = ("head", "head_top", "nose")


def rest_lean(rest: Mapping[str, np.ndarray]) -> float:
    """Return how far the neck leans forward of the trunk in a rest pose [rad].

    It is 0 where the rest pose does not tell.

    Args:
        rest: centre -> position (3,) in the rest pose, any unit, x forward, y left, z up.
    """
    left = _left({centre: place[None] for centre, place in rest.items()})
    if left is None or not {"neck", "head", "right_hip", "left_hip"} <= set(rest):
        return 0.0
    trunk = rest["neck"] - (rest["right_hip"] + rest["left_hip"]) / 2
    neck = rest["head"] - rest["neck"]
    forward = np.cross(left[0], trunk)
    return float(np.arctan2(forward @ neck, trunk @ neck))


def straighten_head(centres: Mapping[str, np.ndarray], lean: float) -> dict[str, np.ndarray]:
    """Return the centres with the head turned back about the base of the neck.

    The axis of the turn goes from left to right through the body.

    Args:
        centres: centre -> positions (n, 3) [m], with the neck and a pair of shoulders or hips.
        lean: angle to take away [rad].
    """
    turned = dict(centres)
    left = _left(centres)
    for name in _HEAD:
        if left is not None and name in centres and "neck" in centres:
            arm = centres[name] - centres["neck"]
            along = np.einsum("ni,ni->n", left, arm)[:, None] * left
            # A forward lean is a positive turn about the axis to the left; this one goes back.
            turned[name] = (
                centres["neck"]
                + along
                + np.cos(lean) * (arm - along)
                - np.sin(lean) * np.cross(left, arm)
            )
    return turned


def _left(centres: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Return the unit vectors from right to left (n, 3), of the shoulders or else the hips."""
    for joint in ("shoulder", "hip"):
        if f"right_{joint}" in centres and f"left_{joint}" in centres:
            across = centres[f"left_{joint}"] - centres[f"right_{joint}"]
            length = np.linalg.norm(across, axis=1, keepdims=True)
            with np.errstate(invalid="ignore", divide="ignore"):
                return across / length
    return None
