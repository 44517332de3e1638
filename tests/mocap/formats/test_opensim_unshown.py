"""What an OpenSim file does not hold, or its model holds fixed, is not taken as measured."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from ergoqp.errors import RecordingError
from ergoqp.joints import INDEX, JOINTS, LOWER, UPPER
from ergoqp.mocap.formats.opensim_models import MODELS, SHOWS
from ergoqp.mocap.load import load_recording
from ergoqp.mocap.recording import Recording

NECK = {"neck_flexion", "neck_side_bend", "neck_twist"}
PHASE = np.linspace(0, 4 * np.pi, 120)
MOVES = {
    "pelvis_tilt": -10 + 5 * np.sin(PHASE), "pelvis_list": 2 * np.sin(PHASE),
    "pelvis_rotation": 9 * np.cos(PHASE), "lumbar_extension": -8 + 6 * np.cos(PHASE),
    "lumbar_bending": 4 * np.sin(PHASE), "lumbar_rotation": 5 * np.cos(PHASE),
}  # fmt: skip
for _s, _way in (("r", 1), ("l", -1)):
    _swing = _way * np.sin(PHASE)
    MOVES |= {
        f"hip_flexion_{_s}": 30 + 20 * _swing, f"hip_adduction_{_s}": -4 + 3 * _swing,
        f"hip_rotation_{_s}": 4 * _swing, f"knee_angle_{_s}": 40 + 20 * _swing,
        f"ankle_angle_{_s}": 8 * _swing, f"subtalar_angle_{_s}": 5 * _swing,
        f"arm_flex_{_s}": 40 + 30 * _swing, f"arm_add_{_s}": -20 + 8 * _swing,
        f"arm_rot_{_s}": 9 * _swing, f"elbow_flex_{_s}": 70 + 20 * _swing,
        f"pro_sup_{_s}": 80 + 20 * _swing, f"wrist_flex_{_s}": 12 * _swing,
        f"wrist_dev_{_s}": 8 * _swing,
    }  # fmt: skip


def read(folder: Path, without: str = "^$", **held: float) -> Recording:
    """Read a person who moves every joint, without some coordinates and with some held fixed."""
    angles = {name: each for name, each in MOVES.items() if not re.search(without, name)}
    angles |= {name: np.full(len(PHASE), value) for name, value in held.items()}
    rows = np.column_stack([np.arange(len(PHASE)) / 60, *angles.values()])
    path = folder / "moves.mot"
    path.write_text(
        "moves\nversion=1\ninDegrees=yes\nendheader\n"
        + "\n".join(["\t".join(["time", *angles]), *("\t".join(map(str, row)) for row in rows)])
    )
    return load_recording(path)


def unseen(recording: Recording) -> set[str]:
    """Return the joints that are never seen, after a check of their ends."""
    found = {joint for joint in JOINTS if not recording.observed[:, INDEX[joint]].any()}
    for joint in found:
        number = INDEX[joint]
        assert (recording.low[:, number] == LOWER[number]).all()
        assert (recording.high[:, number] == UPPER[number]).all()
    return found


def test_all_columns_leave_nothing_open(tmp_path: Path) -> None:
    recording = read(tmp_path)
    # The model has no head.
    assert unseen(recording) == NECK
    others = [INDEX[joint] for joint in JOINTS if joint not in NECK]
    np.testing.assert_array_equal(recording.low[:, others], recording.high[:, others])
    assert recording.observed[:, others].all()


@pytest.mark.parametrize(
    ("without", "lost"),
    [
        ("wrist_flex", {"right_wrist_flexion", "left_wrist_flexion"}),
        ("wrist_dev_l", {"left_wrist_deviation"}),
        ("lumbar_bending", {"trunk_side_bend"}),
        ("lumbar_rotation", {"trunk_twist"}),
        ("hip_adduction_r", {"right_hip_abduction"}),
        ("hip_rotation_r", {"right_hip_rotation"}),
        ("subtalar_angle_l", {"left_ankle_inversion"}),
        ("arm_add_r", {"right_shoulder_abduction"}),
        ("arm_rot_l", {"left_shoulder_rotation"}),
        ("pelvis_(list|rotation)", set()),
    ],
)
def test_what_is_not_in_the_file_is_not_seen(without: str, lost: set[str], tmp_path: Path) -> None:
    recording = read(tmp_path, without)
    assert unseen(recording) == NECK | lost
    gone = [name for name in MOVES if re.search(without, name)]
    (said,) = (each for each in recording.assumptions if each.startswith("Not in the file"))
    assert all(name in said for name in gone)
    assert recording.scored.all()
    # All other joints are seen.
    kept = [INDEX[joint] for joint in JOINTS if joint not in NECK | lost]
    assert recording.observed[:, kept].all()


@pytest.mark.parametrize(
    ("held", "lost"),
    [
        ({"wrist_flex_r": 0.0, "wrist_dev_r": 0.0}, {"wrist_flexion", "wrist_deviation"}),
        ({"pro_sup_r": 90.0}, {"forearm_pronation"}),
        ({"elbow_flex_r": 90.0}, {"elbow_flexion"}),
        ({"knee_angle_r": 0.0}, {"knee_flexion"}),
    ],
)
def test_what_the_model_holds_is_not_seen(
    held: dict[str, float], lost: set[str], tmp_path: Path
) -> None:
    recording = read(tmp_path, **held)
    assert unseen(recording) == NECK | {f"right_{joint}" for joint in lost}
    (said,) = (each for each in recording.assumptions if each.startswith("Taken as locked"))
    assert all(name in said for name in held)


def test_who_stands_still_holds_nothing(tmp_path: Path) -> None:
    recording = read(tmp_path, **{name: float(each[0]) for name, each in MOVES.items()})
    assert unseen(recording) == NECK


def test_a_trunk_that_nothing_shows_is_not_upright(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="the upper trunk cannot be placed"):
        read(tmp_path, "lumbar")
    held = read(tmp_path, lumbar_extension=0.0)
    assert not held.scored.any()
    assert list(held.not_scored) == ["trunk not seen"]


def test_a_model_without_a_wrist_shows_none(shared: Path) -> None:
    recording = load_recording(shared / "mocap" / "mot" / "thoracoscapular_ABD01.mot")
    assert {"right_wrist_flexion", "right_wrist_deviation"} <= unseen(recording)
    # Its elbow is locked, too.
    assert "right_elbow_flexion" in unseen(recording)
    assert recording.observed[:, INDEX["right_shoulder_flexion"]].any()


def test_every_coordinate_of_a_limb_shows_something() -> None:
    joints = {each.removeprefix("right_").removeprefix("left_") for each in JOINTS}
    assert {each for found in SHOWS.values() for each in found} <= joints
    known = {step for model in MODELS for part in model.segments.values() for step, _ in part.steps}
    assert set(SHOWS) <= known
    silent = {step for step in known - set(SHOWS) if isinstance(step, str)}
    bones = ("pelvis", "ground_thorax", "thorax_rotation", "scapula", "sterno", "acromio")
    assert all(step.startswith(bones) for step in silent)
