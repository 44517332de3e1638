"""Markers at exactly 0, 0, 0, which programs write for those that they did not see."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from marker_takes import NAMES, OFF, PLACES, at, read, said, undisturbed, worst

from benchmarks.made_motions import RATE
from ergoqp.human import Body
from ergoqp.mocap import fit_postures, load_recording
from ergoqp.mocap.markers.joints import off_origin
from ergoqp.mocap.naming import centres_of
from ergoqp.mocap.recording import JointMotion

SENTENCE = "markers at exactly 0, 0, 0 are taken as not seen"


def test_they_are_not_seen_and_counted() -> None:
    places = np.ones((20_000, 4, 3), dtype=np.float32)
    places[5, 0], places[9000:9010, 1], places[7, 2], places[3, 3] = 0.0, -0.0, (0, 0, 1), np.nan
    before = places.copy()
    motion = JointMotion(("A", "B", "C", "D"), places, np.arange(20_000) / 100, notes=("So.",))
    found = off_origin(motion, [0, 1, 2, 3])
    np.testing.assert_array_equal(places, before)
    assert found.notes == ("So.", f"Of 20000 frames, {SENTENCE}: B in 10, A in 1.")
    lost = np.isnan(found.positions).all(axis=2)
    expected = np.zeros_like(lost)
    expected[5, 0], expected[9000:9010, 1], expected[3, 3] = True, True, True
    np.testing.assert_array_equal(lost, expected)
    np.testing.assert_array_equal(found.positions[~lost], before[~lost])


def test_nothing_is_copied_where_there_are_none() -> None:
    places = np.ones((3, 2, 3), dtype=np.float32)
    places[1, 1] = 0.0
    motion = JointMotion(("A", "B"), places, np.arange(3.0))
    assert off_origin(motion, [0]) is motion
    assert off_origin(motion, []) is motion
    assert off_origin(motion, [1]).notes[0].endswith("not seen: B in 1.")


def test_many_are_not_all_named() -> None:
    names = tuple(f"M{i}" for i in range(9))
    motion = JointMotion(names, np.zeros((2, 9, 3)), np.arange(2.0))
    sentence = off_origin(motion, range(9)).notes[0]
    assert sentence.endswith("M4 in 2, M5 in 2 and 3 more markers.")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "rows"),
    [("RPSI", slice(None)), ("RELB", slice(200, 300)), ("C7", slice(0, 600, 3))],
)
def test_a_take_is_as_if_they_were_lost(name: str, rows: slice) -> None:
    zeros, lost = PLACES.copy(), PLACES.copy()
    zeros[rows, at(name)], lost[rows, at(name)] = 0.0, np.nan
    found, expected = read(zeros), read(lost)
    np.testing.assert_array_equal(found.postures, expected.postures)
    np.testing.assert_array_equal(found.scored, expected.scored)
    count = len(range(*rows.indices(600)))
    assert said(found).count(f"Of 600 frames, {SENTENCE}: {name} in {count}.") == 1
    assert SENTENCE not in said(expected)
    assert worst(found) < OFF


@pytest.mark.slow
def test_of_a_file_too(tmp_path: Path) -> None:
    places = PLACES.copy()
    places[100:200, at("LWRA")] = 0.0
    columns = ",".join(f"{name} {axis}" for name in NAMES for axis in "xyz")
    rows = (",".join(f"{each:.6f}" for each in frame.ravel()) for frame in places)
    text = "\n".join([columns, *rows])
    (tmp_path / "take.csv").write_text(text + "\n", encoding="utf-8")
    recording = load_recording(tmp_path / "take.csv", rate=RATE, up="z")
    assert f"{SENTENCE}: LWRA in 100." in said(recording)
    assert worst(recording) < OFF


def test_joint_centres_may_be_at_the_origin() -> None:
    pelvis = np.zeros((50, 4))
    centres = centres_of(Body(), pelvis, np.zeros((50, 32)))
    paths = np.stack(list(centres.values()), axis=1)
    paths -= centres["pelvis"][:, None]
    recording = fit_postures(list(centres), paths, 50.0)
    assert recording.scored.all()
    assert SENTENCE not in said(recording)
    assert SENTENCE not in said(undisturbed())
