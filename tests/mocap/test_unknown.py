"""Ends of angles that a recording does not show: near in time, later anywhere, and what follows."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from benchmarks.made_motions import RATE, Places, fitted, leaning, posture
from benchmarks.recording_intervals import people_who_walk, walking, whole, with_t_pose
from ergoqp import reba
from ergoqp.joints import INDEX, LOWER, SIDES, UPPER
from ergoqp.mocap import Recording
from ergoqp.mocap.fitting.unknown import (
    NEAR,
    Doubt,
    away_from,
    pieces_of,
    spans_of,
    with_spans,
)

COUNT = 600
TIME = np.arange(COUNT) / RATE
TRUNK, NECK, ELBOW = (INDEX[f"{name}_flexion"] for name in ("trunk", "neck", "right_elbow"))


def ends_of(
    postures: np.ndarray, observed: np.ndarray, time: np.ndarray = TIME, doubt: Doubt | None = None
) -> tuple[np.ndarray, np.ndarray]:
    spans, _ = spans_of(postures, observed, time, doubt)
    return with_spans(postures, spans, upper=False), with_spans(postures, spans, upper=True)


def swinging(size: float = 20.0, hertz: float = 0.5) -> np.ndarray:
    return posture(COUNT, right_elbow_flexion=60 + size * np.sin(2 * np.pi * hertz * TIME))


def test_what_is_seen_is_known() -> None:
    postures = swinging()
    low, high = ends_of(postures, np.ones_like(postures, dtype=bool))
    np.testing.assert_array_equal(low, postures)
    np.testing.assert_array_equal(high, postures)


def test_what_is_never_seen_is_anywhere() -> None:
    postures = swinging()
    observed = np.ones_like(postures, dtype=bool)
    observed[:, ELBOW] = False
    low, high = ends_of(postures, observed)
    assert (low[:, ELBOW] == LOWER[ELBOW]).all()
    assert (high[:, ELBOW] == UPPER[ELBOW]).all()
    said = reba.assess(postures[:1], low=low[:1], high=high[:1]).reasons(0)
    assert "right lower arm 1 to 2: right elbow flexion not known" in said


def test_near_in_time_it_is_near_and_later_anywhere() -> None:
    truth = swinging()
    observed = np.ones_like(truth, dtype=bool)
    lost = slice(200, 400)
    observed[lost, ELBOW] = False
    postures = truth.copy()
    postures[lost, ELBOW] = np.interp(TIME[lost], TIME[[199, 400]], truth[[199, 400], ELBOW])
    low, high = ends_of(postures, observed)
    wide = np.degrees(high - low)[:, ELBOW]
    assert (wide[:200] == 0).all()
    assert 0 < wide[200] < 5
    assert (np.diff(wide[200:250]) >= -1e-3).all()
    # More than a second from both sides: frames 260 to 339.
    assert wide[265:335].min() > 149
    assert ((truth >= low - 1e-6) & (truth <= high + 1e-6))[:, ELBOW].all()


@settings(max_examples=25, deadline=None)
@given(st.floats(2.0, 40.0), st.floats(0.2, 2.0), st.integers(60, 400), st.floats(0.1, 0.9))
def test_gaps_of_less_than_a_second_hold(
    size: float, hertz: float, first: int, seconds: float
) -> None:
    # Of a swing that turns twice in a gap nothing is left to be measured.
    assume(hertz * seconds < 0.45)
    truth = swinging(size, hertz)
    observed = np.ones_like(truth, dtype=bool)
    rows = slice(first, first + max(1, int(seconds * RATE)))
    observed[rows, ELBOW] = False
    postures = truth.copy()
    known = np.flatnonzero(observed[:, ELBOW])
    postures[rows, ELBOW] = np.interp(TIME[rows], TIME[known], truth[known, ELBOW])
    low, high = ends_of(postures, observed)
    slack = np.radians(0.15 * size)
    assert ((truth >= low - slack) & (truth <= high + slack))[:, ELBOW].all()
    assert (low <= postures).all()
    assert (postures <= high).all()


def test_a_short_recording_says_nothing_of_movements() -> None:
    postures = swinging()[:12]
    observed = np.ones_like(postures, dtype=bool)
    observed[5:8, ELBOW] = False
    low, high = ends_of(postures, observed, TIME[:12])
    assert np.degrees(high - low)[5:8, ELBOW].min() > 30


def test_nothing_is_near_across_a_cut() -> None:
    places = {"pelvis": np.zeros((100, 3)), "neck": np.tile([0.0, 0.0, 0.5], (100, 1))}
    for path in places.values():
        path[50:] += 3.0
        path[48:50] = np.nan
    time = TIME[:100]
    pieces = pieces_of(places, time)
    assert pieces[50] - pieces[47] > 2 * NEAR
    # The frames between are on neither side.
    assert (np.diff(pieces)[[47, 49]] > NEAR).all()
    np.testing.assert_allclose(np.diff(pieces)[:47], 1 / RATE)
    assert away_from(np.zeros(100, dtype=bool), time).min() == np.inf


def test_in_a_gap_across_a_sudden_movement_it_is_anywhere_between() -> None:
    postures = posture(COUNT, right_elbow_flexion=np.where(np.arange(COUNT) < 300, 20.0, 80.0))
    observed = np.ones_like(postures, dtype=bool)
    observed[295:305, ELBOW] = False
    postures[295:305, ELBOW] = np.linspace(postures[294, ELBOW], postures[305, ELBOW], 10)
    low, high = (np.degrees(each)[295:305, ELBOW] for each in ends_of(postures, observed))
    assert low.max() <= 20
    assert high.min() >= 80


def test_a_wrist_bends_either_way_while_the_forearm_may_be_turned() -> None:
    postures = posture(COUNT, right_wrist_flexion=30.0, left_wrist_flexion=30.0)
    observed = np.ones_like(postures, dtype=bool)
    observed[:, INDEX["right_forearm_pronation"]] = False
    low, high = (np.degrees(each) for each in ends_of(postures, observed))
    flexion, deviation = INDEX["right_wrist_flexion"], INDEX["right_wrist_deviation"]
    assert low[0, flexion] < 10
    assert high[0, flexion] == pytest.approx(30, abs=0.1)
    assert low[0, deviation] == pytest.approx(-25, abs=2)
    assert high[0, deviation] == pytest.approx(30, abs=2)
    left = INDEX["left_wrist_flexion"]
    assert low[0, left] == high[0, left] == pytest.approx(30)


def test_a_doubtful_arm_points_within_its_cone() -> None:
    postures = posture(
        COUNT, right_shoulder_flexion=60.0, right_shoulder_abduction=50.0, right_elbow_flexion=60.0
    )
    off = np.full(COUNT, np.radians(5.0))
    observed = np.ones_like(postures, dtype=bool)
    low, high = (
        np.degrees(each)
        for each in ends_of(postures, observed, doubt=Doubt(arms={"right_upper_arm": off}))
    )
    for joint, wide in (
        ("shoulder_flexion", 7.8),
        ("shoulder_abduction", 5.0),
        ("shoulder_rotation", 5.8),
        ("elbow_flexion", 5.0),
    ):
        place = INDEX[f"right_{joint}"]
        assert (high - low)[0, place] == pytest.approx(2 * wide, abs=0.1)
        assert (high - low)[0, INDEX[f"left_{joint}"]] == 0
    postures[:, INDEX["right_shoulder_abduction"]] = np.radians(90)
    low, high = ends_of(postures, observed, doubt=Doubt(arms={"right_upper_arm": off}))
    flexion = INDEX["right_shoulder_flexion"]
    assert low[0, flexion] == pytest.approx(LOWER[flexion], abs=1e-6)
    assert high[0, flexion] == pytest.approx(UPPER[flexion], abs=1e-6)


def aside_for(seconds: float, flexion: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
    """Ends of the right arm's flexion [deg], which points straight sideways around the middle."""
    away = np.abs(TIME - TIME.mean()) - seconds / 2
    aside = 90 - np.clip(200 * away, 0, 40)
    postures = posture(COUNT, right_shoulder_flexion=flexion, right_shoulder_abduction=aside)
    off = np.full(COUNT, np.radians(4.0))
    doubt = Doubt(arms={"right_upper_arm": off})
    low, high = ends_of(postures, np.ones_like(postures, dtype=bool), doubt=doubt)
    joint = INDEX["right_shoulder_flexion"]
    return np.degrees(low[:, joint]), np.degrees(high[:, joint])


def test_an_arm_that_passes_straight_sideways_has_the_flexion_of_before_and_after() -> None:
    flexion = 10 + 8 * (TIME - TIME.mean())
    near = np.abs(TIME - TIME.mean()) < 0.2
    low, high = aside_for(0.3, flexion)
    assert (low <= flexion).all()
    assert (flexion <= high).all()
    # Where its direction shows it, 20 deg are the most.
    assert (high - flexion)[near].min() > 12
    assert (high - flexion)[near].max() < 21
    assert (flexion - low)[near].min() > 12
    assert (flexion - low)[near].max() < 21
    # What is read there is inside, even if it is unlike before and after, on either side.
    for size in (70.0, -50.0):
        odd = flexion + size * near
        low, high = aside_for(0.3, odd)
        assert (low <= odd + 1e-6).all()
        assert (odd <= high + 1e-6).all()
        assert (low <= flexion).all()
        assert (flexion <= high).all()
        wide = (high - low)[near]
        assert wide.max() < abs(size) + 21


def test_an_arm_that_stays_sideways_has_any_flexion() -> None:
    joint = INDEX["right_shoulder_flexion"]
    for seconds in (3.0, 12.0):
        low, high = aside_for(seconds, 10.0)
        assert low[COUNT // 2] == pytest.approx(np.degrees(LOWER[joint]))
        assert high[COUNT // 2] == pytest.approx(np.degrees(UPPER[joint]))


def scores(recording: Recording) -> reba.Assessment:
    return reba.assess(recording.postures, low=recording.low, high=recording.high)


@pytest.mark.parametrize(
    "walk_", list(people_who_walk()), ids=lambda each: str(each[0]).replace(" ", "_")
)
def test_whether_skeleton_or_person_leans_the_truth_is_inside(
    walk_: tuple[str, Places, np.ndarray],
) -> None:
    _, places, postures = walk_
    recording = fitted(places)
    found, truth = scores(recording), reba.assess(postures).final
    inside = (found.final_low <= truth) & (truth <= found.final_high)
    assert inside[recording.scored].all()


def test_an_unconfirmed_lean_has_both_ends_and_a_stated_one_has_none() -> None:
    places, postures = walking(25.0)
    recording = fitted(places)
    assert "Nothing confirms that" in " ".join(recording.assumptions)
    for joint in (TRUNK, INDEX["right_shoulder_flexion"]):
        wide = np.degrees(recording.high - recording.low)[:, joint]
        assert np.median(wide) == pytest.approx(25, abs=2)
        assert (recording.high[:, joint] >= postures[:, joint] - 0.02).all()
    assert recording.high[:, TRUNK].mean() == pytest.approx(np.radians(25), abs=0.03)
    stated = fitted(places, neutral="vertical")
    assert not {TRUNK, NECK} & set(stated.spans)


def test_a_walk_in_line_needs_no_confirmation() -> None:
    assert not {TRUNK, NECK} & set(fitted(walking()[0]).spans)


def test_a_second_of_standing_upright_shows_that_the_person_stoops() -> None:
    places, postures = walking(25.0)
    stood = posture(int(2 * RATE), arms_elbow_flexion=20.0)
    still = whole(np.tile([0.0, 0.0, 0.88, 0.0], (len(stood), 1)), stood)
    both = {name: np.concatenate([still[name], path]) for name, path in places.items()}
    recording = fitted(both)
    assert TRUNK not in recording.spans
    found = np.degrees(recording.postures[len(stood) :, TRUNK])
    np.testing.assert_allclose(found, np.degrees(postures[:, TRUNK]), atol=1)
    assert "the person is taken to be straight" in " ".join(recording.assumptions)


def test_two_that_agree_confirm_that_the_skeleton_leans() -> None:
    upright, postures = walking()
    places, _ = with_t_pose(upright, postures, 0.0)
    recording = fitted(leaning(places, 12.0))
    assert TRUNK not in recording.spans
    assert np.degrees(np.abs(recording.postures[int(RATE) :, TRUNK])).max() < 1


def test_the_neck_has_no_zero_without_an_upright_moment() -> None:
    postures = posture(COUNT, trunk_flexion=30.0, neck_flexion=25.0, legs_knee_flexion=40.0)
    places = whole(np.tile([0.0, 0.0, 0.8, 0.0], (COUNT, 1)), postures)
    recording = fitted(places)
    assert np.degrees(recording.low[:, NECK]).max() < 1
    assert np.degrees(recording.high[:, NECK]).min() > 24
    assert "its zero may be there, too" in " ".join(recording.assumptions)
    assert TRUNK not in recording.spans


@pytest.mark.parametrize("elbow", [10.0, 60.0, 120.0])
def test_an_arm_that_hangs_is_never_read_as_raised_over_the_side(elbow: float) -> None:
    # A forearm that is turned inward behind the body needs a rotation beyond its range.
    for rotation in (-150.0, -120.0, 120.0, 150.0):
        postures = posture(
            30,
            arms_shoulder_flexion=-6.0,
            arms_shoulder_abduction=10.0,
            arms_shoulder_rotation=rotation,
            arms_elbow_flexion=elbow,
        )
        places = whole(np.tile([0.0, 0.0, 0.9, 0.0], (30, 1)), postures)
        recording = fitted(places, neutral="vertical")
        for side in SIDES:
            found = np.degrees(recording.postures[:, INDEX[f"{side}_shoulder_flexion"]])
            assert np.abs(found + 6).max() < 1


def test_a_forearm_that_is_always_turned_beyond_its_range_is_not_seen() -> None:
    postures = swinging()
    places = whole(np.tile([0.0, 0.0, 0.9, 0.0], (COUNT, 1)), postures)
    pronation = INDEX["right_forearm_pronation"]
    assert pronation not in fitted(places, neutral="vertical").spans
    # Thumb and small finger are exchanged.
    places["right_thumb"] = 2 * places["right_wrist"] - places["right_thumb"]
    recording = fitted(places, neutral="vertical")
    assert not recording.observed[:, pronation].any()
    assert (recording.high - recording.low)[:, pronation].min() > np.radians(169)
    assert recording.observed[:, INDEX["left_forearm_pronation"]].all()


def test_a_straight_arm_does_not_show_how_it_is_rotated() -> None:
    for elbow, seen in ((4.0, False), (18.0, False), (22.0, True)):
        postures = posture(COUNT, arms_shoulder_rotation=50.0, arms_elbow_flexion=elbow)
        places = whole(np.tile([0.0, 0.0, 0.9, 0.0], (COUNT, 1)), postures)
        recording = fitted(places, neutral="vertical")
        rotation = INDEX["right_shoulder_rotation"]
        assert recording.observed[:, rotation].all() == seen
        truth, found = reba.assess(postures), scores(recording)
        for side in SIDES:
            name = f"{side}_upper_arm"
            assert (found.segments_low[name] <= truth.segments[name]).all()
            assert (truth.segments[name] <= found.segments_high[name]).all()


def test_what_is_hidden_by_its_own_posture_is_not_near() -> None:
    # A quiet stand with quick squats, in which the legs are lost while they are bent.
    share = np.maximum(0.0, np.sin(np.pi * ((TIME % 3.0) - 1.0))) * ((TIME % 3.0) > 1.0)
    share *= (TIME % 3.0) < 2.0
    postures = posture(COUNT, legs_knee_flexion=5 + 90 * share, legs_hip_flexion=5 + 70 * share)
    places = whole(np.tile([0.0, 0.0, 0.9, 0.0], (COUNT, 1)), postures)
    hidden = postures[:, INDEX["right_knee_flexion"]] > np.radians(25)
    for name in places:
        if name.endswith(("knee", "ankle", "toe")):
            places[name][hidden] = np.nan
    recording = fitted(places, neutral="vertical")
    truth, found = reba.assess(postures).final, scores(recording)
    assert (truth <= found.final_high).all()
    assert (found.final_low <= truth).all()
    assert (found.final_low == found.final_high)[~hidden].all()


def test_without_hips_the_twist_is_not_seen() -> None:
    postures = posture(COUNT, trunk_twist=30.0)
    places = whole(np.tile([0.0, 0.0, 0.9, 0.0], (COUNT, 1)), postures)
    without = {name: path for name, path in places.items() if not name.endswith("hip")}
    recording = fitted(without, neutral="vertical", up="z")
    assert not recording.observed[:, INDEX["trunk_twist"]].any()
    assert (scores(recording).segments_high["trunk"] >= 2).all()
    assert fitted(places, neutral="vertical").observed[:, INDEX["trunk_twist"]].all()


def test_a_neck_that_is_lost_is_not_the_middle_of_the_shoulders() -> None:
    places, _ = walking()
    places["neck"][100:200] = np.nan
    recording = fitted(places)
    assert not recording.observed[100:200, NECK].any()
    assert recording.observed[:100, NECK].all()


def test_a_neck_that_is_lost_for_a_whole_block_is_none_either(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("ergoqp.mocap.fitting.posture._BLOCK", 60)
    monkeypatch.setattr("ergoqp.mocap.fitting.posture._AROUND", 0.1)
    places, _ = walking()
    places["neck"][100:300] = np.nan
    assert not fitted(places).observed[100:300, NECK].any()


def test_spine_and_shoulders_are_never_rigid() -> None:
    # A stand for most of the take, then a stoop in which hips and neck come nearer.
    still = posture(COUNT)
    bent = posture(200, trunk_flexion=60.0)
    places = whole(np.tile([0.0, 0.0, 0.9, 0.0], (COUNT + 200, 1)), np.concatenate([still, bent]))
    for name, path in places.items():
        if not name.endswith(("hip", "knee", "ankle", "toe", "pelvis")):
            path[COUNT:] -= 0.08 * (places["neck"] - places["pelvis"])[COUNT:]
    for side in SIDES:
        for name in ("shoulder", "elbow", "wrist", "knuckles", "thumb"):
            places[f"{side}_{name}"][COUNT:, 2] += 0.04
    recording = fitted(places, neutral="vertical")
    assert recording.scored.all()
    assert not recording.doubts


def test_frames_with_a_lost_limb_are_scored_and_not_whole() -> None:
    places, _ = walking()
    places["right_elbow"][50:120] = np.nan
    recording = fitted(places)
    assert recording.scored.all()
    np.testing.assert_array_equal(np.flatnonzero(~recording.whole), np.arange(50, 120))
    places["left_elbow"][:50] = np.nan
    places["left_elbow"][120:] = np.nan
    assert fitted(places).whole.all()


def test_without_legs_a_squat_is_not_ideal() -> None:
    postures = posture(60, legs_knee_flexion=90.0, legs_hip_flexion=90.0, trunk_flexion=10.0)
    places = whole(np.tile([0.0, 0.0, 0.5, 0.0], (60, 1)), postures)
    seen = {name: p for name, p in places.items() if not name.endswith(("knee", "ankle", "toe"))}
    recording = fitted(seen, neutral="vertical")
    found = scores(recording)
    assert (found.segments_low["legs"] == 1).all()
    assert (found.segments_high["legs"] == 3).all()
    assert (found.final_high >= reba.assess(postures).final).all()
    # Ankles and toes without a knee say nothing of it, and reject nothing.
    kneeless = {name: path for name, path in places.items() if not name.endswith("knee")}
    assert not fitted(kneeless, neutral="vertical").doubts
