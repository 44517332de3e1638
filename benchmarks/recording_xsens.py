"""Xsens' joint angles of a recording beside ours, by a mapping that is stated here.

Xsens' angles are turns between neighbouring segments: flexion, abduction and rotation about axes
that go with the joint, in this order, with x ahead, y left and z up while the arms hang and the
palms look ahead. Knee, ankle and elbow flexion are taken as they are. What our body has no joint
for is followed along theirs: the hip's turn with the pelvis turned as the file has it, for our
pelvis is upright; the arm's elevation by the spine's, the girdle's and the shoulder's turns, to the
line from the hips to the base of the neck, with the segments' lengths of the file's own N-pose;
forearm and wrist by how the palm lies to the plane of upper arm and forearm and the hand to the
palm, for their elbow bends three ways and ours one. Where the elbow is straighter than 20 degrees
that plane is not known.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from ergoqp.joints import INDEX, SIDES
from ergoqp.mocap import load_recording
from ergoqp.mocap.readers import read_motion
from ergoqp.sheets.description import elevation_of

_BENT: Final = 20.0
_SPINE: Final = (
    ("L5", "jL5S1"),
    ("L3", "jL4L3"),
    ("T12", "jL1T12"),
    ("T8", "jT9T8"),
)
"""Segments from the pelvis up, each with the joint below it."""
Angles = Mapping[str, np.ndarray]


def xsens(path: Path) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return joint -> our angles and Xsens' [deg]."""
    motion, recording = read_motion(path), load_recording(path)
    theirs, still = motion.angles, _still(path)
    pelvis = Rotation.from_quat(motion.turns["Pelvis"])
    ahead = pelvis.apply([1.0, 0.0, 0.0])
    level = Rotation.from_euler("Z", np.arctan2(ahead[:, 1], ahead[:, 0])[:, None])
    chest, trunk = _trunk(theirs, still)

    def ours(joint: str) -> np.ndarray:
        return recording.postures[:, INDEX[joint]]

    found = {
        "neck_twist": (ours("neck_twist"), theirs["jC1Head rotation"] + theirs["jT1C7 rotation"])
    }
    for side in SIDES:
        turn = {
            joint: _turn(theirs, side, joint)
            for joint in ("Hip", "C7Shoulder", "Shoulder", "Elbow", "Wrist")
        }
        thigh = (level.inv() * pelvis * turn["Hip"]).apply([0.0, 0.0, -1.0])
        arm = (chest * turn["C7Shoulder"] * turn["Shoulder"]).apply([0.0, 0.0, -1.0])
        bent, pronation, wrist = _hinged(side, turn["Elbow"], turn["Wrist"])
        clear = np.degrees(bent) > _BENT
        found |= {
            f"{side}_{name}": (ours(f"{side}_{name}_flexion"), _flexion(theirs, side, name))
            for name in ("knee", "ankle", "elbow")
        }
        found |= {
            f"{side}_hip": (ours(f"{side}_hip_flexion"), np.arctan2(thigh[:, 0], -thigh[:, 2])),
            f"{side}_elevation": (
                elevation_of(recording.postures)[0][:, SIDES.index(side)],
                np.arccos(np.clip(-(arm * trunk).sum(axis=1), -1, 1)),
            ),
            f"{side}_pronation": (ours(f"{side}_forearm_pronation")[clear], pronation[clear]),
            f"{side}_wrist_flexion": (ours(f"{side}_wrist_flexion")[clear], wrist[clear, 0]),
            f"{side}_wrist_deviation": (ours(f"{side}_wrist_deviation")[clear], wrist[clear, 1]),
        }
    return {name: (np.degrees(a), np.degrees(b)) for name, (a, b) in found.items()}


def _trunk(theirs: Angles, still: Mapping[str, np.ndarray]) -> tuple[Rotation, np.ndarray]:
    """Return the turn of the chest, and where the neck is from the hips (n, 3); in the pelvis."""
    turn = Rotation.identity(len(theirs["jL5S1 flexion"]))
    hips = (still["RightUpperLeg"] + still["LeftUpperLeg"]) / 2
    place, below = np.broadcast_to(still["Pelvis"] - hips, (len(turn), 3)), still["Pelvis"]
    for segment, joint in _SPINE:
        place = place + turn.apply(still[segment] - below)
        three = np.stack([theirs[f"{joint} {what}"] for what in _AXES], axis=1)
        turn, below = turn * Rotation.from_euler("YXZ", three), still[segment]
    trunk = place + turn.apply(still["Neck"] - below)
    return turn, trunk / np.linalg.norm(trunk, axis=1, keepdims=True)


_AXES: Final = ("flexion", "abduction", "rotation")


def _turn(theirs: Angles, side: str, joint: str) -> Rotation:
    """Return a limb's joint as a turn; the left side's signs are the right's image."""
    name = f"j{side.capitalize()}{joint}"
    three = np.stack([theirs[f"{name} {what}"] for what in _AXES], axis=1)
    signs = [-1.0, -1.0, 1.0] if side == "right" else [-1.0, 1.0, -1.0]
    return Rotation.from_euler("YXZ", three * signs)


def _flexion(theirs: Angles, side: str, joint: str) -> np.ndarray:
    return theirs[f"j{side.capitalize()}{joint.capitalize()} flexion"].astype(float)


def _hinged(
    side: str, elbow: Rotation, wrist: Rotation
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return bend and pronation (n,), flexion and deviation of the wrist (n, 2) [rad]."""
    down, out = np.array([0.0, 0.0, -1.0]), -1.0 if side == "right" else 1.0
    fore, whole = elbow.apply(down), elbow * wrist
    palm, hand = whole.apply([1.0, 0.0, 0.0]), whole.apply(down)
    inner = out * np.cross(np.broadcast_to(down, fore.shape), fore)
    size = np.linalg.norm(inner, axis=1, keepdims=True)
    inner /= np.where(size > 0, size, 1)
    back = out * np.cross(fore, inner)
    pronation = np.arctan2((palm * back).sum(axis=1), (palm * inner).sum(axis=1))
    palm = palm - (palm * fore).sum(axis=1, keepdims=True) * fore
    palm /= np.linalg.norm(palm, axis=1, keepdims=True)
    flexion = np.arctan2((hand * palm).sum(axis=1), (hand * fore).sum(axis=1))
    small = out * np.cross(fore, palm)
    deviation = np.arcsin(np.clip((hand * small).sum(axis=1), -1, 1))
    bent = np.arctan2(size[:, 0], fore @ down)
    return bent, pronation, np.stack([flexion, deviation], axis=1)


def _still(path: Path) -> dict[str, np.ndarray]:
    """Return segment -> where it begins in the file's N-pose (3,) [m]."""
    root = ElementTree.parse(path).getroot()
    tags = {name: f"{{*}}{name}" for name in ("segment", "frame", "position")}
    names = [str(each.get("label")) for each in root.iterfind(f".//{tags['segment']}")]
    frame = next(f for f in root.iterfind(f".//{tags['frame']}") if f.get("type") == "npose")
    places = np.array(frame.findtext(tags["position"], "").split(), dtype=float).reshape(-1, 3)
    return dict(zip(names, places, strict=True))
