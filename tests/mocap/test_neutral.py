"""Upright is upright and a stoop a stoop, whatever the skeleton's spine is like."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.made_motions import BODY, RATE, Places, fitted, leaning, posture, stoop, walk
from benchmarks.recording_intervals import walking, with_t_pose
from ergoqp import reba
from ergoqp.errors import InputError, RecordingError
from ergoqp.joints import INDEX
from ergoqp.mocap import Recording, fit_postures, load_recording
from ergoqp.mocap.fitting.neutral import leans, neutral_of, stated_neutral, straightened, t_poses
from ergoqp.mocap.formats.bvh import write_bvh
from ergoqp.mocap.naming import centres_of

TRUNK = INDEX["trunk_flexion"]


def trunk_score(recording: Recording) -> float:
    return float(reba.assess(recording.scored_postures).segments["trunk"].mean())


@pytest.mark.parametrize("lean", [-30.0, -20.0, -10.0, 0.0, 10.0, 20.0, 30.0])
def test_walking_upright_is_upright(lean: float) -> None:
    places, _ = walk()
    recording = fitted(leaning(places, lean))
    assert trunk_score(recording) <= 1.1
    assert recording.scored.all()
    assert abs(np.degrees(np.median(recording.postures[:, INDEX["neck_flexion"]]))) < 2
    # Hanging arms hang, whatever line the trunk is measured by.
    plain = fitted(places)
    np.testing.assert_allclose(recording.postures, plain.postures, atol=np.radians(3))
    if lean:
        # By the vertical it is somebody who is bent.
        assert trunk_score(fitted(leaning(places, lean), neutral="vertical")) > 1.9


@pytest.mark.parametrize("rate", [25.0, 60.0, 120.0])
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_a_walk_is_one_at_any_rate_and_a_bench_worker_stoops(rate: float, noise: float) -> None:
    generator = np.random.default_rng(0)
    for seconds in (3.0, 8.0):
        places, time = walk(seconds)
        leant = leaning(places, 20.0)
        at = np.arange(0, time[-1], 1 / rate)
        sampled = [
            np.stack([np.interp(at, time, each) for each in path.T], axis=1)
            + noise * generator.standard_normal((len(at), 3))
            for path in leant.values()
        ]
        recording = fit_postures(list(leant), np.stack(sampled, axis=1), rate)
        assert np.degrees(np.median(recording.postures[:, TRUNK])) == pytest.approx(0, abs=3)
    # Standing still at a bench, with noise, and with steps to the side.
    bent = posture(900, trunk_flexion=25.0)
    pelvis = np.tile([0.0, 0.0, 0.9, 0.0], (900, 1))
    pelvis[:, 1] = 0.4 * np.floor(np.arange(900) / 150)
    there = centres_of(BODY, pelvis, bent)
    noisy = [path + 2 * noise * generator.standard_normal(path.shape) for path in there.values()]
    recording = fit_postures(list(there), np.stack(noisy, axis=1), 30.0)
    assert np.degrees(np.median(recording.postures[:, TRUNK])) == pytest.approx(25, abs=2)


def test_arms_spread_in_the_middle_or_bent_are_work() -> None:
    spread = centres_of(
        BODY,
        np.tile([0, 0, 0.9, 0.3], (300, 1)),
        posture(300, arms_shoulder_abduction=90.0, trunk_flexion=60.0),
    )
    work = stoop(deepest=60.0, stands=False)[0]
    recording = fitted({c: np.concatenate([work[c], spread[c]]) for c in work})
    assert recording.scored.all()
    assert np.degrees(recording.postures[:200, TRUNK]) == pytest.approx(60, abs=1)


def test_drilling_overhead_bent_backward_is_bent() -> None:
    angles = {"arms_shoulder_flexion": 130.0, "trunk_flexion": -22.0}
    places = centres_of(BODY, np.tile([0, 0, 0.9, 0.3], (200, 1)), posture(200, **angles))
    recording = fitted(places)
    assert np.degrees(recording.postures[:, TRUNK]) == pytest.approx(-22, abs=0.5)


def test_a_rest_pose_says_whether_skeleton_or_person_leans(tmp_path: Path) -> None:
    _, time = walk()
    postures = fitted(walk()[0]).postures
    poses = np.tile(np.eye(4), (len(time), 1, 1))
    for lean, lines in ((0.0, "rest pose"), (20.0, "and not in the skeleton's rest pose")):
        bent = postures.copy()
        bent[:, TRUNK] += np.radians(lean)
        path = write_bvh(tmp_path / "walk.bvh", bent, poses, BODY, 1 / RATE)
        recording = load_recording(path)
        assert np.degrees(recording.postures[:, TRUNK].mean()) == pytest.approx(lean, abs=1)
        assert TRUNK not in recording.spans
        assert lines in " ".join(recording.assumptions)


def test_a_stoop_stays_a_stoop() -> None:
    for deepest, stands in (
        (70.0, True),
        (40.0, True),
        (60.0, False),
        (30.0, False),
        (20.0, False),
    ):
        places, _ = stoop(deepest=deepest, stands=stands)
        recording = fitted(places)
        assert np.degrees(recording.postures[:, TRUNK].max()) == pytest.approx(deepest, abs=1)


def test_who_walks_stooped_is_stooped() -> None:
    places, _ = walk()
    # The hips go behind the feet, or the person falls.
    for name, path in places.items():
        if name.endswith(("ankle", "knee", "toe")):
            share = 0.5 if name.endswith("knee") else 1.0
            path += share * 0.06 * np.array([np.cos(0.4), np.sin(0.4), 0])
    recording = fitted(leaning(places, 30.0))
    assert np.degrees(np.median(recording.postures[:, TRUNK])) == pytest.approx(30, abs=1)


@pytest.mark.parametrize("skin", [True, False])
def test_markers_on_the_skin_show_where_the_spine_of_a_stooped_walker_is(skin: bool) -> None:
    places, _ = walking(25.0)
    for name, path in places.items():
        # Hips that are behind the feet belong to a stoop.
        if not name.endswith(("knee", "ankle", "toe")):
            path -= [0.1, 0.0, 0.0]
    found = neutral_of(places, {}, np.arange(len(places["neck"])) / RATE, skin)
    assert found.trunk == 0
    ends = (0.0, 0.0 if skin else 25.0)
    np.testing.assert_allclose(np.degrees(found.trunk_ends), ends, atol=0.1)


def test_a_stoop_after_a_walk_is_measured_from_it() -> None:
    walked, _ = walk()
    stooped, _ = stoop()
    both = {centre: np.concatenate([walked[centre], stooped[centre]]) for centre in walked}
    for lean in (-20.0, 0.0, 20.0):
        recording = fitted(leaning(both, lean))
        assert np.degrees(recording.postures[:, TRUNK].max()) == pytest.approx(70, abs=3)
        assert np.degrees(np.median(recording.postures[:300, TRUNK])) == pytest.approx(0, abs=2)


def t_pose(seconds: float) -> Places:
    count = int(seconds * RATE)
    postures = posture(count, arms_shoulder_abduction=90.0)
    return centres_of(BODY, np.tile([0, 0, 0.9, 0.3], (count, 1)), postures)


@pytest.mark.parametrize("lean", [-15.0, 0.0, 25.0])
def test_a_t_pose_is_straight_and_no_work(lean: float) -> None:
    posed, work = t_pose(0.5), stoop(deepest=50.0, stands=False)[0]
    both = leaning({c: np.concatenate([posed[c], work[c]]) for c in posed}, lean)
    recording = fitted(both)
    assert recording.causes(10) == ["calibration pose"]
    assert (~recording.scored).sum() == len(posed["neck"])
    assert np.degrees(recording.postures[40:, TRUNK]) == pytest.approx(50, abs=3)
    after = fitted(leaning({c: np.concatenate([work[c], posed[c]]) for c in posed}, lean))
    assert after.causes(len(after.time) - 1) == ["calibration pose"]
    # In the middle of a recording it may be work.
    assert fitted({c: np.concatenate([work[c], posed[c], work[c]]) for c in posed}).scored.all()
    assert fitted(posed).scored.all()


def test_arms_to_the_sides_are_a_t_pose_of_who_stands() -> None:
    for legs, expected in ((0.0, True), (60.0, False)):
        angles = {"legs_knee_flexion": legs, "legs_hip_flexion": legs / 2}
        postures = posture(5, arms_shoulder_abduction=90.0, **angles)
        places = centres_of(BODY, np.tile([0, 0, 0.9, 0.3], (5, 1)), postures)
        assert t_poses(places).all() == expected
    low = posture(5, arms_shoulder_abduction=78.0)
    assert t_poses(centres_of(BODY, np.tile([0, 0, 0.9, 0.3], (5, 1)), low)).all()
    low = posture(5, arms_shoulder_abduction=60.0)
    assert not t_poses(centres_of(BODY, np.tile([0, 0, 0.9, 0.3], (5, 1)), low)).any()


def test_who_stands_leaning_backward_is_a_skeleton_that_leans() -> None:
    places = centres_of(BODY, np.tile([0, 0, 0.9, 0.3], (120, 1)), posture(120))
    for lean, expected in ((-20.0, 0.0), (20.0, 20.0), (-6.0, -6.0)):
        recording = fitted(leaning(places, lean))
        assert np.degrees(recording.postures[:, TRUNK]) == pytest.approx(expected, abs=0.5)
        assert abs(np.degrees(recording.postures[:, INDEX["neck_flexion"]]).max()) < 21


def test_what_is_stated_counts(tmp_path: Path) -> None:
    stooped, time = stoop(deepest=40.0)
    leant = leaning(stooped, 12.0)
    for neutral in (0.0, float(time[-1])):
        recording = fitted(leant, neutral=neutral)
        assert np.degrees(recording.postures[0, TRUNK]) == pytest.approx(0, abs=0.5)
        assert "as stated" in " ".join(recording.assumptions)
    assert np.degrees(fitted(leant).postures[0, TRUNK]) == pytest.approx(12, abs=0.5)
    with pytest.raises(InputError, match=r"neutral: got 99 s, allowed 0\.00 to 3\.98 s"):
        fitted(leant, neutral=99.0)
    with pytest.raises(RecordingError, match=r"neutral: .*leans by more than 35 deg"):
        fitted(stoop(deepest=60.0, stands=False)[0], neutral=1.0)
    for wrong in (True, float("nan"), [1.0]):
        with pytest.raises(InputError, match="neutral: got"):
            fitted(leant, neutral=wrong)


def test_another_recording_may_say_how_the_person_stands(tmp_path: Path) -> None:
    lean = np.radians(15)
    upright, work = (posture(30, trunk_flexion=angle) for angle in (15.0, 55.0))
    poses = np.tile(np.eye(4), (30, 1, 1))
    paths = [
        write_bvh(tmp_path / f"{name}.bvh", postures, poses, BODY, 1 / RATE)
        for name, postures in (("trial", upright), ("work", work))
    ]
    recording = load_recording(paths[1], neutral=paths[0])
    assert recording.postures[:, TRUNK] == pytest.approx(np.radians(55) - lean, abs=0.01)
    assert load_recording(paths[1]).postures[:, TRUNK] == pytest.approx(np.radians(55), abs=0.01)
    with pytest.raises(RecordingError, match="none"):
        load_recording(paths[1], neutral=tmp_path / "none.bvh")


def test_leans_are_what_is_taken_away() -> None:
    places, time = walk()
    leant = leaning(places, 17.0)
    found = neutral_of(leant, {}, time)
    assert np.degrees(found.trunk) == pytest.approx(17, abs=0.5)
    after = straightened(leant, found.trunk, found.neck)
    np.testing.assert_allclose(np.median(leans(after), axis=1), 0, atol=1e-3)
    for name in ("neck", "head", "right_wrist"):
        np.testing.assert_allclose(after[name], places[name], atol=0.01)


def test_without_legs_or_neck_nothing_is_said() -> None:
    places, time = walk(2.0)
    for lost in (("right_ankle", "left_ankle"), ("neck",), ("right_hip", "left_hip", "pelvis")):
        rest = {
            centre: path for centre, path in leaning(places, 20.0).items() if centre not in lost
        }
        assert neutral_of(rest, {}, time).trunk == 0.0


@pytest.mark.parametrize(("lean", "said"), [(10.0, "forward"), (-10.0, "backward")])
def test_a_lean_is_told_with_its_direction(lean: float, said: str) -> None:
    places = leaning(walk()[0], lean)
    frames = np.ones(len(places["neck"]), dtype=bool)
    sentence = stated_neutral(places, frames, "at 2 s").sentence
    assert f"the skeleton's trunk leans {said} by 10 deg there, and its neck " in sentence
    assert "ward by -" not in sentence


@pytest.mark.parametrize("nod", [60.0, -60.0, 80.0, -80.0])
def test_nobody_stands_straight_with_the_head_on_the_chest(nod: float) -> None:
    places = walk()[0]
    ahead, up = np.array([np.cos(0.4), np.sin(0.4), 0.0]), np.array([0.0, 0.0, 1.0])
    tilt = np.radians(nod)
    for name, length in (("head", 0.12), ("head_top", 0.3)):
        places[name] = places["neck"] + length * (np.sin(tilt) * ahead + np.cos(tilt) * up)
    frames = np.arange(len(places["neck"])) == 10
    if abs(nod) < 70:
        assert stated_neutral(places, frames, "at 2 s").neck == pytest.approx(tilt, abs=0.1)
        return
    with pytest.raises(RecordingError, match="neutral: got a posture at 2 s in which"):
        stated_neutral(places, frames, "at 2 s")


def upright_and_bent(lean: float, knees: float = 50.0) -> tuple[Places, Places]:
    """Somebody who works with bent knees, and a rest pose of the skeleton, which leans."""
    works = posture(300, trunk_flexion=40.0, legs_knee_flexion=knees, legs_hip_flexion=20.0)
    still = posture(1, trunk_flexion=lean)
    pelvis = np.tile([0.0, 0.0, 0.85, 0.0], (300, 1))
    rest = centres_of(BODY, pelvis[:1], still)
    return centres_of(BODY, pelvis, works), {name: path[0] for name, path in rest.items()}


def test_a_rest_pose_that_is_known_to_be_upright_needs_no_confirmation() -> None:
    places, rest = upright_and_bent(12.0)
    found = neutral_of(places, rest, np.arange(300) / RATE)
    assert found.trunk == pytest.approx(np.radians(12), abs=0.01)
    assert found.trunk_ends == (found.trunk, found.trunk)


def test_a_standing_that_leans_backward_confirms_no_t_pose() -> None:
    posed = posture(int(RATE), trunk_flexion=-12.0, arms_shoulder_abduction=90.0)
    stands = posture(int(3 * RATE), trunk_flexion=-12.0, arms_elbow_flexion=20.0)
    both = np.concatenate([posed, stands])
    places = centres_of(BODY, np.tile([0.0, 0.0, 0.88, 0.0], (len(both), 1)), both)
    found = neutral_of(places, {}, np.arange(len(both)) / RATE)
    assert np.degrees(found.trunk_ends) == pytest.approx((-12, 0), abs=0.5)


def test_all_that_may_be_upright_is_between_the_ends() -> None:
    # The skeleton leans by 14 degrees, and the person leans backward in the T-pose.
    upright, postures = walking()
    places, _ = with_t_pose(upright, postures, -6.0)
    found = neutral_of(leaning(places, 14.0), {}, np.arange(len(places["neck"])) / RATE)
    assert np.degrees(found.trunk) == pytest.approx(8, abs=0.5)
    assert np.degrees(found.trunk_ends) == pytest.approx((0, 14), abs=0.5)


def test_who_walks_and_looks_at_the_floor_has_two_zeros_of_the_neck() -> None:
    for looks, ends in ((20.0, (20.0, 20.0)), (45.0, (0.0, 45.0))):
        places, _ = walking(neck=looks)
        found = neutral_of(places, {}, np.arange(len(places["neck"])) / RATE)
        assert np.degrees(found.neck_ends) == pytest.approx(ends, abs=1)
