"""Which naming a skeleton is of: every known one by its own names, with and without a prefix."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.made_motions import RATE, walk
from ergoqp.mocap import fit_postures
from ergoqp.mocap.naming import Naming, known_namings, naming_of
from ergoqp.mocap.recording import JointMotion

NAMINGS = pytest.mark.parametrize("naming", known_namings(), ids=lambda each: each.title)
_SPINE = ("Hips", "Spine", "Chest", "UpperChest", "Neck", "Head")
_ARM = ("Shoulder", "UpperArm", "LowerArm", "Hand")
_LEG = ("UpperLeg", "LowerLeg", "Foot", "Toes")
UNITY = (*_SPINE, *(f"{side}{bone}" for side in ("Left", "Right") for bone in _ARM + _LEG))
"""Bones of Unity's humanoid, without fingers and face."""


def found(names: tuple[str, ...]) -> str:
    count = len(names)
    motion = JointMotion(names, np.zeros((1, count, 3)), np.zeros(1))
    return naming_of(motion, None, "take")[0].title


@NAMINGS
@pytest.mark.parametrize("prefix", ["", "mixamorig:", "Character1_", "human/", "/human/", "/"])
def test_every_naming_is_known_by_its_names(naming: Naming, prefix: str) -> None:
    theirs = dict.fromkeys(name for names in naming.centres.values() for name in names)
    assert found(tuple(prefix + name for name in theirs)) == naming.title


@pytest.mark.parametrize("bones", [UNITY, [bone for bone in UNITY if bone not in ("Chest",)]])
def test_the_bones_of_unity_are_not_those_of_xsens(bones: tuple[str, ...]) -> None:
    assert found(tuple(bones)) == "Unity humanoid"
    assert found(tuple(bone for bone in bones if "Toes" not in bone)) == "Unity humanoid"


def test_a_walk_of_unity_is_read_as_ours() -> None:
    places = walk()[0]
    unity = next(each for each in known_namings() if each.title == "Unity humanoid")
    theirs = {name: places[centre] for centre, (name,) in unity.centres.items() if centre in places}
    ours = {centre: places[centre] for centre in unity.centres if centre in places}
    one, other = (
        fit_postures(list(each), np.stack(list(each.values()), axis=1), RATE)
        for each in (theirs, ours)
    )
    assert "The joints are named as in the Unity humanoid skeleton." in one.assumptions
    np.testing.assert_array_equal(one.postures, other.postures)
    np.testing.assert_array_equal(one.observed, other.observed)


def test_names_that_look_like_joints_that_are_not_read_are_proposed() -> None:
    places = walk()[0]
    body = next(each for each in known_namings() if each.title == "OpenPose BODY_25")
    names = {c: theirs[0] for c, theirs in body.centres.items() if c in places and c != "head"}
    names |= {"right_wrist": "Hand_R", "left_wrist": "Hand_L", "left_toe": "ToeL"}
    positions = np.stack([places[centre] for centre in names], axis=1)
    recording = fit_postures([*names.values(), "box"], padded(positions), RATE)
    assert "The joints are named as in the OpenPose BODY_25 skeleton." in recording.assumptions
    assert (
        "Not read although their names suggest it; a mapping file with these lines would (mapping):"
        ' right_wrist = "Hand_R", left_wrist = "Hand_L".'
    ) in recording.assumptions
    names |= {"right_wrist": "RWrist", "left_wrist": "LWrist"}
    recording = fit_postures([*names.values(), "Hand_R"], padded(positions), RATE)
    assert not any("suggest" in each for each in recording.assumptions)


def padded(positions: np.ndarray) -> np.ndarray:
    """Return positions with one more point."""
    return np.concatenate([positions, positions[:, :1] + 0.1], axis=1)


def test_keypoints_of_halpe_and_of_openpose() -> None:
    sides = ("Shoulder", "Elbow", "Wrist", "Hip", "Knee", "Ankle", "BigToe")
    both = ("Neck", "Nose", *(f"{side}{name}" for side in "RL" for name in sides))
    assert found(both) == found((*both, "MidHip", "REar", "LEar")) == "OpenPose BODY_25"
    assert found((*both, "Head")) == found((*both, "Head", "Hip", "REar", "LEar")) == "HALPE 26"
