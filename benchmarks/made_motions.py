"""Motions of our own person, as joint centres: walking, stooping, and skeletons that lean."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from ergoqp.human import Body
from ergoqp.joints import INDEX, SIDES
from ergoqp.mocap import Recording, fit_postures
from ergoqp.mocap.naming import centres_of
from ergoqp.sheets.description import elevation_of

RATE = 60.0
BODY = Body.of_stature(1.72)
Places = dict[str, np.ndarray]


def posture(count: int, **angles: float | np.ndarray) -> np.ndarray:
    """Postures (n, 32) [rad] of angles [deg]; `arms_` and `legs_` stand for both sides."""
    found = np.zeros((count, 32))
    for name, angle in angles.items():
        sides = SIDES if name.startswith(("arms_", "legs_")) else ("",)
        joint = name.removeprefix("arms_").removeprefix("legs_")
        for side in sides:
            found[:, INDEX[f"{side}_{joint}" if side else joint]] = np.radians(angle)
    return found


def walk(seconds: float = 6.0, heading: float = 0.4) -> tuple[Places, np.ndarray]:
    """Somebody who walks upright: centres and time."""
    time = np.arange(int(seconds * RATE)) / RATE
    phase = 2 * np.pi * 0.9 * time
    postures = posture(len(time), arms_elbow_flexion=25.0)
    for side, turn in zip(SIDES, (0.0, np.pi), strict=True):
        swing, bend = np.sin(phase + turn), np.maximum(np.cos(phase + turn), 0)
        postures[:, INDEX[f"{side}_hip_flexion"]] = np.radians(8 + 22 * swing + 15 * bend)
        postures[:, INDEX[f"{side}_knee_flexion"]] = np.radians(8 + 50 * bend)
        postures[:, INDEX[f"{side}_shoulder_flexion"]] = np.radians(-15 * swing)
    way = 1.2 * time[:, None] * [np.cos(heading), np.sin(heading)]
    pelvis = np.column_stack([way, np.full(len(time), 0.88), np.full(len(time), heading)])
    return centres_of(BODY, pelvis, postures), time


def stoop(
    seconds: float = 4.0, deepest: float = 70.0, stands: bool = True
) -> tuple[Places, np.ndarray]:
    """Somebody who bends down and comes up again, or stays down; hips go back meanwhile."""
    time = np.arange(int(seconds * RATE)) / RATE
    share = (1 - np.cos(2 * np.pi * time / seconds)) / 2 if stands else np.ones(len(time))
    trunk = deepest * share
    back = 8.0 * share
    postures = posture(
        len(time),
        trunk_flexion=trunk,
        legs_hip_flexion=back,
        legs_knee_flexion=5.0,
        arms_shoulder_flexion=trunk / 2,
        arms_elbow_flexion=15.0,
    )
    behind = -0.85 * np.sin(np.radians(back))
    pelvis = np.column_stack([behind, 0 * time, np.full(len(time), 0.88), 0 * time])
    return centres_of(BODY, pelvis, postures), time


def leaning(places: Places, degrees: float) -> Places:
    """The same person by a skeleton whose neck and shoulders are behind (-) or before the hips."""
    hips = (places["right_hip"] + places["left_hip"]) / 2
    left = places["left_hip"] - places["right_hip"]
    left /= np.linalg.norm(left, axis=1, keepdims=True)
    arm, angle = places["neck"] - hips, np.radians(degrees)
    along = (left * arm).sum(axis=1, keepdims=True) * left
    turned = along + np.cos(angle) * (arm - along) + np.sin(angle) * np.cross(left, arm)
    legs = ("pelvis", "hip", "knee", "ankle", "toe")
    return {
        centre: path if centre.endswith(legs) else path + turned - arm
        for centre, path in places.items()
    }


def read_angles(postures: np.ndarray) -> dict[str, np.ndarray]:
    """Return the angles of trunk, elbows, knees and upper arms of postures (n, 1 or 2) [deg]."""
    trunk = np.cos(postures[:, INDEX["trunk_flexion"]]) * np.cos(
        postures[:, INDEX["trunk_side_bend"]]
    )
    sides = {
        name: np.degrees(postures[:, [INDEX[f"{side}_{name}_flexion"] for side in SIDES]])
        for name in ("elbow", "knee")
    }
    elevation = np.degrees(elevation_of(postures)[0])
    return {"trunk": np.degrees(np.arccos(trunk))[:, None], "elevation": elevation, **sides}


SHOULDERS: Final[dict[str, list[tuple[float, float, float]]]] = {
    "raised sideways": [(10, 5, 0), (5, 170, 10), (10, 5, 0)],
    "raised forward": [(0, 5, 0), (170, 10, 10), (0, 5, 0)],
    "sideways, then forward": [(0, 5, 0), (0, 85, 0), (90, 80, 20), (90, 10, 20)],
    "forward, and out over the side": [(20, 10, 0), (100, 20, 0), (95, 130, -40), (100, 10, 0)],
    "behind the back": [(0, 10, 0), (-50, 20, 60), (-55, 35, 80), (0, 10, 0)],
    "around": [(0, 10, 0), (60, 60, 0), (20, 100, -20), (-20, 60, -20), (0, 10, 0)],
    "across the chest": [(80, 0, 40), (85, -40, 60), (60, -30, 30), (80, 10, 20)],
}
"""Flexion, abduction and rotation of both shoulders that movements go through [deg]."""


def shoulders(name: str, elbow: float, count: int = 181) -> np.ndarray:
    """Postures (n, 32) [rad] of a movement of `SHOULDERS`, with elbows bent by some degrees."""
    keys = np.radians(SHOULDERS[name])
    share = np.linspace(0, len(keys) - 1, count)
    at = np.minimum(share.astype(int), len(keys) - 2)
    part = (1 - np.cos(np.pi * (share - at))) / 2
    path = keys[at] + part[:, None] * (keys[at + 1] - keys[at])
    postures = posture(count, trunk_flexion=5.0, neck_flexion=4.0, arms_elbow_flexion=elbow)
    for side in SIDES:
        for i, joint in enumerate(("flexion", "abduction", "rotation")):
            postures[:, INDEX[f"{side}_shoulder_{joint}"]] = path[:, i]
    return postures


def fitted(places: Places, **options: Any) -> Recording:
    return fit_postures(list(places), np.stack(list(places.values()), axis=1), RATE, **options)


def moved() -> tuple[np.ndarray, np.ndarray]:
    """Return pelvis (n, 4) and postures (n, 32) of a walk and a stoop."""
    pelvis, postures = [], []
    for recording in (fitted(walk(6.0)[0]), fitted(stoop(4.0)[0])):
        poses = recording.base_poses
        yaw = np.arctan2(poses[:, 1, 0], poses[:, 0, 0])
        pelvis.append(np.column_stack([poses[:, :3, 3], yaw]))
        postures.append(recording.postures)
    return np.concatenate(pelvis), np.concatenate(postures)
