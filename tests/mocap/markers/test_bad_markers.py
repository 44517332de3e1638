"""Markers that are lost, exchanged, fallen off or tremble: no wrong posture is scored, and what is
done about them is said."""

from __future__ import annotations

import numpy as np
import pytest
from marker_takes import (
    NAMES,
    OFF,
    PLACES,
    at,
    exchanged,
    fallen,
    known,
    motion,
    read,
    said,
    seen,
    undisturbed,
    worst,
)

from benchmarks.made_motions import read_angles

COUNT = len(PLACES)
WALKS, STOOPS = slice(200, 260), slice(450, 510)
"""A second of each."""
AROUND = 6
"""Frames in which a marker is on its way."""


def test_undisturbed_markers_are_read_right() -> None:
    recording = undisturbed()
    assert known(recording).all()
    found, truth = (read_angles(each) for each in (recording.postures, motion()[1]))
    for name in ("trunk", "knee"):
        assert np.abs(found[name] - truth[name]).max() < 0.01
    # An elbow by one marker is Plug-in Gait's, see `test_centres`; these are bent by 15 to 25 deg.
    assert np.abs(found["elbow"] - truth["elbow"]).max() < 12.5
    assert np.abs(found["elevation"] - truth["elevation"]).max() < 6
    assert "left out" not in said(recording)
    assert "not seen" not in said(recording)


@pytest.mark.slow
@pytest.mark.parametrize("first", [0, 20])
def test_each_marker_is_lost_for_half_a_second(first: int) -> None:
    # One after the other.
    places, names = PLACES.copy(), NAMES[first : first + 20]
    for k, name in enumerate(names):
        places[30 * k : 30 * (k + 1), at(name)] = np.nan
    recording = read(places)
    assert worst(recording) < OFF
    assert known(recording).mean() > 0.9
    rigid = [name for name in names if name[1:] in ("ASI", "PSI", "FHD", "BHD") or name in CHEST]
    limbs = [name for name in names if name not in rigid]
    for k, name in enumerate(names):
        rows = slice(30 * k, 30 * (k + 1))
        if name in rigid:
            assert known(recording)[rows].all()
            assert worst(recording, rows) < 0.5
    assert "lost markers are estimated from the others" in said(recording)
    assert len(rigid) > 3
    assert len(limbs) > 3


CHEST = ("C7", "CLAV", "T10", "STRN", "RBAK")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["LASI", "RPSI", "C7", "LBHD"])
def test_of_what_moves_as_one_it_is_said(name: str) -> None:
    # Nothing but the others of its segment tells it.
    kept = [i for i, each in enumerate(NAMES) if each[1:] in RIGID or each in CHEST]
    places = PLACES[:, kept].copy()
    names = tuple(NAMES[i] for i in kept)
    places[WALKS, names.index(name)] = np.nan
    recording = read(places, names)
    assert "lost markers are estimated from the others" in said(recording)


RIGID = ("ASI", "PSI", "FHD", "BHD", "SHO", "ELB", "WRA", "WRB", "KNE", "ANK", "THI")


@pytest.mark.slow
@pytest.mark.parametrize("rows", [WALKS, STOOPS], ids=["walk", "stoop"])
@pytest.mark.parametrize(
    "pair",
    ["LASI RASI", "LASI LPSI", "LPSI RPSI", "C7 T10", "CLAV STRN", "LFHD RBHD", "LFHD RFHD"],
)
def test_two_of_what_moves_as_one_are_exchanged(pair: str, rows: slice) -> None:
    recording = read(exchanged(*pair.split(), rows))
    assert worst(recording) < OFF
    outside = np.isin(np.arange(COUNT), np.r_[rows], invert=True)
    assert known(recording)[outside].all()
    # Two opposite corners of a head exchanged are a head upside down.
    assert "that move with them and are left out" in said(recording) or pair == "LFHD RBHD"


@pytest.mark.slow
@pytest.mark.parametrize("pair", ["LPSI RPSI", "LASI RASI"])
@pytest.mark.parametrize("long", [180, 290])
def test_two_of_a_pelvis_are_exchanged_in_the_middle_of_a_take(pair: str, long: int) -> None:
    # By a frame of these the others would be exchanged, and the feet would point backward.
    rows = slice(150, 150 + long)
    recording = read(exchanged(*pair.split(), rows))
    outside = np.isin(np.arange(COUNT), np.r_[rows], invert=True)
    assert known(recording)[outside].all()
    assert worst(recording, outside) < 0.1
    # Of these no marker of the pelvis is known. The line from hips to neck bends, so its length
    # does not show that a trunk is off by 15 degrees for a quarter of a second.
    assert worst(recording) < 15


@pytest.mark.slow
@pytest.mark.parametrize("rows", [WALKS, STOOPS], ids=["walk", "stoop"])
@pytest.mark.parametrize("name", ["WRA", "ANK", "KNE", "ELB", "SHO", "THI", "TOE"])
def test_left_and_right_are_exchanged(name: str, rows: slice) -> None:
    recording = read(exchanged(f"L{name}", f"R{name}", rows))
    assert worst(recording) < OFF
    assert known(recording).mean() > 0.89
    assert "left out" in said(recording) or not seen(recording)[rows].any()


@pytest.mark.slow
@pytest.mark.parametrize("rows", [WALKS, STOOPS], ids=["walk", "stoop"])
@pytest.mark.parametrize("limb", ["WRA WRB FIN", "ANK HEE TOE", "KNE THI TIB ANK HEE TOE"])
def test_whole_limbs_are_exchanged(limb: str, rows: slice) -> None:
    places = PLACES.copy()
    for name in limb.split():
        places[rows, at(f"L{name}")] = PLACES[rows, at(f"R{name}")]
        places[rows, at(f"R{name}")] = PLACES[rows, at(f"L{name}")]
    recording = read(places)
    assert worst(recording) < OFF
    assert not seen(recording)[rows].any()
    assert seen(recording).sum() >= COUNT - 60 - 2 * AROUND


FALLING = ("LASI", "RPSI", "C7", "STRN", "RFHD", "RSHO", "RELB", "RWRA", "RTHI", "RKNE", "RANK")


@pytest.mark.slow
@pytest.mark.parametrize("name", [*FALLING, "RTOE", "RFIN", "RUPA", "RTIB"])
@pytest.mark.parametrize("when", [180, 420])
def test_a_marker_comes_off_and_stays_on_the_floor(name: str, when: int) -> None:
    recording = read(fallen(name, when))
    assert worst(recording) < OFF
    # Without a shoulder, the trunk may be twisted, and the other arm points elsewhere.
    assert known(recording)[: when - AROUND].all() or name == "RSHO"
    assert known(recording).mean() > 0.9
    # A toe is near the floor, and what does not show does no harm.
    if name not in ("RUPA", "RTOE"):
        assert "left out" in said(recording)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["LASI", "C7", "RSHO", "RELB", "RWRA", "RTHI", "RKNE", "RANK"])
def test_a_marker_comes_off_soon(name: str) -> None:
    # Most of the time it is not where it belongs.
    recording = read(fallen(name, 190, frames=300))
    assert worst(recording) < OFF
    assert known(recording).mean() > 0.8


@pytest.mark.slow
def test_residuals_show_which_marker_it_was() -> None:
    residuals = {name: each.residual for name, each in undisturbed().markers.items()}
    assert set(residuals) == set(NAMES)
    assert max(residuals.values()) < 0.004
    found = read(fallen("RPSI", 300)).markers
    assert found["RPSI"].residual > 0.5
    assert max(each.residual for name, each in found.items() if name != "RPSI") < 0.01


@pytest.mark.slow
@pytest.mark.parametrize(
    ("size", "most", "least"), [(0.001, 4.0, 1.0), (0.003, 8.0, 0.99), (0.01, OFF, 0.85)]
)
def test_noise(size: float, most: float, least: float) -> None:
    noise = size * np.random.default_rng(3).standard_normal(PLACES.shape)
    recording = read(PLACES + noise)
    assert worst(recording) < most
    assert known(recording).mean() >= least
    residuals = [each.residual for each in recording.markers.values()]
    assert np.median(residuals) == pytest.approx(np.sqrt(3) * size, rel=0.5)


@pytest.mark.slow
@pytest.mark.parametrize(("share", "least"), [(0.1, 0.95), (0.6, 0.0)])
def test_points_are_missing(share: float, least: float) -> None:
    places = PLACES.copy()
    places[np.random.default_rng(4).random(places.shape[:2]) < share] = np.nan
    recording = read(places)
    assert worst(recording) < OFF
    assert known(recording).mean() >= least


@pytest.mark.parametrize(("share", "least"), [(0.1, 0.97), (0.6, 0.35)])
def test_frames_are_missing(share: float, least: float) -> None:
    places = PLACES.copy()
    places[np.random.default_rng(5).random(COUNT) < share] = np.nan
    recording = read(places)
    assert worst(recording) < OFF
    assert known(recording).mean() >= least


def test_frames_are_written_twice() -> None:
    recording = read(np.repeat(PLACES[::2], 2, axis=0))
    right = read_angles(undisturbed().postures)
    found = read_angles(recording.postures)
    assert known(recording).all()
    for name, angles in right.items():
        assert np.abs(found[name] - np.repeat(angles[::2], 2, axis=0)).max() < 3


def test_nothing_at_all() -> None:
    recording_of_nothing = np.full_like(PLACES, np.nan)
    with pytest.raises(Exception, match="positions: ") as told:
        read(recording_of_nothing)
    assert "\n" not in str(told.value)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["RWRA", "LWRB"])
def test_a_wrist_is_not_where_one_of_its_markers_is(name: str) -> None:
    # Neither the hand nor the forearm has another marker that could tell the lost one.
    kept = [i for i, each in enumerate(NAMES) if each[1:] not in ("FIN", "FRM")]
    places, names = PLACES[:, kept].copy(), tuple(NAMES[i] for i in kept)
    lost = slice(200, 400)
    places[lost, names.index(name)] = np.nan
    recording = read(places, names)
    assert worst(recording) < OFF
    assert not seen(recording)[220:380].any()
    places[:, names.index(name)] = np.nan
    # Where it is never seen, the other is all that there is, and the elbow off by as much.
    assert known(read(places, names)).all()


def test_an_elbow_with_one_marker_is_said() -> None:
    assert "An elbow with one marker is taken to bend about" in said(undisturbed())
