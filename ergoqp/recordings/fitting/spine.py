"""Pose of the pelvis, and angles of trunk and neck, in closed form.

The pelvis is upright by definition and has the heading of the hips. The trunk is the line from the
middle of the hips to the base of the neck, with the twist of the shoulders. The neck is the line
from there to the top of the head, or its base, with the twist of the nose.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from ergoqp.joints import INDEX, LOWER, UPPER
from ergoqp.recordings.fitting.steady import filled

_PAIRS: Final = ("hip", "shoulder", "knee", "elbow", "ankle", "wrist")
"""Pairs of centres that define the heading of the body, the best first."""


@dataclass(frozen=True, eq=False)
class Spine:
    """Pelvis, trunk and neck over time.

    Attributes:
        pelvis: x, y, z [m] and yaw [rad] of the pelvis (n, 4).
        angles: joint -> angles within the range (n,) [rad].
        told: joint -> whether the recording determines it (n,) bool.
        upright: axes of the pelvis.
        trunk: axes of the trunk.
    """

    pelvis: np.ndarray
    angles: dict[str, np.ndarray]
    told: dict[str, np.ndarray]
    upright: Rotation
    trunk: Rotation


def spine_of(place: Mapping[str, np.ndarray], time: np.ndarray) -> Spine:
    """Return pelvis, trunk and neck.

    Args:
        place: every centre -> positions (n, 3) [m], NaN where not seen.
        time: times of the frames (n,) [s].
    """
    hips = _first((place["right_hip"] + place["left_hip"]) / 2, place["pelvis"])
    shoulders = (place["right_shoulder"] + place["left_shoulder"]) / 2
    neck = _first(place["neck"], shoulders)
    yaw = _unwrapped(_heading(place), time)
    pelvis = np.column_stack([*(filled(each, time) for each in hips.T), yaw])
    upright = Rotation.from_euler("Z", yaw[:, None])
    trunk, trunk_told, axes = _segment(
        "trunk",
        upright,
        neck - hips,
        place["left_shoulder"] - place["right_shoulder"],
        time,
    )
    # The nose defines left: perpendicular to where it points.
    head = _first(place["head_top"], place["head"])
    ahead = place["nose"] - _first(place["head"], neck)
    left = np.cross(head - neck, ahead)
    bent, bent_told, _ = _segment("neck", axes, head - neck, left, time)
    return Spine(pelvis, trunk | bent, trunk_told | bent_told, upright, axes)


def _segment(
    name: str, below: Rotation, along: np.ndarray, left: np.ndarray, time: np.ndarray
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], Rotation]:
    """Return flexion, side bend and twist of a segment, which are determined, and its axes."""
    x, y, z = below.inv().apply(along).T
    length = np.sqrt(x**2 + y**2 + z**2)
    bend = np.arcsin(np.clip(y / np.where(length > 0, length, np.nan), -1, 1))
    angles = {f"{name}_flexion": np.arctan2(x, z), f"{name}_side_bend": bend}
    angles = {joint: _inside(joint, each, time) for joint, each in angles.items()}
    axes = below * Rotation.from_euler("YX", np.stack(list(angles.values()), 1) * [1.0, -1.0])
    seen = np.isfinite(bend)
    x, y, _ = axes.inv().apply(left).T
    twist, turned = (
        f"{name}_twist",
        np.where(seen & (np.hypot(x, y) > 0), np.arctan2(-x, y), np.nan),
    )
    angles[twist] = _inside(twist, turned, time)
    told = {f"{name}_flexion": seen, f"{name}_side_bend": seen, twist: np.isfinite(turned)}
    return angles, told, axes * Rotation.from_euler("Z", angles[twist][:, None])


def _heading(place: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the heading of the body (n,) [rad], from the best pair that is seen; NaN: none."""
    yaw = np.full(len(place["neck"]), np.nan)
    for pair in _PAIRS:
        left = place[f"left_{pair}"] - place[f"right_{pair}"]
        yaw = np.where(np.isfinite(yaw), yaw, np.arctan2(-left[:, 0], left[:, 1]))
    return yaw


def _unwrapped(yaw: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return angles (n,) [rad], unwrapped and with gaps filled."""
    seen = np.isfinite(yaw)
    whole = np.full(len(yaw), np.nan)
    whole[seen] = np.unwrap(yaw[seen])
    return filled(whole, time)


def _inside(joint: str, angles: np.ndarray, time: np.ndarray) -> np.ndarray:
    return np.clip(filled(angles, time), LOWER[INDEX[joint]], UPPER[INDEX[joint]])


def _first(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the first positions, and the others where the first are not seen (n, 3)."""
    return np.where(np.isfinite(one).all(axis=1, keepdims=True), one, other)
