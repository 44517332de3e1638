"""The lowest and highest score of all postures between two, and what is said of them."""

import numpy as np
import pytest
from sheet_postures import posture, random_postures

from ergoqp import JOINTS, reba
from ergoqp.errors import InputError
from ergoqp.joints import INDEX, LOWER, SIDES, UPPER
from ergoqp.sheets.options import sheet_of

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
    assert f"REBA of the likeliest posture, of {span} that it may be:" in said
    assert not any("not known" in each for each in reba.assess(known).reasons(0))


@pytest.mark.parametrize(
    ("low", "high", "message"),
    [
        (np.zeros((2, 32)), None, r"low: got shape \(2, 32\), allowed: that of postures"),
        (None, np.full((1, 32), -1e-6), f"low, high: row 0, {JOINTS[0]}: got low"),
        (np.full((1, 32), 0.1), None, "got low, posture and high of 0.1, 0, 0 rad"),
        ("x", None, "got no array of numbers"),
        (None, np.full((1, 32), 4.0), "degrees given as radians"),
    ],
)
def test_ends_that_are_none_are_refused(low, high, message):
    with pytest.raises(InputError, match=message):
        reba.assess(np.zeros((1, 32)), low=low, high=high)
