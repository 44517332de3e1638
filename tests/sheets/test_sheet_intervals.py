"""The lowest and highest score of all postures between two, and what is said of them."""

import numpy as np
import pytest
from sheet_postures import posture, random_postures

from ergoqp import JOINTS, reba
from ergoqp.errors import InputError
from ergoqp.joints import INDEX, LOWER, SIDES, UPPER
from ergoqp.sheets.angles import read_postures
from ergoqp.sheets.assessment import assess_rows
from ergoqp.sheets.options import read_task, sheet_of

METHODS = [
    reba.Method(),
    reba.Method(arms="segments", additive=True, band_ends="higher"),
    reba.Method(adduction=True, trunk_extension="capped", final_max=12),
]


def boxes(count, seed=0):
    """Return lower and upper ends of which about half the joints are known."""
    rng = np.random.default_rng(seed)
    low = random_postures(count, seed)
    wide = rng.uniform(0, np.radians(60), (count, 32)) * rng.integers(0, 2, (count, 32))
    return low, np.minimum(low + wide, UPPER)


@pytest.mark.parametrize("method", METHODS, ids=["default", "segments", "adduction"])
def test_no_posture_between_scores_beyond_and_both_ends_are_reached(method):
    low, high = boxes(60)
    task = {"load_kg": 6.0, "coupling": 1}
    found = reba.assess((low + high) / 2, method, low=low, high=high, **task)
    edges = np.array(sorted({edge for step in steps(method) for edge in step.edges}))
    rng, least, most = np.random.default_rng(1), np.full(60, 99), np.zeros(60, dtype=int)
    tries = np.concatenate([edges, edges + 1e-6, edges - 1e-6])
    for _ in range(1500):
        inside = np.clip(rng.choice(tries, (60, 32)), low, high)
        way = rng.integers(0, 4, (60, 32))
        tried = np.choose(way, [low, high, rng.uniform(low, high), inside])
        final = reba.assess(tried, method, **task).final
        least, most = np.minimum(least, final), np.maximum(most, final)
    assert (least >= found.final_low).all()
    assert (most <= found.final_high).all()
    assert np.mean((least == found.final_low) & (most == found.final_high)) >= 0.95


def steps(method):
    return [step for segment in sheet_of(method).segments.values() for step in segment.steps]


@pytest.mark.parametrize("method", METHODS)
def test_no_joint_counts_in_two_steps(method):
    joints = [
        segment.joint(step, side)
        for segment, side in sheet_of(method).places
        for step in segment.steps
        if not segment.worse_side
    ]
    assert len(set(joints)) == len(joints)


@pytest.mark.parametrize("table", "ABC")
def test_the_tables_are_monotone_along_every_axis(table):
    cells = sheet_of(reba.Method()).tables[table].cells
    assert all((np.diff(cells, axis=axis) >= 0).all() for axis in range(cells.ndim))


def test_segments_and_arms_have_ends_too():
    low, high = boxes(40, seed=3)
    found = reba.assess(low, low=low, high=high)
    rng = np.random.default_rng(2)
    for _ in range(500):
        tried = reba.assess(np.where(rng.random((40, 32)) < 0.5, low, high))
        for name, scores in tried.segments.items():
            assert (found.segments_low[name] <= scores).all()
            assert (scores <= found.segments_high[name]).all()


def test_postures_without_ends_are_their_own():
    postures = random_postures(500)
    plain, ends = reba.assess(postures), reba.assess(postures, low=postures, high=postures)
    for found in (plain, ends):
        assert (found.final_low == plain.final).all()
        assert (found.final_high == plain.final).all()
    for name, scores in plain.segments.items():
        assert (ends.segments_low[name] == scores).all()
        assert (ends.segments_high[name] == scores).all()


def test_an_elevation_is_never_beyond_its_ends():
    method = reba.Method(upper_arm="elevation")
    low, high = boxes(200, seed=5)
    found = reba.assess((low + high) / 2, method, low=low, high=high)
    rng = np.random.default_rng(6)
    for _ in range(800):
        final = reba.assess(rng.uniform(low, high), method).final
        assert (found.final_low <= final).all()
        assert (final <= found.final_high).all()
    width = (found.final_high - found.final_low).mean()
    plain = reba.assess((low + high) / 2, low=low, high=high)
    assert width <= (plain.final_high - plain.final_low).mean() + 0.5


def test_an_unknown_angle_is_anywhere_in_its_range():
    known = posture(trunk_flexion=30.0)
    lost = known.copy()
    knees = [INDEX[f"{side}_knee_flexion"] for side in SIDES]
    lost[knees] = np.nan
    found = reba.assess(known, low=lost, high=lost)
    low, high = known.copy(), known.copy()
    low[knees], high[knees] = LOWER[knees], UPPER[knees]
    stated = reba.assess(known, low=low, high=high)
    assert found.final.tolist() == reba.assess(known).final.tolist()
    assert (found.final_low[0], found.final_high[0]) == (stated.final_low[0], stated.final_high[0])
    assert found.segments_low["legs"][0] == 1
    assert found.segments_high["legs"][0] == 3


def test_a_posture_with_an_unknown_angle_has_ends_and_no_score():
    lost = posture(trunk_flexion=30.0)
    lost[INDEX["neck_twist"]] = np.nan
    found = reba.assess(lost, low=lost, high=lost)
    assert found.final.tolist() == [0]
    assert 1 <= found.final_low[0] < found.final_high[0]
    assert reba.assess(lost).final_high.tolist() == [0]


def test_reasons_name_what_is_not_known():
    known = posture(trunk_flexion=30.0, right_shoulder_flexion=40.0)
    low, high = known.copy(), known.copy()
    low[INDEX["right_knee_flexion"]] = high[INDEX["right_knee_flexion"]] = np.nan
    low[INDEX["right_shoulder_flexion"]] -= np.radians(15)
    high[INDEX["right_shoulder_flexion"]] += np.radians(10)
    found = reba.assess(known, low=low, high=high)
    said = found.reasons(0)
    assert "legs 1 to 3: right knee flexion not known" in said
    assert "right upper arm 2 to 3: right shoulder flexion 25 to 50 deg" in said
    span = f"{found.final_low[0]} to {found.final_high[0]}"
    assert f"REBA {span}; for the likeliest posture:" in said
    assert not any("not known" in each for each in reba.assess(known).reasons(0))


@pytest.mark.parametrize(
    ("spans", "task", "words"),
    [
        (
            {"right_knee_flexion": (38, 30.1, 47.3)},
            {},
            "legs, right knee 30.1 to 47 deg flexion, 30 to 60: 2",
        ),
        # The left knee decides, although the right one is bent as much.
        (
            {"right_knee_flexion": (40, 20, 45), "left_knee_flexion": (40, 38, 50)},
            {},
            "legs, left knee 38 to 50 deg flexion, 30 to 60: 2",
        ),
        ({"neck_flexion": (2, -3, 12)}, {}, "neck 3 deg extension to 12 deg flexion, 5 extension"),
        ({"trunk_flexion": (-10, -15, -7)}, {}, "trunk 7 to 15 deg extension, 5 to 20: 2"),
        ({"trunk_flexion": (10, 9.9, 10.2)}, {}, "trunk 10 deg flexion, 5 to 20: 2"),
        ({"trunk_twist": (20, 15, 30)}, {}, "within 5: 1; twisted left 15 to 30 deg: +1"),
        (
            {"trunk_twist": (20, 15, 30), "trunk_side_bend": (0, -20, 20)},
            {},
            "within 5: 1; twisted left 15 to 30 deg: +1",
        ),
        (
            {"right_shoulder_flexion": (15, 10, 30)},
            {"arm_supported": (True, False)},
            "right upper arm, right shoulder flexion 10 to 30 deg: 1 to 2; arm supported: -1;"
            " at least 1",
        ),
        (
            {
                "right_shoulder_flexion": (100, 95, 110),
                "right_shoulder_abduction": (40, 35, 50),
                "right_shoulder_rotation": (0, -60, 60),
            },
            {"shoulder_raised": (True, False)},
            "right upper arm 95 to 110 deg flexion, over 90: 4; abducted 35 to 50 deg: +1;"
            " shoulder raised: +1",
        ),
        (
            {
                "neck_flexion": (30, 25, 40),
                "neck_twist": (30, 0, 40),
                "neck_side_bend": (30, 30, 30),
            },
            {"method": reba.Method(additive=True)},
            "neck 25 to 40 deg flexion, over 20: 2; bent to the left 30 deg: +1;"
            " neck twist 0 to 40 deg: +0 to +1; at most 3",
        ),
    ],
)
def test_reasons_give_the_range_of_an_angle_that_scores_the_same_in_all_of_it(spans, task, words):
    given = {joint: known for joint, (known, _, _) in spans.items()}
    lower = {joint: low for joint, (_, low, _) in spans.items()}
    upper = {joint: high for joint, (_, _, high) in spans.items()}
    found = reba.assess(posture(**given), low=posture(**lower), high=posture(**upper), **task)
    assert any(words in each for each in found.reasons(0)), found.reasons(0)


@pytest.mark.parametrize("kinds", [(float, np.float32), (np.float32, float)])
def test_an_end_that_is_the_posture_but_for_rounding_is_the_posture(kinds):
    postures = random_postures(300, seed=2)
    known, ends = (postures.astype(kind) for kind in kinds)
    found = reba.assess(known, low=ends, high=ends)
    assert (found.low == found.postures).all()
    assert (found.high == found.postures).all()
    assert (found.final_low == found.final_high).all()


def test_parts_with_gaps_are_refused():
    found = reba.assess(np.zeros((6, 32)))
    assert len(found.rows(slice(0, 5, 1)).final) == 5
    for step in (2, -1):
        with pytest.raises(InputError, match=f"got a slice with step {step}, allowed"):
            found.rows(slice(0, 5, step))


def test_it_is_known_which_arm_counts_unless_either_may():
    raised = posture(right_shoulder_flexion=60, left_shoulder_flexion=100)
    low, high = np.tile(raised, (3, 1)), np.tile(raised, (3, 1))
    high[0, INDEX["right_shoulder_flexion"]] = np.radians(80)
    high[1, INDEX["right_shoulder_flexion"]] = np.radians(160)
    high[1, INDEX["right_shoulder_abduction"]] = np.radians(60)
    low[2, INDEX["left_shoulder_flexion"]] = 0.0
    found = reba.assess(np.tile(raised, (3, 1)), low=low, high=high)
    assert found.arm.tolist() == ["left"] * 3
    assert found.arm_known.tolist() == [True, False, False]
    assert reba.assess(raised).arm_known.all()
    assert reba.assess(np.zeros(32)).arm_known.all()
    named = " ".join(found.costly(1))
    assert "right upper arm" in named
    assert "left upper arm" in named
    assert "right upper arm" not in " ".join(found.costly(0))


def test_what_may_cost_points_is_named_although_the_likeliest_score_is_1():
    known = posture()
    low, high = known.copy(), known.copy()
    for joint in ("right_knee_flexion", "trunk_flexion"):
        low[INDEX[joint]] = high[INDEX[joint]] = np.nan
    found = reba.assess(known, low=low, high=high)
    assert (found.final[0], found.final_high[0] > 1) == (1, True)
    assert found.costly(0)[:2] == [
        "trunk 1 to 4: trunk flexion not known",
        "legs 1 to 3: right knee flexion not known",
    ]
    lost = np.full(32, np.nan)
    assert reba.assess(lost, low=lost, high=lost).costly(0) == []


@pytest.mark.parametrize(
    ("low", "high", "message"),
    [
        (np.zeros((2, 32)), None, r"low: got shape \(2, 32\), allowed: that of postures"),
        (None, np.full((1, 32), -1e-5), f"low, high: row 0, {JOINTS[0]}: got low"),
        (np.full((1, 32), 0.1), None, "got low, posture and high of 0.1, 0, 0 rad"),
        ("x", None, "^low: got no array of numbers"),
        (None, np.zeros((1, 31)), r"^high: got shape \(1, 31\)"),
        (None, np.full((1, 32), 4.0), "^high: row 0, .*degrees given as radians"),
        (np.full((1, 32), -40.0), None, "^low: row 0, .*degrees given as radians"),
    ],
)
def test_ends_that_are_none_are_refused(low, high, message):
    with pytest.raises(InputError, match=message):
        reba.assess(np.zeros((1, 32)), low=low, high=high)


def test_a_part_of_an_assessment_is_the_assessment_of_a_part():
    low, high = boxes(40, seed=5)
    postures = (low + high) / 2
    low[7] = high[7] = np.nan
    loads = np.linspace(0, 12, 40)
    whole = reba.assess(postures, low=low, high=high, load_kg=loads)
    rows = slice(5, 20)
    own = reba.assess(postures[rows], low=low[rows], high=high[rows], load_kg=loads[rows])
    for found in (whole.rows(rows), whole.rows(slice(2, 30)).rows(slice(3, 18))):
        for name in ("final", "final_low", "final_high", "valid", "band", "low", "high"):
            np.testing.assert_array_equal(getattr(found, name), getattr(own, name))
        for name in ("segments", "segments_low", "segments_high"):
            for label, scores in getattr(own, name).items():
                np.testing.assert_array_equal(getattr(found, name)[label], scores)
        assert found.reasons(2) == own.reasons(2) == whole.reasons(7)


def test_postures_that_are_not_scored_count_as_invalid():
    postures = read_postures(random_postures(5000, 7))
    scored = np.arange(5000) % 3 > 0
    method = reba.Method()
    task = read_task(sheet_of(method), len(postures), {})
    found = assess_rows(postures, method, task, None, scored)
    assert (found.valid == scored).all()
    assert (found.final == np.where(scored, reba.assess(postures).final, 0)).all()
    assert not found.segments["neck"][0]
    assert found.reasons(0) == ["not scored"]
    assert scored[found.worst()]


def test_the_worst_of_several_blocks_is_the_one_that_is_held_longest():
    postures = np.zeros((5000, 32))
    bent = posture(trunk_flexion=70.0, neck_flexion=30.0)
    postures[100] = postures[3000:3006] = postures[4500:4503] = bent
    assert reba.assess(postures).worst() == 3000


def test_what_is_masked_is_unknown() -> None:
    hidden = np.ma.array(np.zeros(len(JOINTS)), mask=True)
    found = reba.assess(np.zeros(len(JOINTS)), low=hidden, high=hidden)
    unknown = np.full(len(JOINTS), np.nan)
    assert (
        found.final_high == reba.assess(np.zeros(len(JOINTS)), low=unknown, high=unknown).final_high
    )
    assert not reba.assess(hidden).valid.any()
