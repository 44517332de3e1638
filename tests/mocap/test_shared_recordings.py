"""Recordings made by others: how well the body fits them, and the angles of a person who drives a
screw."""

import warnings
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from ergoqp.human import Kinematics
from ergoqp.joints import INDEX, LOWER, UPPER
from ergoqp.mocap import Recording, load_recording
from ergoqp.mocap.fitting.axes import axes_of
from ergoqp.mocap.formats.bvh import read_bvh

FILES = {
    # file: naming, unit [m], largest median fit error [m], joints that its points do not tell
    "cmu_131_01_walk_max": (
        "CMU for 3ds Max",
        0.056444,
        0.017,
        {"neck_twist", "forearm_pronation"},
    ),
    "cmu_62_04_screwing_keyframes": ("CMU", 0.056444, 0.026, {"neck_twist", "forearm_pronation"}),
    "toolbox_freebvh": ("mixamo", 0.01, 0.031, set()),
    "xsens_motionbox": (
        "Xsens",
        0.01,
        0.010,
        {"neck_twist", "forearm_pronation", "wrist_flexion", "wrist_deviation"},
    ),
}


@pytest.mark.parametrize("name", FILES)
def test_the_body_fits(name: str, shared: Path):
    naming, unit, error, untold = FILES[name]
    recording = load_recording(shared / "mocap" / "bvh" / f"{name}.bvh")
    assert np.median(recording.fit_error) < error
    assert recording.fit_error.max() < 0.055
    assert (recording.postures >= LOWER).all()
    assert (recording.postures <= UPPER).all()
    said = " ".join(recording.assumptions)
    assert f"the {naming} skeleton" in said
    assert f"taken as {unit:g} m" in said
    assert "vertical axis is taken as y" in said
    missing = {joint for joint, i in INDEX.items() if not recording.observed[:, i].any()}
    assert {joint.removeprefix("right_").removeprefix("left_") for joint in missing} == untold
    assert np.allclose(recording.base_poses[:, 2, 2], 1)
    assert np.abs(np.degrees(np.arctan2(recording.base_poses[:, 2, 0], 1))).max() == 0


@pytest.mark.parametrize("name", FILES)
def test_the_joint_centres_are_those_of_bvhio(name: str, shared: Path):
    with warnings.catch_warnings():
        # Its import of PyGLM announces a renaming.
        warnings.simplefilter("ignore")
        bvhio = pytest.importorskip("bvhio")
    path = shared / "mocap" / "bvh" / f"{name}.bvh"
    motion = read_bvh(path)
    root = bvhio.readAsBvh(str(path)).Root
    for frame in (0, len(motion.time) // 2, len(motion.time) - 1):
        pending = [(root, np.zeros(3), np.eye(3))]
        while pending:
            joint, position, rotation = pending.pop()
            key = joint.Keyframes[frame]
            position = position + rotation @ np.array(key.Position.to_tuple())
            # Columns of a rotation are the turned axes.
            rotation = (
                rotation @ np.array([(key.Rotation * axis).to_tuple() for axis in glm_axes()]).T
            )
            assert motion.of(joint.Name)[frame] == pytest.approx(position, abs=1e-3)
            pending.extend((child, position, rotation) for child in joint.Children)


def glm_axes():
    from pyglm import glm

    return glm.vec3(1, 0, 0), glm.vec3(0, 1, 0), glm.vec3(0, 0, 1)


def test_the_calibration_frame_is_told_and_the_box_is_reached_in_a_stoop(shared: Path):
    recording = load_recording(shared / "mocap" / "bvh" / "xsens_motionbox.bvh")
    assert any(
        "Between the frames 1 and 2 a joint moves" in sentence for sentence in recording.assumptions
    )
    arms = np.degrees(
        recording.postures[0, [INDEX["right_shoulder_abduction"], INDEX["left_shoulder_abduction"]]]
    )
    assert arms == pytest.approx([90, 90], abs=5)
    assert np.degrees(recording.postures[:, INDEX["trunk_flexion"]].max()) > 60


def angle(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.arccos(a @ b / np.linalg.norm(a) / np.linalg.norm(b))))


def arm_angles(place: dict[str, np.ndarray]) -> np.ndarray:
    """Trunk to the vertical, right upper arm to the trunk, right elbow [deg]."""
    trunk = place["neck"] - (place["right_hip"] + place["left_hip"]) / 2
    upper_arm = place["right_elbow"] - place["right_shoulder"]
    forearm = place["right_wrist"] - place["right_elbow"]
    return np.array(
        [
            angle(trunk, np.array([0.0, 0.0, 1.0])),
            angle(-upper_arm, trunk),
            angle(upper_arm, forearm),
        ]
    )


def fitted_places(recording: Recording, frame: int, names: list[str]) -> dict[str, np.ndarray]:
    kinematics = Kinematics(recording.person)
    pose, posture = recording.base_poses[frame], ca.DM(recording.postures[frame])
    return {
        name: pose[:3, :3] @ np.array(kinematics.at(name, posture)[0]).ravel() + pose[:3, 3]
        for name in names
    }


def test_the_screwing_arm_has_the_angles_of_the_raw_joints(shared: Path):
    path = shared / "mocap" / "bvh" / "cmu_62_04_screwing_keyframes.bvh"
    motion, recording = read_bvh(path), load_recording(path)
    theirs = {
        "neck": "Neck1",
        "right_hip": "RightUpLeg",
        "left_hip": "LeftUpLeg",
        "right_shoulder": "RightArm",
        "right_elbow": "RightForeArm",
        "right_wrist": "RightHand",
    }
    for frame in range(3, 12):
        raw = arm_angles(
            {
                ours: 0.056444 * axes_of("y") @ motion.of(name)[frame]
                for ours, name in theirs.items()
            }
        )
        assert (raw > [25, 49, 73]).all()
        assert (raw < [31, 59, 82]).all()
        fitted = arm_angles(fitted_places(recording, frame, list(theirs)))
        assert np.abs(fitted - raw).max() < 0.6
        elbow = recording.postures[frame, INDEX["right_elbow_flexion"]]
        assert abs(np.degrees(elbow) - raw[2]) < 1e-3
