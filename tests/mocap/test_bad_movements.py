"""Movements that are broken: one clear sentence, or a partial result that says what it lacks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.made_motions import BODY, Places, fitted, posture, stoop, walk
from benchmarks.recording_outcomes import Case, cases, known, outside, seen
from ergoqp import reba
from ergoqp.errors import ErgoqpError, RecordingError
from ergoqp.joints import INDEX, SIDES
from ergoqp.mocap import fit_postures
from ergoqp.mocap.load import ReadOptions, recording_of
from ergoqp.mocap.naming import centres_of
from ergoqp.mocap.recording import JointMotion


@pytest.fixture
def work() -> Places:
    walked, stooped = walk()[0], stoop()[0]
    return {centre: np.concatenate([walked[centre], stooped[centre]]) for centre in walked}


def lost(places: Places, share: float, whole: bool) -> Places:
    """Lose a share of the frames, or of the points."""
    generator = np.random.default_rng(4)
    count = len(places["neck"])
    frames = generator.random(count) < share
    for path in places.values():
        path[frames if whole else generator.random(count) < share] = np.nan
    return places


def test_frames_that_are_missing_are_near_those_around(work: Places) -> None:
    plain = fitted(work)
    for share, least in ((0.1, 0.9), (0.6, 0.3)):
        recording = fitted(lost({c: path.copy() for c, path in work.items()}, share, True))
        assert known(recording).mean() > least
        off = np.abs(recording.postures - plain.postures)[known(recording)]
        assert np.degrees(np.median(off.max(axis=1))) < 3
        assert outside(recording, plain.postures).max() < 2
        assert np.isnan(recording.fit_error).mean() == pytest.approx(share, abs=0.05)
        assert "a joint is not seen that is seen at other times" in " ".join(recording.assumptions)


def test_points_that_are_missing(work: Places) -> None:
    plain = fitted(work)
    recording = fitted(lost(work, 0.1, False))
    assert known(recording).mean() > 0.9
    trunk = [INDEX["trunk_flexion"], INDEX["right_shoulder_flexion"], INDEX["left_elbow_flexion"]]
    off = np.degrees(np.abs(recording.postures - plain.postures))[:, trunk]
    assert np.percentile(off[known(recording)], 99) < 5


def test_too_little_is_not_known(work: Places) -> None:
    plain = fitted({centre: path.copy() for centre, path in work.items()})
    recording = fitted(lost(work, 0.6, False))
    assert known(recording).mean() < 0.1
    assert recording.scored.all()
    assert np.mean(outside(recording, plain.postures) > 12) < 0.01


def test_a_trunk_that_is_lost_for_more_than_a_second_is_not_scored(work: Places) -> None:
    for path in work.values():
        path[100:250] = np.nan
    recording = fitted(work)
    # At 60 Hz: a second from the last and from the next that is seen.
    lost = np.zeros(600, dtype=bool)
    lost[160:191] = True
    np.testing.assert_array_equal(recording.scored, ~lost)
    assert not known(recording)[110:240].any()
    assert (reba.assess(recording.scored_postures).final[lost] == 0).all()
    said = "31 of 600 frames are not scored: trunk not seen 31"
    assert said in " ".join(recording.assumptions)


def test_in_a_short_gap_an_angle_is_between_those_around(work: Places) -> None:
    # A wrist that is lost for 0.15 s: the elbow is bent by 25 degrees before and 45 after.
    elbow = INDEX["right_elbow_flexion"]
    for bend in (30.0, 45.0):
        postures = posture(120, arms_elbow_flexion=25.0)
        postures[60:, elbow] = np.radians(bend)
        places = centres_of(BODY, np.tile([0, 0, 0.9, 0], (120, 1)), postures)
        places["right_wrist"][56:65] = np.nan
        recording = fitted(places, neutral="vertical")
        assert (recording.low[56:65, elbow] <= np.radians(25.01)).all()
        assert (recording.high[56:65, elbow] >= np.radians(bend - 0.01)).all()
        assert outside(recording, postures).max() < 0.1
        np.testing.assert_array_equal(recording.low[:56, elbow], recording.postures[:56, elbow])


def test_parts_of_a_person(work: Places) -> None:
    def without(*ends: str) -> Places:
        return {centre: path for centre, path in work.items() if not centre.endswith(ends)}

    assert known(fitted(without("knee", "ankle", "toe"))).all()
    armless = fitted(without("elbow", "wrist", "knuckles", "thumb"))
    assert armless.scored.all()
    assessment = reba.assess(armless.postures, low=armless.low, high=armless.high)
    assert (assessment.segments_low["upper_arm"] == 1).all()
    assert (assessment.segments_high["upper_arm"] == 5).all()
    one = fitted(without("left_elbow", "left_wrist"))
    assert one.scored.all()
    assert "Never seen, and anywhere in their ranges" in " ".join(one.assumptions)
    with pytest.raises(RecordingError, match="the upper trunk cannot be placed"):
        fitted({c: path for c, path in work.items() if c.endswith(("hip", "knee", "ankle"))})


@pytest.mark.parametrize("gone", [True, False])
def test_one_hip_and_the_pelvis_are_hips(gone: bool, work: Places) -> None:
    plain = fitted(work)
    if gone:
        del work["left_hip"]
    else:
        work["left_hip"][:] = np.nan
    recording = fitted(work)
    assert known(recording).mean() > 0.95
    assert "In 600 frames the left hip is not seen" in " ".join(recording.assumptions)
    trunk = INDEX["trunk_flexion"]
    np.testing.assert_allclose(
        recording.postures[:, trunk], plain.postures[:, trunk], atol=np.radians(6)
    )


@pytest.mark.parametrize("how", ["names", "axis"])
def test_exchanged_sides_are_told(how: str, work: Places) -> None:
    other = {"right": "left", "left": "right"}
    if how == "names":
        wrong = {
            f"{other[c.split('_')[0]]}_{c.split('_', 1)[1]}"
            if "_" in c and "head" not in c
            else c: p
            for c, p in work.items()
        }
    else:
        wrong = {centre: path * [1, -1, 1] for centre, path in work.items()}
    with pytest.raises(RecordingError, match="left and right are exchanged, or an axis is mirror"):
        fitted(wrong)


def test_wrists_that_are_exchanged_are_not_scored_where_it_shows(work: Places) -> None:
    work["left_wrist"], work["right_wrist"] = work["right_wrist"], work["left_wrist"]
    recording = fitted(work)
    assert seen(recording).mean() < 0.6
    assert "right wrist off by more than 0.2 m" in recording.doubts


def test_a_point_that_jumps_is_not_scored(work: Places) -> None:
    plain = fitted({centre: path.copy() for centre, path in work.items()})
    work["right_elbow"][50:60] += 0.5
    recording = fitted(work)
    np.testing.assert_array_equal(np.flatnonzero(~seen(recording)), np.arange(50, 60))
    assert recording.doubts["right upper arm of unusual length"][55]
    assert outside(recording, plain.postures).max() < 2


def test_nobody_lies_at_work(work: Places) -> None:
    lying = {centre: path[:, [2, 1, 0]] * [1, 1, -1] for centre, path in work.items()}
    recording = fitted(lying)
    assert not known(recording).any()


@pytest.mark.parametrize("factor", [0.0, np.nan, 1000.0, 1e-3])
def test_nothing_of_a_persons_size(factor: float, work: Places) -> None:
    with pytest.raises(ErgoqpError, match="positions: "):
        fitted({centre: factor * path for centre, path in work.items()})


@pytest.mark.parametrize(
    ("joint", "scored", "lost", "cause"),
    [
        ("trunk_flexion", -47.0, -54.0, "trunk beyond its range"),
        ("neck_flexion", 77.0, 84.0, "neck beyond its range"),
        ("right_shoulder_flexion", -77.0, -85.0, "right upper arm beyond its range"),
        ("left_elbow_flexion", 167.0, 174.0, "left elbow beyond its range"),
        ("right_knee_flexion", 162.0, 169.0, "right knee beyond its range"),
    ],
)
def test_who_bends_beyond_what_anybody_can_is_not_scored(
    joint: str, scored: float, lost: float, cause: str
) -> None:
    for angle, beyond in ((scored, False), (lost, True)):
        postures = posture(4, **{joint: angle})
        places = centres_of(BODY, np.tile([0, 0, 0.9, 0], (4, 1)), postures)
        doubts = fitted(places, neutral="vertical").doubts
        # What hangs from a trunk beyond its range is elsewhere, too.
        assert (cause in doubts) == beyond
        assert any("range" in each for each in doubts) == beyond


def test_a_bone_that_is_longer_for_a_while_is_not_scored(work: Places) -> None:
    for share, expected in ((1.012, 0), (1.04, 20)):
        places = {centre: path.copy() for centre, path in work.items()}
        knee, ankle = places["left_knee"], places["left_ankle"]
        ankle[30:50] = knee[30:50] + share * (ankle - knee)[30:50]
        recording = fitted(places)
        stretched = recording.doubts.get("left shank of unusual length", np.zeros(600, bool))
        assert stretched.sum() == expected


def test_a_leap_and_back_is_not_scored_and_a_cut_is(work: Places) -> None:
    # Along the shank's own circle: its length does not tell.
    knee, ankle = work["left_knee"].copy(), work["left_ankle"].copy()
    turned = np.stack([np.cos(0.5), 0, np.sin(0.5), 0, 1, 0, -np.sin(0.5), 0, np.cos(0.5)])
    aside = (ankle - knee) @ turned.reshape(3, 3)
    work["left_ankle"][400:405] = (knee + aside)[400:405]
    recording = fitted(work)
    np.testing.assert_array_equal(np.flatnonzero(~seen(recording)), np.arange(400, 405))
    assert [cause for cause, frames in recording.doubts.items() if frames[402]] == [
        "left shank jumps"
    ]
    work["left_ankle"][400:] = (knee + aside)[400:]
    assert seen(fitted(work)).all()


def test_keyframes_do_not_leap() -> None:
    # Two postures in turn, eleven frames each, as if nothing had been between.
    limbs = [f"{side}_{joint}_flexion" for side in SIDES for joint in ("elbow", "hip", "knee")]
    postures = posture(60, trunk_flexion=10.0)
    postures[:, [INDEX[joint] for joint in limbs]] = np.radians(20.0)
    other = np.arange(60) // 11 % 2 == 1
    postures[other, INDEX["trunk_flexion"]] = np.radians(50.0)
    postures[np.ix_(other, [INDEX[joint] for joint in limbs])] = np.radians(70.0)
    places = centres_of(BODY, np.tile([0, 0, 0.9, 0], (60, 1)), postures)
    assert known(fitted(places, neutral="vertical")).all()


def test_a_point_that_drifts_is_not_scored_from_where_it_shows(work: Places) -> None:
    share = np.sin(np.linspace(0, np.pi, 60))[:, None]
    work["left_wrist"][200:260] += share * [0.0, 0.2, 0.1]
    recording = fitted(work)
    assert not seen(recording)[210:250].any()
    assert seen(recording)[:200].all()
    assert seen(recording)[260:].all()
    drifts = recording.doubts["left forearm of unusual length"]
    assert drifts[230]
    # Where it begins, the length is off by less than what shows it.
    length = np.linalg.norm(work["left_wrist"] - work["left_elbow"], axis=1)
    off = np.abs(length - np.median(length)) / np.median(length)
    assert off[drifts].min() < 0.0149


def test_a_neck_that_both_shoulders_miss_is_in_a_wrong_place(work: Places) -> None:
    for name in ("head", "head_top"):
        del work[name]
    work["neck"][100:150] += [0.0, 0.0, 0.12]
    recording = fitted(work)
    trunk = INDEX["trunk_flexion"]
    assert recording.doubts["neck out of place"][100:150].all()
    assert not recording.observed[100:150, trunk].any()
    assert recording.observed[:100, trunk].all()


@pytest.mark.parametrize("shrugs", [False, True])
def test_a_neck_far_from_its_place_is_wrong_and_a_shrug_is_not(work: Places, shrugs: bool) -> None:
    # Ahead, where the bones from the neck hardly change their lengths; shoulders go ahead and up.
    if shrugs:
        for side in SIDES:
            for centre in ("shoulder", "elbow", "wrist"):
                work[f"{side}_{centre}"][565:600] += [0.02, 0.0, 0.10]
    else:
        work["neck"][565:600] += [0.09, 0.0, -0.06]
    recording, trunk = fitted(work), INDEX["trunk_flexion"]
    assert ("neck out of place" in recording.doubts) != shrugs
    assert recording.observed[565:, trunk].any() == shrugs
    assert recording.observed[:565, trunk].all()


@pytest.mark.parametrize("centres", [("right_shoulder",), ("head", "head_top")])
def test_a_neck_is_right_if_another_end_is_wrong(work: Places, centres: tuple[str, ...]) -> None:
    for centre in centres:
        work[centre][100:150] += [0.0, 0.0, 0.13]
    recording = fitted(work)
    assert any("of unusual length" in each for each in recording.doubts)
    assert "neck out of place" not in recording.doubts
    assert recording.observed[:360, INDEX["trunk_flexion"]].all()


def test_a_bone_that_always_varies_may_do_so(work: Places) -> None:
    # Between points that are measured a bone varies: 4 % are no other posture there.
    plain = {centre: path.copy() for centre, path in work.items()}
    slowly = np.sin(np.linspace(0, 20, 600))[:, None]
    for places, usual in ((plain, 0.0), (work, 0.08)):
        knee, ankle = places["left_knee"], places["left_ankle"]
        share = 1 + usual * slowly
        share[30:50] = 1.04
        places["left_ankle"] = knee + share * (ankle - knee)
    stretched = "left shank of unusual length"
    assert fitted(plain).doubts[stretched][30:50].all()
    assert seen(fitted(work)).all()


def test_who_moves_fast_does_not_leap() -> None:
    # Hammering, 2.5 blows a second, seen 30 times a second.
    time = np.arange(120) / 30
    elbow = 50 + 30 * np.sin(2 * np.pi * 2.5 * time + 0.3)
    postures = posture(120, right_elbow_flexion=elbow)
    places = centres_of(BODY, np.tile([0, 0, 0.9, 0], (120, 1)), postures)
    positions = np.stack(list(places.values()), axis=1)
    assert fit_postures(list(places), positions, 30.0, neutral="vertical").scored.all()


def test_a_short_bone_turns_by_noise_and_does_not_leap(work: Places) -> None:
    generator = np.random.default_rng(6)
    for name in ("head", "head_top"):
        work[name] = work["neck"] + 0.3 * (work[name] - work["neck"])
    noisy = {c: path + 0.003 * generator.standard_normal(path.shape) for c, path in work.items()}
    assert "neck jumps" not in fitted(noisy, neutral="vertical").doubts


@pytest.mark.parametrize("case", list(cases()), ids=lambda case: case.name)
def test_no_wrong_posture_without_a_word(case: Case, work: Places) -> None:
    # The figure is `wrong_outcomes` of benchmarks.recordings: it is not zero for other seeds.
    wrong, _ = case.wrong(work, fitted(work), 1001)
    assert not wrong


def test_a_body_that_is_nowhere_near_is_not_scored(work: Places) -> None:
    # Someone much smaller than who is stated.
    recording = fitted(work, person=2.2)
    assert "body off by more than 0.1 m" in recording.doubts


@pytest.mark.parametrize("size", [1e12, 1e30, -1e38])
def test_a_coordinate_that_is_no_place(work: Places, size: float) -> None:
    work["right_wrist"][7, 1] = size
    with pytest.raises(
        RecordingError, match=r"got a coordinate of 1e\+.* for 'right_wrist', allow"
    ):
        fitted(work)


def test_columns_in_which_nothing_is_seen(work: Places) -> None:
    plain = fitted({name: path for name, path in work.items() if "knee" not in name})
    for side in SIDES:
        work[f"{side}_knee"][:] = np.nan
    recording = fitted(work, up=None)
    np.testing.assert_allclose(recording.postures, plain.postures, atol=1e-6)
    said = " ".join(recording.assumptions)
    assert "Never seen and left out: right knee, left knee." in said
    for name in ("pelvis", "right_hip", "left_hip"):
        work[name][:] = np.nan
    with pytest.raises(RecordingError, match="the pelvis cannot be placed"):
        fitted(work)


def test_far_from_the_origin_numbers_are_not_exact(work: Places) -> None:
    far = np.stack(list(work.values()), axis=1).astype(np.float32) + np.float32(1e5)
    motion = JointMotion(tuple(work), far, np.arange(len(far)) / 60)
    with pytest.raises(
        RecordingError, match="they are exact to 8 mm only, allowed coordinates with"
    ):
        recording_of(motion, "a", ReadOptions(unit=1.0, up="z"))
    trusting = ReadOptions(unit=1.0, up="z", trust=frozenset({"precision"}))
    trusted = recording_of(motion, "a", trusting)
    assert "exact to 8 mm only; they are used as stated" in " ".join(trusted.assumptions)
    recording_of(replace(motion, positions=far.astype(float)), "a", ReadOptions(unit=1.0, up="z"))
