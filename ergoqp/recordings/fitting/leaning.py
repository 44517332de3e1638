"""Lean of a skeleton's trunk and neck, and the joint centres after it is removed.

The line from the middle of the hips to the base of the neck is vertical in few skeletons of an
upright person, because a skeleton's joints are not in line where the angles of the spine are zero.
The neck leans forward in everyone. Without a correction, an upright head would be scored as bent.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

_HEAD: Final = ("head", "head_top", "nose")
_LEGS: Final = ("pelvis", "hip", "knee", "ankle", "toe")


def leans(places: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return the forward lean of the trunk, and of the neck to the trunk, each (n,) [rad].

    NaN where the recording does not determine it.

    Args:
        places: centre -> positions (n, 3), any unit, x forward, y left, z up.
    """
    count = len(next(iter(places.values())))
    unknown = np.full(count, np.nan)
    hips, left = _hips(places), _left(places)
    if hips is None or left is None or "neck" not in places:
        return unknown, unknown
    trunk = places["neck"] - hips
    level = left * [1.0, 1.0, 0.0]
    level /= np.maximum(np.linalg.norm(level, axis=1, keepdims=True), 1e-12)
    ahead = np.stack([level[:, 1], -level[:, 0], 0 * level[:, 0]], axis=1)
    lean = np.arctan2((ahead * trunk).sum(axis=1), trunk[:, 2])
    skull = places.get("head_top", places.get("head"))
    if skull is None:
        return lean, unknown
    neck = skull - places["neck"]
    forward = np.cross(left, trunk)
    size = np.linalg.norm(forward, axis=1)
    along = (trunk * neck).sum(axis=1) * size / np.linalg.norm(trunk, axis=1).clip(1e-12)
    return lean, np.arctan2((forward * neck).sum(axis=1), along)


def straightened(
    places: Mapping[str, np.ndarray], trunk: float, neck: float
) -> dict[str, np.ndarray]:
    """Return the centres after the trunk and the neck have been turned back.

    The base of the neck is rotated back about the hips. Everything above the hips is shifted by the
    same vector, without a rotation. The head is rotated back about the base of the neck.

    Args:
        places: centre -> positions (n, 3) [m].
        trunk: angle by which the trunk is turned back [rad].
        neck: angle by which the neck is turned back [rad], relative to the original trunk.
    """
    left, shift = _left(places), shift_of(places, trunk)
    if left is None or shift is None or trunk == neck == 0.0:
        return dict(places)
    left = _bridged(left)
    found = {
        centre: path if centre.endswith(_LEGS) else (path + shift).astype(path.dtype)
        for centre, path in places.items()
    }
    for name in _HEAD:
        if name in found:
            # Turning the trunk back makes the neck lean more by that angle: it is removed, too.
            arm = _turned(found[name] - found["neck"], left, -trunk - neck)
            found[name] = (found["neck"] + arm).astype(found[name].dtype)
    return found


def shift_of(places: Mapping[str, np.ndarray], trunk: float) -> np.ndarray | None:
    """Return the shift of everything above the hips (n, 3) [m]; None if there is no trunk.

    Args:
        places: centre -> positions (n, 3) [m].
        trunk: angle by which the trunk is turned back [rad].
    """
    hips, left = _hips(places), _left(places)
    if hips is None or left is None or "neck" not in places:
        return None
    # The shift is interpolated where a hip is not seen for a moment.
    level = _bridged(left) * [1.0, 1.0, 0.0]
    level /= np.maximum(np.linalg.norm(level, axis=1, keepdims=True), 1e-12)
    arm = places["neck"] - hips
    return _bridged(_turned(arm, level, -trunk) - arm)


def _turned(vectors: np.ndarray, axis: np.ndarray, angle: float) -> np.ndarray:
    """Return vectors (n, 3) rotated about unit axes (n, 3); about the left axis this is forward."""
    along = (axis * vectors).sum(axis=1, keepdims=True) * axis
    across = np.cross(axis, vectors)
    return along + np.cos(angle) * (vectors - along) + np.sin(angle) * across


def _bridged(vectors: np.ndarray) -> np.ndarray:
    """Return vectors (n, 3), linearly interpolated where they are not seen."""
    seen = np.isfinite(vectors).all(axis=1)
    if seen.all() or not seen.any():
        return vectors
    at = np.arange(len(vectors))
    return np.stack([np.interp(at, at[seen], each[seen]) for each in vectors.T], axis=1)


def _hips(places: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Return the middle of the hips (n, 3); the pelvis where one of them is not seen."""
    pelvis = places.get("pelvis")
    if "right_hip" not in places or "left_hip" not in places:
        return pelvis
    hips = (places["right_hip"] + places["left_hip"]) / 2
    return hips if pelvis is None else np.where(np.isfinite(hips), hips, pelvis)


def _left(places: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Return the unit vectors from right to left (n, 3), of the hips or else of the shoulders."""
    found = None
    for joint in ("hip", "shoulder"):
        if f"right_{joint}" in places and f"left_{joint}" in places:
            across = places[f"left_{joint}"] - places[f"right_{joint}"]
            length = np.linalg.norm(across, axis=1, keepdims=True)
            unit = across / np.where(length > 0, length, np.nan)
            found = unit if found is None else np.where(np.isfinite(found), found, unit)
    return found
