"""Joint centres from landmarks: those of the body that wears them, wherever it can be told."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.made_markers import markers_of, plug_in_gait
from benchmarks.made_motions import BODY, posture
from ergoqp.human.body import Marker
from ergoqp.joints import JOINTS, LOWER, SIDES, UPPER
from ergoqp.mocap.markers.bones import Widths, carried
from ergoqp.mocap.markers.fit import places_of_markers
from ergoqp.mocap.markers.joints import (
    centres_of_landmarks,
    roots_of,
)
from ergoqp.mocap.naming import LANDMARKS, centres_of, known_sets

Places = dict[str, np.ndarray]

SIZE = ((BODY.lengths["hip_width"] / 2 - 0.0073) / 0.33, 0.15)
"""Width and depth of the pelvis of `benchmarks.made_markers` [m]."""
INNER = {
    f"{letter}{name}": Marker(f"{side}_{frame}", (0.0, -half * out, -BODY.lengths[bone]), 0.0)
    for side, letter, out in (("right", "R", -1.0), ("left", "L", 1.0))
    for name, frame, half, bone in (
        ("MELB", "shoulder", 0.044, "upper_arm"),
        ("KNM", "hip", 0.057, "thigh"),
        ("MED", "knee", 0.043, "shank"),
    )
}
"""Markers on the inner sides, as far from the joints as those on the outer ones."""
EXACT = ("neck", "shoulder", "wrist", "hip", "knee", "ankle", "toe")
"""Centres that the markers place exactly; a head's are where heads have them on average."""


def landmarks(postures: np.ndarray, *more: str) -> tuple[Places, Places]:
    """Landmarks of Plug-in Gait and further ones, and the true centres."""
    pelvis = np.random.default_rng(1).uniform([-1, -1, 0.8, -3], [1, 1, 1, 3], (len(postures), 4))
    worn = {**plug_in_gait(BODY), **INNER}
    paths = places_of_markers(BODY, pelvis, postures, worn)
    at = {mark: paths[name] for mark, name in known_sets()[0].found_in(tuple(paths)).items()}
    kept = {mark: path for mark, path in at.items() if "inner" not in mark or mark[-5:] in more}
    return kept, centres_of(BODY, pelvis, postures)


def anyhow(count: int = 300) -> np.ndarray:
    """Postures all over the ranges, shoulders turned, hips abducted, elbows and knees bent."""
    share = np.random.default_rng(2).uniform(0.05, 0.95, (count, len(JOINTS)))
    return LOWER + (UPPER - LOWER) * share


def off(found: Places, truth: Places, *ends: str) -> float:
    """How far centres are from the truth at most [m]."""
    names = [name for name in truth if name.endswith(ends) and not name.startswith("head")]
    return max(float(np.abs(found[name] - truth[name]).max()) for name in names)


def bend(centres: Places, side: str) -> np.ndarray:
    """How much an elbow is bent (n,) [deg]."""
    upper = centres[f"{side}_elbow"] - centres[f"{side}_shoulder"]
    fore = centres[f"{side}_wrist"] - centres[f"{side}_elbow"]
    across = np.linalg.norm(np.cross(upper, fore), axis=1)
    return np.degrees(np.arctan2(across, (upper * fore).sum(axis=1)))


def test_the_made_markers_are_those_that_are_meant() -> None:
    names, _ = markers_of(BODY, np.zeros((1, 4)), np.zeros((1, 32)))
    assert len(names) == 39
    assert set(known_sets()[0].found_in(names).values()) == set(names) - {"RBAK"}


def test_any_posture_is_recovered() -> None:
    at, truth = landmarks(anyhow())
    found = centres_of_landmarks(at, Widths(), SIZE)
    assert off(found, truth, *EXACT) < 1e-9
    both_sides = centres_of_landmarks(landmarks(anyhow(), "elbow")[0], Widths(), SIZE)
    assert off(both_sides, truth, *EXACT, "elbow") < 1e-9
    for name in ("head", "head_top"):
        assert np.abs(found[name] - truth[name]).max() < 0.02


@pytest.mark.parametrize("more", [("_knee",), ("ankle",), ("_knee", "ankle", "elbow")])
def test_markers_on_both_sides_need_no_others(more: tuple[str, ...]) -> None:
    at, truth = landmarks(anyhow(), *more)
    for side in SIDES:
        if "_knee" in more:
            at[f"{side}_thigh"] = at[f"{side}_thigh"] + [0.3, -0.4, 0.2]
    found = centres_of_landmarks(at, Widths(knee=0.09, ankle=0.09, elbow=0.09), SIZE)
    assert off(found, truth, *(each.removeprefix("_") for each in more)) < 1e-9


def test_a_knee_without_a_marker_on_the_thigh_shows_by_its_bend() -> None:
    postures = anyhow()
    at, truth = landmarks(postures)
    for side in SIDES:
        del at[f"{side}_thigh"], at[f"{side}_shank"]
    found = centres_of_landmarks(at, Widths(), SIZE)
    for side in SIDES:
        knee = np.degrees(postures[:, JOINTS.index(f"{side}_knee_flexion")])
        away = np.linalg.norm(found[f"{side}_knee"] - truth[f"{side}_knee"], axis=1)
        assert away[knee > 40].max() < 0.002
        # Straighter ones are taken to be turned as the pelvis is.
        assert np.median(away[knee < 15]) < 0.04


@pytest.mark.parametrize(
    "held",
    [{}, {"arms_shoulder_abduction": 90.0}, {"arms_shoulder_flexion": 90.0}],
    ids=["hanging", "aside", "ahead"],
)
def test_an_elbow_with_one_marker_is_that_of_plug_in_gait(held: dict[str, float]) -> None:
    # By the plane of shoulder, marker and wrist. Where the arm is straighter the marker, and not
    # the bend, tips this plane: by so much without a carrying angle, and by less with one.
    bends = np.array([0.0, 10, 20, 30, 45, 60, 90, 120])
    at, truth = landmarks(posture(len(bends), arms_elbow_flexion=bends, **held))
    found = centres_of_landmarks(at, Widths(), SIZE)
    for side in SIDES:
        error = bend(found, side) - bends
        assert (error > -1e-9).all()
        np.testing.assert_array_less(error, [15.5, 13.0, 11.4, 8.3, 5.3, 3.5, 1.4, 0.5])
        turned = [np.array(each[f"{side}_elbow"]) for each in (found, truth)]
        away = np.linalg.norm(turned[0] - turned[1], axis=1)
        np.testing.assert_array_less(away, [0.04, 0.034, 0.032, 0.024, 0.017, 0.013, 0.009, 0.007])


@pytest.mark.parametrize("raised", [0, 30, 90, 120, 150])
def test_the_outside_of_a_raised_arm_is_that_of_the_hanging_one(raised: int) -> None:
    # As the shortest turn from the one to the other has it.
    turn = Rotation.random(40, rng=np.random.default_rng(6))
    down, aside = turn.apply([0, 0, -1]), turn.apply([0, 1, 0])
    about = np.linspace(0, 2 * np.pi, 40)
    axis = turn.apply(np.stack([np.cos(about), np.sin(about), 0 * about], axis=1))
    lift = Rotation.from_rotvec(np.radians(raised) * axis)
    found = carried(aside, down, lift.apply(down))
    np.testing.assert_allclose(found, lift.apply(aside), atol=1e-12)


def test_an_arm_straight_up_has_no_outside_at_infinity() -> None:
    down, aside = np.array([[0.0, 0.0, -1.0]]), np.array([[0.0, 1.0, 0.0]])
    for off in (0.0, 1e-9, 1e-3):
        up = np.array([[0.0, off, 1.0]]) / np.hypot(off, 1.0)
        assert np.linalg.norm(carried(aside, down, up)) < 1.5
    lost = np.full((1, 3), np.nan)
    np.testing.assert_array_equal(carried(aside, lost, up), aside)


def test_the_sacrum_or_one_psis_stand_for_both() -> None:
    at, truth = landmarks(anyhow())
    for kept in ("sacrum", *(f"{side}_psis" for side in SIDES)):
        less = {mark: path for mark, path in at.items() if "psis" not in mark or mark == kept}
        if kept == "sacrum":
            less["sacrum"] = (at["right_psis"] + at["left_psis"]) / 2
        assert off(centres_of_landmarks(less, Widths(), SIZE), truth, "hip") < 1e-9


def test_no_vertical_is_needed() -> None:
    at, _ = landmarks(anyhow(20))
    turn = Rotation.random(rng=np.random.default_rng(5)).as_matrix()
    found = centres_of_landmarks(at, Widths(), SIZE)
    turned = centres_of_landmarks(
        {mark: path @ turn.T + 3.0 for mark, path in at.items()}, Widths(), SIZE
    )
    for name, path in found.items():
        np.testing.assert_allclose(turned[name], path @ turn.T + 3.0, atol=1e-9)


@pytest.mark.parametrize("lost", LANDMARKS)
def test_what_is_lost_takes_nothing_else_along(lost: str) -> None:
    at, _ = landmarks(anyhow(30), "elbow", "_knee", "ankle")
    whole = centres_of_landmarks(at, Widths(), SIZE)
    if lost not in at:
        return
    at[lost] = np.where(np.arange(30)[:, None] < 10, np.nan, at[lost])
    found = centres_of_landmarks(at, Widths(), SIZE)
    side = lost.split("_")[0] if lost.startswith(SIDES) else ""
    for name, path in whole.items():
        np.testing.assert_allclose(found[name][10:], path[10:], atol=1e-12)
        if side and name.startswith(SIDES) and not name.startswith(side) and "asis" not in lost:
            assert np.isfinite(found[name]).all()
    assert set(roots_of(at, Widths(), SIZE, {})) == {
        f"{each}_{joint}" for each in SIDES for joint in ("hip", "shoulder")
    }


def test_nothing_is_told_by_nothing() -> None:
    nothing = {mark: np.full((4, 3), np.nan) for mark in LANDMARKS}
    assert centres_of_landmarks(nothing, Widths(), SIZE) == {}
    in_one_point = {mark: np.zeros((4, 3)) for mark in LANDMARKS}
    centres_of_landmarks(in_one_point, Widths(), SIZE)
    at, _ = landmarks(anyhow(4))
    unknown = centres_of_landmarks(at, Widths(), (float("nan"), float("nan")))
    assert not any(name.endswith(("hip", "knee", "ankle")) for name in unknown)


@pytest.mark.parametrize(
    ("measures", "expected"),
    [
        ({}, {}),
        ({"lkneewidth": 0.11, "rkneewidth": 0.10}, {"knee": 0.0595}),
        ({"lkneewidth": 0.11}, {}),
        ({"lkneewidth": 0.11, "rkneewidth": 0.0}, {}),
        ({"lanklewidth": 0.08, "ranklewidth": 0.07}, {"ankle": 0.0445}),
        ({"lelbowwidth": 0.08, "relbowwidth": 0.08}, {"elbow": 0.047}),
        ({"lshoulderoffset": 0.05, "rshoulderoffset": 0.05}, {"shoulder": 0.057}),
        ({"lhandthickness": 0.03, "rhandthickness": 0.03}, {"hand": 0.022}),
        # What was typed in another unit, or is another thing, is nobody's.
        ({"lkneewidth": 1.1, "rkneewidth": 1.1}, {}),
        ({"lkneewidth": 0.011, "rkneewidth": 0.011}, {}),
        ({"lshoulderoffset": 50.0, "rshoulderoffset": 50.0}, {}),
        ({"bodymass": 0.07, "height": 1.7}, {}),
    ],
)
def test_measured_widths(measures: dict[str, float], expected: dict[str, Any]) -> None:
    assert Widths.of(measures) == Widths(**{k: pytest.approx(v) for k, v in expected.items()})


def test_a_wider_knee_is_further_inside() -> None:
    at, truth = landmarks(anyhow())
    found = centres_of_landmarks(at, Widths.of({"lkneewidth": 0.12, "rkneewidth": 0.12}), SIZE)
    for side in SIDES:
        away = np.linalg.norm(found[f"{side}_knee"] - truth[f"{side}_knee"], axis=1)
        np.testing.assert_allclose(away, 0.067 - 0.057, atol=0.002)
