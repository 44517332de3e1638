"""The axis of an elbow with one marker: by its bend, or by the marker on the upper arm."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.made_arms import Slide, Take, bending, raised, take_of
from benchmarks.made_motions import BODY, RATE
from ergoqp.joints import INDEX, SIDES
from ergoqp.mocap import fit_postures
from ergoqp.mocap.joints import Found, ReadOptions, joints_of
from ergoqp.mocap.markers.bones import (
    Widths,
    aside_of,
    axis_of,
    turn_of,
    turned_about,
)
from ergoqp.mocap.markers.joints import turns_of
from ergoqp.mocap.naming import known_sets
from ergoqp.mocap.recording import JointMotion

SIZE = (0.28, 0.15)
ADULT = Slide(carrying=10.0)
BENT = (float(np.sin(np.radians(15))), float(np.sin(np.radians(30))))
AHEAD = np.degrees(np.arctan2(0.02, 0.05 - 0.022))
"""Angle about the upper arm by which the made marker there is ahead of the axis [deg]."""


@cache
def take(slide: Slide = ADULT, elbow: float | None = None, name: str = "around") -> Take:
    postures = raised(name, elbow or 0.0, hang=True)
    return take_of(bending(postures) if elbow is None else postures, slide)


def found_in(made: Take, *lost: str) -> Found:
    kept = [i for i, name in enumerate(made.names) if name[1:] not in lost]
    names, places = tuple(made.names[i] for i in kept), made.places[:, kept]
    motion = JointMotion(names, places, np.arange(len(places)) / RATE, unit=1.0, markers=True)
    return joints_of(motion, "made", ReadOptions(unit=1.0, up="z"))


def off(made: Take, found: Found, side: str) -> np.ndarray:
    """Angle between an upper arm and the true one (n,) [deg]."""
    arm = found.paths[f"{side}_elbow"].astype(float) - found.paths[f"{side}_shoulder"]
    across = np.linalg.norm(np.cross(arm, made.arms[side]), axis=1)
    return np.degrees(np.arctan2(across, (arm * made.arms[side]).sum(axis=1)))


def landmarks(made: Take) -> dict[str, np.ndarray]:
    own = known_sets()[0].found_in(made.names)
    return {mark: made.places[:, made.names.index(name)] for mark, name in own.items()}


def test_forearms_point_outward_by_the_carrying_angle() -> None:
    for angle in (0.0, 15.0):
        made = take(Slide(carrying=angle, noise=0.0))
        at = {name: made.places[:, i] for i, name in enumerate(made.names)}
        for side in SIDES:
            letter, elbow = side[0].upper(), made.joints[side] + made.arms[side]
            aside = (at[f"{letter}ELB"] - elbow) / 0.044
            wrist = (at[f"{letter}WRA"] + at[f"{letter}WRB"]) / 2 - elbow
            out = np.degrees(np.arcsin((wrist * aside).sum(axis=1) / BODY.lengths["forearm"]))
            np.testing.assert_allclose(out, angle, atol=1e-6)


@pytest.mark.parametrize("carrying", [10.0, 15.0])
def test_bent_frames_show_where_the_marker_is(carrying: float) -> None:
    turns = turns_of(landmarks(take(Slide(carrying=carrying))), Widths(), SIZE, {})
    # It is ahead of the axis, which is clockwise from it on one side only.
    assert np.degrees(turns["right"]) == pytest.approx(AHEAD, abs=6)
    assert np.degrees(turns["left"]) == pytest.approx(-AHEAD, abs=6)


def test_straight_elbows_do_not_show_it() -> None:
    assert turns_of(landmarks(take(elbow=3.0)), Widths(), SIZE, {}) == {}
    bare = {mark: each for mark, each in landmarks(take()).items() if "upper_arm" not in mark}
    assert turns_of(bare, Widths(), SIZE, {}) == {}


@pytest.mark.parametrize("carrying", [0.0, 10.0, 15.0])
def test_straight_elbows_are_read_by_bent_ones(carrying: float) -> None:
    made = take(replace(ADULT, carrying=carrying))
    with_marker, without = found_in(made), found_in(made, "UPA")
    for side in SIDES:
        high = made.elevation[:, 0] > 60
        better, worse = (
            float(off(made, each, side)[high].max()) for each in (with_marker, without)
        )
        assert better < (7.0 if carrying == 0 else 3.5)
        assert worse > 6


@pytest.mark.parametrize(
    ("elbow", "lost", "said"),
    [
        (None, (), "calibrated where the arm is bent more"),
        (3.0, (), "taken to be on the outside: the upper arm may be off by 6 deg"),
        (None, ("UPA",), "less than 25 deg, the elbow may be off by 12 deg"),
    ],
)
def test_the_sentence_says_by_what(elbow: float | None, lost: tuple[str, ...], said: str) -> None:
    sentences = [each for each in found_in(take(elbow=elbow), *lost).said if "An elbow" in each]
    assert len(sentences) == 1
    assert said in sentences[0]


def with_inner_elbows(made: Take) -> Take:
    names = list(made.names)
    places = [made.places]
    for side in SIDES:
        elbow = made.joints[side] + made.arms[side]
        outer = made.places[:, names.index(f"{side[0].upper()}ELB")]
        names.append(f"{side[0].upper()}MELB")
        places.append((2 * elbow - outer)[:, None])
    return replace(made, names=tuple(names), places=np.concatenate(places, axis=1))


@pytest.mark.parametrize("carrying", [0.0, 10.0])
def test_two_markers_of_an_elbow_show_a_carrying_angle(carrying: float) -> None:
    # By the forearm alone, one of 10 deg looks like a rotation of 15 deg at this bend.
    made = with_inner_elbows(take(Slide(carrying=carrying), elbow=40.0))
    truth = raised("around", 40.0, hang=True)
    read = fit_postures(made.names, made.places, RATE, neutral="vertical")
    low = (made.elevation.max(axis=1) < 70) & (made.elevation.min(axis=1) > 20)
    for side in SIDES:
        rotation = INDEX[f"{side}_shoulder_rotation"]
        off = np.degrees(np.abs(read.postures - truth)[low, rotation])
        assert (off.max() > 10) == (carrying > 0)
        noise = np.radians(3.0)
        assert (truth[low, rotation] > read.low[low, rotation] - noise).all()
        assert (truth[low, rotation] < read.high[low, rotation] + noise).all()
        wide = np.degrees(read.high - read.low)[low, rotation]
        assert wide.max() < (25 if carrying else 8)


def test_an_elbow_with_two_markers_needs_no_axis() -> None:
    both = with_inner_elbows(take(elbow=3.0))
    found = found_in(both)
    assert {f"{side}_inner_elbow" for side in SIDES} <= set(found.landmarks.values())
    assert max(float(off(both, found, side).max()) for side in SIDES) < 1


def test_a_turn_about_a_bone() -> None:
    down, ahead = np.array([[0.0, 0.0, -1.0]]), np.array([[1.0, 0.0, 0.0]])
    right = np.array([[0.0, -1.0, 0.0]])
    np.testing.assert_allclose(turned_about(down, ahead, np.pi / 2), right, atol=1e-12)
    many = np.ones((20, 1))
    turn = turn_of(0.8 * many * right, many * ahead, many * down)
    assert turn == pytest.approx(np.pi / 2)
    assert turn_of(0.8 * many[:9] * right, many[:9] * ahead, many[:9] * down) is None
    assert turn_of(0.49 * many * right, many * ahead, many * down) is None
    lost = np.where(np.arange(20)[:, None] < 11, np.nan, many * ahead)
    assert turn_of(0.8 * many * right, lost, many * down) is None
    # A bend counts by its sine: that of 40 deg is turned the more by the same carrying angle.
    bends = np.concatenate([many * right, 0.5 * many * ahead])
    both = turn_of(bends, np.concatenate([many, many]) * ahead, np.concatenate([many, many]) * down)
    assert both == pytest.approx(np.arctan2(1.0, 0.25))


def test_the_bend_is_used_more_and_more() -> None:
    down, out, ahead = np.eye(3)[2:] * -1, np.array([[0.0, 1.0, 0.0]]), np.array([[1.0, 0.0, 0.0]])
    middle = (BENT[0] + BENT[1]) / 2
    for sine, along in ((BENT[0], 0.0), (middle, np.sqrt(0.5)), (BENT[1], 1.0), (0.9, 1.0)):
        found = axis_of(sine * ahead, out, down, BENT)
        assert found[0, 0] == pytest.approx(along)
        assert found[0, 1] == pytest.approx(np.sqrt(1 - along**2))


def test_a_marker_on_the_line_of_a_bone_shows_nothing() -> None:
    start, end = np.zeros((2, 3)), np.array([[0.0, 0.0, -0.3]] * 2)
    found = aside_of(start, end, np.array([[0.009, 0.0, -0.1], [0.011, 0.0, -0.1]]))
    np.testing.assert_allclose(found, [[np.nan] * 3, [1.0, 0.0, 0.0]], atol=1e-12)
