"""Shoulders below acromion markers that slide when the arm is raised."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.made_arms import ARM, Slide, Take, busy, one_arm, raised, shrugging, take_of
from benchmarks.made_motions import RATE
from benchmarks.recording_arms import errors
from ergoqp.joints import INDEX, SIDES
from ergoqp.mocap import fit_postures
from ergoqp.mocap.joints import Found, ReadOptions, joints_of
from ergoqp.mocap.markers.shoulders import (
    Sliding,
    axes_of,
    elevation_of,
    sliding_of,
    sliding_said,
    turned,
)
from ergoqp.mocap.recording import JointMotion

NONE = Slide()
MUCH = Slide(skin=(0.045, 0.035, 0.0))
MOST = Slide(skin=(0.090, 0.060, 0.0))
WITH_THE_JOINT = Slide(skin=(0.045, 0.035, 0.0), rise=(0.03, 0.01))
SHRUGGING = replace(MUCH, girdle=shrugging)
RADIUS = 0.31


@cache
def take(slide: Slide = MUCH, name: str = "around", hang: bool = True) -> Take:
    return take_of(raised(name, 90.0, hang=hang), slide)


def found_in(made: Take, places: np.ndarray | None = None) -> Found:
    places = made.places if places is None else places
    time = np.arange(len(places)) / RATE
    motion = JointMotion(made.names, places, time, unit=1.0, markers=True)
    return joints_of(motion, "made", ReadOptions(unit=1.0, up="z"))


def unmoved(monkeypatch: pytest.MonkeyPatch, *args: Any) -> Found:
    """What is found where no marker is taken to slide."""
    with monkeypatch.context() as patch:
        patch.setattr("ergoqp.mocap.markers.joints._sliding", lambda *_: {})
        return found_in(*args)


def same(one: Found, other: Found) -> None:
    assert set(one.paths) == set(other.paths)
    for name, path in one.paths.items():
        np.testing.assert_array_equal(path, other.paths[name])


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize("name", ["raised sideways", "forward, and out over the side", "around"])
@pytest.mark.parametrize("slide", [MUCH, WITH_THE_JOINT], ids=["skin", "joint too"])
@pytest.mark.parametrize("hang", [True, False])
def test_a_raised_arm_is_read(name: str, slide: Slide, hang: bool) -> None:
    every = errors(take(slide, name, hang))
    high = every["elevation"] > 75
    assert rms(every["joint"][high]) < 2.5
    assert rms(every["joint.below"][high]) > 5
    assert rms(every["true"][high]) < 3.5
    assert np.mean(every["joint"] <= every["half"] + 1) > 0.95
    assert every["half"][high].mean() < 5.5
    assert every["half"][high].min() > 1


def test_frames_of_raised_arms_are_seen() -> None:
    made = take_of(raised("raised sideways", 90.0, hang=True, still=720), MUCH)
    recording = fit_postures(made.names, made.places, RATE, neutral="vertical")
    high = made.elevation.min(axis=1) > 90
    assert recording.seen[high].mean() > 0.98
    with patch("ergoqp.mocap.markers.joints._sliding", lambda *_: {}):
        before = fit_postures(made.names, made.places, RATE, neutral="vertical")
    assert before.seen[high].mean() < 0.6
    said = [each for each in recording.assumptions if "acromion's marker slides" in each]
    assert len(said) == 1
    assert "right " in said[0]
    assert "left " in said[0]
    assert "sphere" in said[0]


@pytest.mark.parametrize("hang", [True, False])
@pytest.mark.parametrize("name", ["raised forward", "raised sideways"])
def test_a_marker_that_slides_is_not_left_out(name: str, hang: bool) -> None:
    found = found_in(take(MOST, name, hang))
    assert not any("left out" in each for each in found.said)
    for side in SIDES:
        assert np.isfinite(found.paths[f"{side}_shoulder"]).all()


def test_in_a_trunk_that_bends_and_walks() -> None:
    every = errors(take_of(busy(raised("raised sideways", 90.0, hang=True)), MUCH))
    assert rms(every["joint"]) < 2
    assert np.mean(every["joint"] <= every["half"] + 1) > 0.95


def test_one_marker_of_the_neck_is_enough() -> None:
    made = take()
    places = made.places.copy()
    places[:, made.names.index("CLAV")] = np.nan
    found, whole = found_in(made, places), found_in(made)
    off = found.paths["right_shoulder"] - whole.paths["right_shoulder"]
    assert np.linalg.norm(off, axis=1).max() < 0.01


def test_low_arms_are_read_as_before(monkeypatch: pytest.MonkeyPatch) -> None:
    postures = raised("raised sideways", 90.0, hang=True)
    for side in SIDES:
        postures[:, INDEX[f"{side}_shoulder_abduction"]] *= 38 / 170
    made = take_of(postures, Slide(skin=(0.06, 0.05, 0.0)))
    assert 35 < made.elevation.max() < 42
    found = found_in(made)
    same(found, unmoved(monkeypatch, made))
    assert not any(half.any() for half in found.doubts.values())


@pytest.mark.parametrize("name", ["raised sideways", "behind the back", "around"])
def test_where_nothing_slides_there_is_no_doubt(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    made = take(NONE, name)
    found = found_in(made)
    same(found, unmoved(monkeypatch, made))
    assert set(found.doubts) == {"right_upper_arm", "left_upper_arm"}
    for half in found.doubts.values():
        assert half.dtype == np.float32
        assert half.shape == (len(made.places),)
        assert not half.any()
    assert not any("slides" in each for each in found.said)


def test_only_the_raised_arm_is_changed(monkeypatch: pytest.MonkeyPatch) -> None:
    made = take_of(one_arm(raised("raised sideways", 90.0, hang=True)), MUCH)
    found, before = found_in(made), unmoved(monkeypatch, made)
    for name in ("left_shoulder", "left_elbow", "neck", "right_hip"):
        np.testing.assert_array_equal(found.paths[name], before.paths[name])
    assert np.abs(found.paths["right_shoulder"] - before.paths["right_shoulder"]).max() > 0.03
    assert not found.doubts["left_upper_arm"].any()
    assert found.doubts["right_upper_arm"].any()


def test_without_elbows_nothing_is_changed(monkeypatch: pytest.MonkeyPatch) -> None:
    made = take()
    places = made.places.copy()
    places[:, [made.names.index(name) for name in ("RELB", "LELB")]] = np.nan
    found = found_in(made, places)
    same(found, unmoved(monkeypatch, made, places))
    assert not any(half.any() for half in found.doubts.values())


def test_an_arm_that_is_held_still_shows_no_sphere(monkeypatch: pytest.MonkeyPatch) -> None:
    postures = np.repeat(raised("raised sideways", 90.0, hang=True)[120:121], 100, axis=0)
    made = take_of(postures, MUCH)
    assert made.elevation.min() > 60
    found = found_in(made)
    same(found, unmoved(monkeypatch, made))
    # Where its marker has slid from is not seen, either.
    assert np.degrees(min(half.min() for half in found.doubts.values())) > 4


def test_gaps(monkeypatch: pytest.MonkeyPatch) -> None:
    made, whole = take(), found_in(take())
    places = made.places.copy()
    elbow, neck = slice(150, 160), slice(200, 210)
    places[elbow, made.names.index("RELB")] = np.nan
    trunk = [made.names.index(name) for name in ("C7", "CLAV", "STRN", "T10", "RBAK")]
    places[neck, trunk] = np.nan
    found, before = found_in(made, places), unmoved(monkeypatch, made, places)
    np.testing.assert_array_equal(
        found.paths["right_shoulder"][elbow], before.paths["right_shoulder"][elbow]
    )
    half = found.doubts["right_upper_arm"]
    assert not half[elbow].any()
    assert np.isfinite(half).all()
    rest = np.ones(len(places), dtype=bool)
    rest[elbow], rest[neck] = False, False
    for name in ("right_shoulder", "left_shoulder"):
        off = np.linalg.norm(found.paths[name] - whole.paths[name], axis=1)
        assert off[rest].max() < 0.004


def test_an_elbow_that_has_fallen_off_for_a_while_is_left_out() -> None:
    made, whole = take(), found_in(take())
    places = made.places.copy()
    places[100:140, made.names.index("RELB")] += [0.3, 0.2, -0.4]
    found = found_in(made, places)
    rest = np.r_[0:90, 150 : len(places)]
    off = found.paths["right_shoulder"][rest] - whole.paths["right_shoulder"][rest]
    assert np.linalg.norm(off, axis=1).max() < 0.01


def test_blocks_do_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = found_in(take())
    monkeypatch.setattr("ergoqp.mocap.markers.joints._BLOCK", 50)
    parts = found_in(take())
    same(whole, parts)
    for name, half in whole.doubts.items():
        np.testing.assert_array_equal(half, parts.doubts[name])


def arms(side: str = "right", count: int = 400) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """From the joint below the marker to the elbow, the marker, and the slide (n, 3) [m].

    Ahead, left, up. An arm is raised sideways, and forward; the marker slides up and in.
    """
    out = -1.0 if side == "right" else 1.0
    raised = np.radians(np.concatenate([np.linspace(0, 150, count), np.linspace(0, 150, count)]))
    plane = np.repeat([0.0, np.pi / 2], count)
    arm = RADIUS * np.column_stack(
        [np.sin(raised) * np.sin(plane), out * np.sin(raised) * np.cos(plane), -np.cos(raised)]
    )
    slide = np.clip(np.degrees(raised) / 120, 0, 1)[:, None] * [0.0, -out * 0.035, 0.045]
    return arm - slide, np.array([0.0, out * 0.18, 0.0]) + slide, slide


@pytest.mark.parametrize("side", SIDES)
def test_the_slide_is_found_with_its_signs(side: str) -> None:
    arm, marker, slide = arms(side)
    sliding = sliding_of(arm, marker)
    assert sliding is not None
    assert sliding.hangs
    assert sliding.shown
    assert sliding.slides
    assert sliding.radius == pytest.approx(RADIUS, abs=0.003)
    found = sliding.at(elevation_of(arm)) - sliding.offset
    assert np.abs(found - slide).max() < 0.016
    assert rms(found - slide) < 0.006
    assert np.abs(sliding.at(np.array([120.0]))[0] - slide[-1]).max() < 0.012
    # What is found is what fits best.
    bone = arm - sliding.offset + sliding.at(elevation_of(arm))
    assert rms(np.linalg.norm(bone, axis=1) - sliding.radius) < 0.0015


@pytest.mark.parametrize("longer", [1.07, 1.4])
def test_frames_that_are_wrong_weigh_little(longer: float) -> None:
    arm, marker, slide = arms()
    wrong = np.arange(len(arm)) % 5 == 0
    arm[wrong] *= longer
    sliding = sliding_of(arm, marker)
    assert sliding is not None
    assert sliding.radius == pytest.approx(RADIUS, abs=0.007)
    assert rms(sliding.at(elevation_of(arm)) - sliding.offset - slide) < 0.008


def plain(slide: np.ndarray, **changes: Any) -> Sliding:
    """A slide at each knot (5, 3), without any doubt."""
    none = np.zeros((181, 3, 3))
    return replace(Sliding(np.zeros(3), slide, RADIUS, 0.002, none, 100.0, True, True), **changes)


def test_what_counts_as_a_slide() -> None:
    slide = np.zeros((5, 3))
    slide[2:] = [0.0, 0.0, 0.03]
    assert plain(slide).slides
    assert not plain(slide, highest=60.0).slides
    assert not plain(slide, shown=False).slides
    away = np.full(3, 0.0033)
    assert not plain(0 * slide + 2 * away, offset=away).slides
    assert plain(0 * slide + 2 * away, offset=-away).slides


def test_only_the_doubt_across_the_arm_turns_it() -> None:
    one, elbow, axes = np.zeros((1, 3)), np.array([[0.0, -RADIUS, 0.0]]), np.eye(3)[None]
    slide = np.full((5, 3), 1e-9)
    for variance, doubt in (([0, 1e-4, 0], 0.0), ([1e-4, 0, 0], 0.013), ([0, 0, 1e-4], 0.013)):
        spread = np.tile(np.diag(variance), (181, 1, 1))
        sliding = plain(slide, covariance=spread, hangs=False)
        half = sliding.joint(one, elbow, axes)[1][0]
        assert half == pytest.approx(doubt / RADIUS, abs=1e-6)


@pytest.mark.parametrize("side", SIDES)
def test_the_joint_in_a_turned_trunk(side: str) -> None:
    arm, marker, slide = arms(side)
    sliding = sliding_of(arm, marker)
    assert sliding is not None
    turn = Rotation.random(len(arm), rng=np.random.default_rng(3))
    axes = axes_of(turn.apply([0.0, 0.0, -1.0]), turn.apply([0.0, 1.0, 0.0]))
    np.testing.assert_allclose(turned(axes, turn.apply([1.0, 2.0, 3.0])), [[1.0, 2, 3]] * len(arm))
    below = turn.apply(slide)
    joint, half = sliding.joint(below, turn.apply(slide + arm), axes)
    assert np.linalg.norm(joint, axis=1).max() < 0.02
    assert np.linalg.norm(below, axis=1).max() > 0.05
    off = np.linalg.norm(np.cross(turn.inv().apply(joint), arm + slide), axis=1) / RADIUS**2
    assert (off <= half + np.radians(1)).mean() > 0.95
    still = sliding.joint(below, np.full_like(below, np.nan), axes)
    np.testing.assert_array_equal(still[0], below)
    assert not still[1].any()


def test_the_doubt_grows_with_what_is_left() -> None:
    arm, marker, _ = arms()
    sliding = sliding_of(arm, marker)
    assert sliding is not None
    one, elbow = np.zeros((1, 3)), np.array([[0.0, -0.2, -0.24]])
    axes = np.eye(3)[None]
    doubts = [float(sliding.joint(one, share * elbow, axes)[1][0]) for share in (1.2, 1.4, 1.6)]
    assert doubts[0] + 0.2 < doubts[1] + 0.1 < doubts[2]
    # A hanging arm of the wrong length may be off, too.
    down = np.array([[0.0, -0.01, -1.0]])
    assert sliding.joint(one, RADIUS * down, axes)[1][0] == 0
    assert sliding.joint(one, 1.2 * RADIUS * down, axes)[1][0] > 0.1


def test_shoulders_that_are_shrugged_widen_the_doubt() -> None:
    postures = raised("across the chest", 90.0, hang=True)
    calm, shrugs = (errors(take_of(postures, each)) for each in (MUCH, SHRUGGING))
    high = calm["elevation"] > 75
    assert shrugs["half"][high].mean() > calm["half"][high].mean() + 1
    assert np.mean(shrugs["joint"] <= shrugs["half"] + 1) > 0.95


def test_too_little_to_be_told() -> None:
    arm, marker, _ = arms()
    low = elevation_of(arm) < 45
    assert sliding_of(arm[low], marker[low]) is None
    assert sliding_of(np.full_like(arm, np.nan), marker) is None
    assert sliding_of(arm, np.full_like(marker, np.nan)) is None
    assert sliding_of(0 * arm, marker) is None
    many = np.tile(arm, (5, 1))
    found, same_found = sliding_of(many, np.tile(marker, (5, 1))), sliding_of(arm, marker)
    assert found is not None
    assert same_found is not None
    assert np.abs(found.slide - same_found.slide).max() < 0.004
    few = np.flatnonzero(~low)[:9]
    assert sliding_of(arm[few], marker[few]) is None


def test_the_sentence_says_how_far() -> None:
    slide = np.tile([0.0, 0.03, 0.04], (5, 1))
    doubts = {"right_upper_arm": np.full(10, np.radians(3.0))}
    (said,) = sliding_said({"right": plain(slide)}, doubts)
    assert "right 50 mm at 100 deg" in said
    assert "off by 3 deg" in said
    assert sliding_said({"right": plain(0 * slide)}, doubts) == []


def test_the_made_take_slides_as_it_says() -> None:
    made, still = take(), take(NONE)
    for side in SIDES:
        letter = side[0].upper()
        acromion, arm = (
            [made.names.index(f"{letter}{name}") for name in names] for names in (("SHO",), ARM)
        )
        moved = made.places - still.places
        assert np.abs(moved[:, arm]).max() < 1e-9
        assert np.linalg.norm(moved[:, acromion[0]], axis=1).max() == pytest.approx(0.057, abs=0.01)
        assert moved[:, acromion[0], 2].max() > 0.03
