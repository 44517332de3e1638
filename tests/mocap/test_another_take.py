"""Another recording as the neutral one: of the same person, with the same axes, or refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.made_motions import BODY, RATE, Places, posture
from ergoqp.errors import RecordingError
from ergoqp.human import Body
from ergoqp.mocap import load_recording
from ergoqp.mocap.naming import centres_of

COUNT = 60
PELVIS = np.tile([0.0, 0.0, 0.9, 0.0], (COUNT, 1))


def table(path: Path, places: Places) -> Path:
    names = [f"{name}.{axis}" for name in places for axis in "xyz"]
    rows = np.column_stack([np.arange(COUNT) / RATE, *places.values()])
    np.savetxt(path, rows, "%.6f", ",", header=",".join(["time", *names]), comments="")
    return path


def standing(body: Body = BODY) -> Places:
    return centres_of(body, PELVIS, posture(COUNT, arms_elbow_flexion=10.0))


@pytest.fixture
def work(tmp_path: Path) -> Path:
    bent = posture(COUNT, trunk_flexion=30.0, legs_knee_flexion=15.0, legs_hip_flexion=10.0)
    return table(tmp_path / "work.csv", centres_of(BODY, PELVIS, bent))


def test_the_same_person(work: Path, tmp_path: Path) -> None:
    still = table(tmp_path / "still.csv", {n: 1000 * p for n, p in standing().items()})
    recording = load_recording(work, up="z", neutral=still)
    assert "in the recording that is stated to be neutral" in " ".join(recording.assumptions)


def test_somebody_else(work: Path, tmp_path: Path) -> None:
    lengths = {"thigh": 0.52, "upper_arm": 0.22, "trunk": 0.40}
    other = table(tmp_path / "other.csv", standing(Body(lengths=BODY.lengths | lengths)))
    words = (
        r"work.csv: neutral: got a skeleton with other proportions \([a-z ]* [0-9]+ % off{}\),"
        r" allowed that of the same person, a time of this recording, or vertical; if it is right,"
        r" state that \(trust neutral\)$"
    )
    with pytest.raises(RecordingError, match=words.format("")):
        load_recording(work, up="z", neutral=other)
    # Where the unit is known, both lengths are told.
    sizes = r": 0\.[0-9]{2} m here, 0\.[0-9]{2} m there"
    with pytest.raises(RecordingError, match=words.format(sizes)):
        load_recording(work, up="z", neutral=other, unit_to_m=1.0)
    trusted = load_recording(work, up="z", neutral=other, trust=["neutral"])
    assert "(trusted, although it is a skeleton with other proportions" in " ".join(
        trusted.assumptions
    )


@pytest.mark.parametrize(("tilt", "fine"), [(8.0, True), (20.0, False)])
def test_another_camera(work: Path, tmp_path: Path, tilt: float, fine: bool) -> None:
    turn = Rotation.from_rotvec([0.0, np.radians(tilt), 0.0]).as_matrix()
    other = table(tmp_path / "other.csv", {n: p @ turn.T for n, p in standing().items()})
    if fine:
        load_recording(work, up="z", neutral=other)
        return
    with pytest.raises(
        RecordingError,
        match=r"straight legs lean by 20 deg .*same camera and the same axes; .*\(trust neutral\)",
    ):
        load_recording(work, up="z", neutral=other)
    load_recording(work, up="z", neutral=other, trust=["neutral"])


def test_somebody_who_sits(work: Path, tmp_path: Path) -> None:
    sits = posture(COUNT, legs_hip_flexion=90.0, legs_knee_flexion=90.0)
    other = table(tmp_path / "other.csv", centres_of(BODY, PELVIS, sits))
    load_recording(work, up="z", neutral=other)


def test_one_segment_may_be_measured_badly(work: Path, tmp_path: Path) -> None:
    lengths = {"forearm": 1.3 * BODY.lengths["forearm"]}
    other = table(tmp_path / "other.csv", standing(Body(lengths=BODY.lengths | lengths)))
    load_recording(work, up="z", neutral=other)
