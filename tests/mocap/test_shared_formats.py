"""What every recording of others should come to: read with what is said, or refused with why."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ergoqp.errors import RecordingError, UnknownNamesError
from ergoqp.mocap import load_recording
from ergoqp.mocap.naming import centres_of

ARMS = [f"{side}_{joint}" for side in ("left", "right") for joint in ("shoulder", "elbow", "wrist")]


@dataclass(frozen=True)
class Outcome:
    """How a file is to be read, and what is to come of it.

    Attributes:
        file: below the folder of recordings.
        frames: that are read.
        scored: that show a trunk, or are near one that does.
        says: patterns, one for each oddity, of which each is in an assumption.
        thing: whether it has the held object's poses.
        keys: of `load_recording`.
    """

    file: str
    frames: int
    scored: int
    says: tuple[str, ...] = ()
    thing: bool = False
    keys: dict[str, Any] = field(default_factory=dict)


READ = (
    Outcome("bvh/cmu_131_01_walk_max.bvh", 994, 994),
    Outcome("bvh/cmu_62_04_screwing_keyframes.bvh", 12, 12, ("not uniform in time",)),
    Outcome("bvh/toolbox_freebvh.bvh", 69, 69, ("unit of length is taken as 0.01",)),
    Outcome("bvh/xsens_motionbox.bvh", 1150, 1149, ("straight in the T-pose", "calibration pose")),
    Outcome("c3d/millard_stoop1_t169_f620f800.c3d", 181, 181, ("Plug-in Gait",)),
    Outcome("c3d/millard_neu_t169_f250f350.c3d", 101, 101, ("Plug-in Gait",)),
    Outcome(
        "c3d/pycgm_Movement_trial.c3d",
        323,
        323,
        ("42 of 239 points have no label", "56 points are computed", "as measured in the file"),
    ),
    Outcome("c3d/pycgm_Sample_Static.c3d", 275, 275, ("4 of 141 points have no label",)),
    Outcome(
        "c3d/pyomeca_box_handling.c3d",
        580,
        580,
        (
            "The person is 'Daphnee'",
            "boite is an object of 8 markers",
            "The object that is held is boite",
            "Never seen, and anywhere in their ranges: .*left shoulder flexion",
            "Never seen, and anywhere in their ranges: trunk twist",
        ),
        thing=True,
    ),
    # Of the arms there are only the shoulders: they may be anywhere.
    Outcome(
        "c3d/c3dorg_Capture0002.c3d",
        661,
        661,
        ("simple gait", "Never seen, and anywhere in their ranges: .*right shoulder flexion"),
    ),
    Outcome(
        "kinect/azure_kinect_body_tracking_part1.bag",
        560,
        556,
        (
            "18 of 560 messages show nobody",
            "axes of the frame 'kinect2_depth_camera_link'",
            "camera is taken to be tilted by 21 deg against the axis -y",
            "not uniform in time",
        ),
    ),
    Outcome(
        "kinect/azure_kinect_body_tracking_part1.csv",
        542,
        542,
        ("Times are taken as microseconds", "tilted by 21 deg against the axis -y", "Azure Kinect"),
    ),
    Outcome(
        "motive/derived_motive_skeleton_giver.csv",
        801,
        801,
        (
            "unit of length is 1 m, as the file says",
            "vertical axis is taken as z",
            "76 of 801 frames repeat the frame before",
            "The object that is held is Baton",
        ),
        thing=True,
    ),
    Outcome("mot/opencap_squats.mot", 801, 801, ("OpenCap", "Not in the file: wrist_flex_r")),
    Outcome(
        "mot/pyomeca_box_ik_comma_badcount.mot",
        88,
        88,
        ("states 250 rows and has 88", "The object that is held is box", "to the scapula"),
        thing=True,
    ),
    Outcome("mot/thoracoscapular_ABD01.mot", 1091, 1091, ("thoracoscapular", "to the scapula")),
    Outcome("mot/thoracoscapular_FLX21.mot", 709, 709, ("thoracoscapular", "to the scapula")),
    Outcome(
        "mvnx/xsens_kicking_part1.mvnx",
        180,
        180,
        ("2 calibration poses", "unit of length is 1 m, as the file says"),
    ),
    Outcome(
        "trc/pyomeca_comma_badcount.trc",
        93,
        93,
        (
            "states 652 frames and has 93",
            "Never seen, and anywhere in their ranges: .*left shoulder flexion",
        ),
    ),
)

REFUSED = (
    # 39 of its 75 labels have no data, those of all landmarks among them.
    ("c3d/c3dorg_pc_real.c3d", {}, r"got the joints or markers RFT1, .*names are unknown"),
    (
        "motive/motive_v121_rigidbodies_markers.csv",
        {},
        r"got the joints or markers Rigid Body 1.*names are unknown",
    ),
    ("motive/motive_v123_empty_no_bodies.csv", {}, "nothing is tracked, allowed bones"),
    ("arms/assembly_Task1_Human1_trial1.txt", {}, r"got 18 numbers and no names.*\(columns\)"),
    (
        "arms/assembly_Task4_Human1_trial1.txt",
        {"columns": ARMS},
        r"got no column of times.*\(rate\)",
    ),
    (
        "arms/assembly_Task1_Human1_trial1.txt",
        {"columns": ARMS, "rate": 15},
        "the pelvis cannot be placed; the recording needs at least one of pelvis",
    ),
    # Its tables, one for each bone, are read by the own reader of the examples.
    ("kth_handover_giver", {}, "is a folder; give the recording file itself"),
)


@pytest.mark.parametrize("wanted", READ, ids=lambda each: each.file)
def test_read(shared: Path, wanted: Outcome):
    recording = load_recording(shared / "mocap" / wanted.file, **wanted.keys)
    said = "\n".join(recording.assumptions)
    for pattern in wanted.says:
        assert re.search(pattern, said), f"{pattern} is not in:\n{said}"
    assert len(recording.time) == wanted.frames
    assert int(recording.scored.sum()) == wanted.scored, recording.not_scored.keys()
    assert (recording.object_poses is not None) == wanted.thing
    assert np.isfinite(recording.postures).all()


@pytest.mark.parametrize(
    ("file", "keys", "why"), REFUSED, ids=[f"{each[0]} {len(each[1])}" for each in REFUSED]
)
def test_refused(shared: Path, file: str, keys: dict[str, Any], why: str):
    with pytest.raises(RecordingError, match=why) as told:
        load_recording(shared / "mocap" / file, **keys)
    assert Path(file).name in str(told.value)
    assert "\n" not in str(told.value)


def test_every_file_is_looked_at(shared: Path):
    folder = shared / "mocap"
    known = {each.file for each in READ} | {file for file, _, _ in REFUSED}
    found = {str(path.relative_to(folder)) for path in folder.glob("*/*")}
    found = {"kth_handover_giver" if "kth_handover_giver" in name else name for name in found}
    assert found == known


def test_a_thing_comes_with_the_hand_that_carries_it(shared: Path):
    recording = load_recording(shared / "mocap" / "c3d" / "pyomeca_box_handling.c3d")
    poses = recording.object_poses
    assert poses is not None
    np.testing.assert_allclose(np.linalg.det(poses[:, :3, :3]), 1.0, atol=1e-9)
    # The box is carried up by a third of a metre, is tilted meanwhile and does not turn over.
    assert np.ptp(poses[:, 2, 3]) > 0.3
    assert (poses[:, 2, 2] > 0.8).all()
    # While it is carried it is where the hand is, and not before.
    pelvis = np.column_stack([recording.base_poses[:, :3, 3], _heading(recording.base_poses)])
    hand = centres_of(recording.person, pelvis, recording.postures)["right_wrist"]
    away = np.linalg.norm(hand - poses[:, :3, 3], axis=1)
    carried = np.linalg.norm(np.gradient(poses[:, :3, 3], 0.01, axis=0), axis=1) > 0.3
    assert away[carried].max() < 0.5 < away[:30].min()


def _heading(poses: np.ndarray) -> np.ndarray:
    return np.arctan2(poses[:, 1, 0], poses[:, 0, 0])


def test_the_bag_and_its_table_are_one_movement(shared: Path):
    kinect = shared / "mocap" / "kinect"
    bag, table = (
        load_recording(kinect / f"azure_kinect_body_tracking_part1.{ending}")
        for ending in ("bag", "csv")
    )
    seen = np.flatnonzero(np.isfinite(bag.fit_error))
    away = np.abs(bag.postures[seen][bag.scored[seen]] - table.postures[table.scored])
    # The table is rounded, and angles that hardly show answer to that.
    assert np.quantile(away, 0.999) < np.radians(0.5)
    assert away.max() < np.radians(5.0)


def test_names_that_nobody_knows_are_kept(shared: Path):
    with pytest.raises(UnknownNamesError) as told:
        load_recording(shared / "mocap" / "c3d" / "c3dorg_pc_real.c3d")
    assert "RFT1" in told.value.names
