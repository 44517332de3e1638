"""A demo recording, for first steps without a file: a stooped person turns a screwdriver."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import casadi as ca
import numpy as np

from ergoqp.human import Body, Kinematics
from ergoqp.joints import INDEX, JOINTS, SIDES
from ergoqp.mocap.formats.bvh import write_bvh

STATURE: Final = 1.72
"""Stature of the person in the recording [m]."""

RATE: Final = 30.0
"""Frame rate [Hz]."""

_STANDING: Final[Mapping[str, float]] = {
    f"{side}_{joint}": angle
    for side in SIDES
    for joint, angle in (
        ("shoulder_abduction", 6),
        ("elbow_flexion", 15),
        ("hip_flexion", 4),
        ("knee_flexion", 8),
        ("ankle_flexion", 4),
    )
}
_STOOPED: Final[Mapping[str, float]] = {
    "trunk_flexion": 42,
    "trunk_side_bend": -6,
    "trunk_twist": 14,
    "neck_flexion": 24,
    "neck_twist": 12,
    "neck_side_bend": 4,
    "right_shoulder_flexion": 68,
    "right_shoulder_abduction": 26,
    "right_shoulder_rotation": 14,
    "right_elbow_flexion": 62,
    "right_forearm_pronation": 35,
    "right_wrist_flexion": -22,
    "right_wrist_deviation": 14,
    "left_shoulder_flexion": 52,
    "left_shoulder_abduction": 12,
    "left_shoulder_rotation": 20,
    "left_elbow_flexion": 48,
    "left_forearm_pronation": 20,
    "left_wrist_flexion": -10,
    **{f"{side}_hip_flexion": 14 for side in SIDES},
    **{f"{side}_knee_flexion": 28 for side in SIDES},
    **{f"{side}_ankle_flexion": 14 for side in SIDES},
}
_TURNED: Final[Mapping[str, float]] = {
    **_STOOPED,
    "right_forearm_pronation": -40,
    "right_wrist_deviation": 4,
    "trunk_twist": 11,
}

_KEYS: Final[tuple[tuple[float, Mapping[str, float]], ...]] = (
    (0.0, _STANDING),
    (0.4, _STANDING),
    (1.7, _STOOPED),
    *((1.7 + 0.45 * stroke, _TURNED if stroke % 2 else _STOOPED) for stroke in range(1, 9)),
    (6.0, {**_STOOPED, "trunk_flexion": 46, "neck_flexion": 30}),
)
"""Times [s] and key postures [deg; zero if not named]; the motion between them is smooth."""


def demo_recording(path: str | Path) -> Path:
    """Write a BVH recording of six seconds.

    It shows reaching down from standing, then four strokes with a screwdriver.

    Args:
        path: path of the file, with the ending ``.bvh``.

    Returns:
        The path of the file.
    """
    time = np.arange(0.0, _KEYS[-1][0] + 0.5 / RATE, 1.0 / RATE)
    postures = _minimum_jerk(time)
    body = Body.of_stature(STATURE)
    return write_bvh(path, postures, _standing_still(body, postures), body, 1.0 / RATE)


def _minimum_jerk(time: np.ndarray) -> np.ndarray:
    """Return the postures (n, 32) [rad] at given times: from key to key, at rest at each key."""
    at = np.array([moment for moment, _ in _KEYS])
    keys = np.zeros((len(_KEYS), len(JOINTS)))
    for row, (_, posture) in zip(keys, _KEYS, strict=True):
        for joint, angle in posture.items():
            row[INDEX[joint]] = np.radians(angle)
    before = np.clip(np.searchsorted(at, time, side="right") - 1, 0, len(at) - 2)
    s = ((time - at[before]) / (at[before + 1] - at[before]))[:, None]
    return keys[before] + (10 * s**3 - 15 * s**4 + 6 * s**5) * (keys[before + 1] - keys[before])


def _standing_still(body: Body, postures: np.ndarray) -> np.ndarray:
    """Return the pelvis poses (n, 4, 4) with which the soles stay in place on the floor."""
    kinematics = Kinematics(body)
    soles = [kinematics.function(f"{side}_sole")(ca.DM(postures.T))[0].full().T for side in SIDES]
    poses = np.tile(np.eye(4), (len(postures), 1, 1))
    poses[:, :3, 3] = -np.mean(soles, axis=0)
    return poses
