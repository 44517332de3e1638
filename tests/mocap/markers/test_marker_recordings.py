"""Whole recordings of markers: whatever their names, units, axes and files are like."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from marker_takes import NAMES, OFF, PLACES, at, read, said, undisturbed, without, worst

from benchmarks.made_markers import write_c3d, write_table
from benchmarks.made_motions import RATE
from ergoqp.errors import RecordingError, UnknownNamesError
from ergoqp.joints import INDEX, SIDES
from ergoqp.mocap import load_recording
from ergoqp.mocap.fitting.axes import UPS, axes_of
from ergoqp.mocap.load import ReadOptions, recording_of
from ergoqp.mocap.recording import JointMotion

SHORT = slice(300, 480)
"""The end of the walk and most of the stoop."""


@pytest.mark.slow
def test_names_in_any_order() -> None:
    order = np.random.default_rng(1).permutation(len(NAMES))
    recording = read(PLACES[:, order], tuple(NAMES[i] for i in order))
    assert worst(recording) < 0.1
    assert recording.scored.all()
    assert "named as in the Plug-in Gait set" in said(recording)


def test_names_in_small_letters_with_a_prefix() -> None:
    names = tuple(f"Anna:{name.lower()}" for name in NAMES)
    recording = read(PLACES, names)
    assert worst(recording) < 0.1


@pytest.mark.parametrize("unit", [0.001, 0.01, 0.0254])
def test_a_unit_that_is_not_stated(unit: float) -> None:
    recording = read(PLACES / unit, unit_to_m=None)
    assert worst(recording) < 0.1
    assert recording.person.stature == pytest.approx(1.72, abs=0.005)
    assert f"taken as {unit:g} m, from the width of the person" in said(recording)


@pytest.mark.parametrize("up", UPS)
def test_a_vertical_axis_that_is_not_stated(up: str) -> None:
    recording = read(PLACES @ axes_of(up), up=None)
    assert worst(recording) < 0.1
    assert f"taken as {up}" in said(recording)


@pytest.mark.slow
def test_a_c3d_file(tmp_path: Path) -> None:
    path = tmp_path / "take.c3d"
    places = PLACES.copy()
    places[200:230, at("LASI")] = np.nan
    names = (*NAMES, "*101", "U102")
    stray = np.random.default_rng(2).uniform(-1, 1, (len(places), 2, 3))
    write_c3d(path, names, np.concatenate([places, stray], axis=1), RATE)
    recording = load_recording(path, up="z")
    assert worst(recording) < 0.1
    assert recording.scored.all()
    assert "2 of 41 points have no label and are left out" in said(recording)
    assert set(recording.markers) == set(NAMES)
    assert recording.markers["LASI"].residual < 0.001


def test_points_without_a_label_of_arrays_are_left_out() -> None:
    stray = np.random.default_rng(2).uniform(-1, 1, (len(PLACES), 3, 3))
    recording = read(np.concatenate([stray, PLACES], axis=1), ("*101", "U102", "C_103", *NAMES))
    assert worst(recording) < 0.1
    assert set(recording.markers) == set(NAMES)


@pytest.mark.parametrize(
    ("gone", "most"),
    [
        (("LPSI",), 0.1),
        (("RFHD", "LFHD", "RBHD", "LBHD"), 0.1),
        (("C7", "CLAV", "T10", "STRN", "RBAK"), 2.0),
        (("RTHI", "LTHI", "RTIB", "LTIB"), 1.0),
        (("RWRB", "LWRB"), 6.0),
        (("RUPA", "LUPA", "RFRM", "LFRM", "RFIN", "LFIN", "RHEE", "LHEE"), 0.5),
    ],
    ids=lambda gone: "-".join(gone) if isinstance(gone, tuple) else "",
)
def test_sets_that_are_not_complete(gone: tuple[str, ...], most: float) -> None:
    names, kept = without(*gone)
    recording = read(PLACES[:, kept], names)
    assert worst(recording) < most
    assert recording.scored.all()
    if "RFHD" in gone:
        assert "Never seen, and anywhere in their ranges: neck flexion" in said(recording)


def test_the_sacrum_instead_of_both_psis() -> None:
    names, kept = without("LPSI", "RPSI")
    sacrum = PLACES[:, at("LPSI", "RPSI")].mean(axis=1, keepdims=True)
    recording = read(np.concatenate([PLACES[:, kept], sacrum], axis=1), (*names, "SACR"))
    assert worst(recording) < 0.1
    assert recording.scored.all()


def test_without_shoulders_no_arm_is_seen() -> None:
    names, kept = without("RSHO", "LSHO")
    recording = read(PLACES[:, kept], names)
    assert recording.scored.all()
    arms = [INDEX[f"{side}_shoulder_flexion"] for side in SIDES]
    assert not recording.observed[:, arms].any()


@pytest.mark.parametrize("gone", [("LASI",), ("LPSI", "RPSI"), ("LASI", "RASI", "LPSI")])
def test_a_pelvis_that_cannot_be_placed(gone: tuple[str, ...]) -> None:
    needed = "positions: the pelvis cannot be placed; the recording needs both ASIS, and a PSIS"
    names, kept = without(*gone)
    with pytest.raises(RecordingError, match=needed):
        read(PLACES[:, kept], names)
    # Likewise those that are named and never seen.
    places = PLACES.copy()
    places[:, at(*gone)] = np.nan
    with pytest.raises(RecordingError, match=needed):
        read(places)


def test_markers_of_the_pelvis_under_unknown_names() -> None:
    theirs = {"LASI": "Bassin1", "RASI": "Bassin2"}
    with pytest.raises(UnknownNamesError) as refused:
        read(PLACES, tuple(theirs.get(name, name) for name in NAMES))
    assert "not read as such: Bassin2, Bassin1; a mapping" in str(refused.value)
    assert 'such as right_asis = "theirs" (mapping)' in str(refused.value)
    assert refused.value.names == ("Bassin2", "Bassin1")


def test_legs_alone() -> None:
    legs = ("ASI", "PSI", "THI", "KNE", "TIB", "ANK", "HEE", "TOE")
    names = tuple(name for name in NAMES if name[1:] in legs)
    with pytest.raises(RecordingError, match="the upper trunk cannot be placed"):
        read(PLACES[:, at(*names)], names)


def taken(**given: object) -> JointMotion:
    """The take as a reader hands it on, in mm."""
    motion = JointMotion(NAMES, 1000 * PLACES, np.arange(len(PLACES)) / RATE, markers=True)
    return replace(motion, **{"unit": 0.001, "up": "z", **given})  # type: ignore[arg-type]


@pytest.mark.slow
def test_widths_that_vicon_measured_are_used() -> None:
    recording = recording_of(taken(), "take.c3d", ReadOptions())
    assert "57 mm at the knee, 43 at the ankle, 44 at the elbow" in said(recording)
    assert "(adult averages)" in said(recording)
    assert worst(recording) < 0.1
    sides = {f"{side}{name}": size for side in "lr" for name, size in (("kneewidth", 0.13),)}
    wide = recording_of(taken(measures=sides), "take.c3d", ReadOptions())
    assert "72 mm at the knee" in said(wide)
    assert "(as measured in the file)" in said(wide)
    assert 0.1 < worst(wide) < OFF
    absurd = {name: 13.0 for name in sides}
    assert "(adult averages)" in said(
        recording_of(taken(measures=absurd), "take.c3d", ReadOptions())
    )


def test_a_neutral_pose_of_another_unit(tmp_path: Path) -> None:
    # A take in mm and a table in m of somebody who stands: they are brought together.
    write_c3d(tmp_path / "take.c3d", NAMES, PLACES[SHORT], RATE)
    write_table(tmp_path / "stands.csv", NAMES, PLACES[360:380], RATE)
    plain = load_recording(tmp_path / "take.c3d", up="z", neutral="vertical")
    recording = load_recording(tmp_path / "take.c3d", up="z", neutral=tmp_path / "stands.csv")
    assert "in the recording that is stated to be neutral" in said(recording)
    np.testing.assert_allclose(
        recording.postures[:, :2], plain.postures[:, :2], atol=np.radians(1.5)
    )


@pytest.mark.slow
def test_a_long_take_is_read_in_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    places = PLACES.copy()
    places[95:105, at("C7", "RPSI")] = np.nan
    # On their way before the block in which they are elsewhere, and after it.
    places[200:230, at("RELB", "LELB")] = places[200:230, at("LELB", "RELB")]
    places[470:500, at("RKNE", "LKNE")] = places[470:500, at("LKNE", "RKNE")]
    whole = read(places)
    monkeypatch.setattr("ergoqp.mocap.markers.joints._BLOCK", 100)
    parts = read(places)
    assert all(f"{side} outer elbow in 42" in said(whole) for side in ("left", "right"))
    np.testing.assert_allclose(parts.postures, whole.postures, atol=1e-5)
    assert parts.assumptions == whole.assumptions


def test_a_single_frame() -> None:
    recording = read(PLACES[:1], neutral="vertical")
    assert recording.scored.all()
    right = undisturbed().postures[:1, :2]
    np.testing.assert_allclose(recording.postures[:, :2], right, atol=np.radians(3))
