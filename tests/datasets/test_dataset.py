"""Balanced postures: truly of their score, reproducible, and of the law that plain rejection
has."""

import numpy as np
import pytest

from ergoqp import reba
from ergoqp.datasets.postures import balanced_postures
from ergoqp.errors import InputError
from ergoqp.joints import INDEX, LOWER, SIDES, UPPER
from ergoqp.sheets.options import sheet_of


def rejected(count, rng):
    """Return postures drawn joint by joint from random bands, and their scores: the plain way."""
    postures = rng.uniform(LOWER, UPPER, (count, 32))
    for segment in sheet_of(reba.Method()).segments.values():
        for step in segment.steps:
            for side in SIDES if segment.worse_side else segment.sides:
                joint = segment.joint(step, side)
                inside = [edge for edge in step.edges if LOWER[joint] < edge < UPPER[joint]]
                ends = np.array([LOWER[joint], *inside, UPPER[joint]])
                band = rng.integers(len(ends) - 1, size=count)
                postures[:, joint] = rng.uniform(ends[band], ends[band + 1])
    return postures, reba.assess(postures).final


def test_equally_many_of_each_score_and_within_range():
    postures, scores = balanced_postures(300, np.random.default_rng(0))
    result = reba.assess(postures)
    np.testing.assert_array_equal(result.final, scores)
    assert np.bincount(scores).tolist() == [0] + [300] * 10
    assert not result.outside.any()
    assert (np.diff(scores) != 0).mean() > 0.5, "in random order"


def test_same_seed_same_postures():
    one, other, third = (balanced_postures(5, np.random.default_rng(seed))[0] for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, other)
    assert (one != third).any()


@pytest.mark.slow
@pytest.mark.parametrize("score", [5, 7, 9])
def test_has_the_law_of_rejection(score):
    rng = np.random.default_rng(3)
    postures, scores = rejected(400_000, rng)
    kept = postures[scores == score]
    drawn, _ = balanced_postures(len(kept), rng, scores=[score])
    # Two samples of one law: every joint's distribution, and that of every pair's products, agrees
    # within its noise.
    for joint in range(32):
        levels = np.quantile(kept[:, joint], np.linspace(0.05, 0.95, 19))
        shares = [np.mean(sample[:, [joint]] <= levels, axis=0) for sample in (kept, drawn)]
        assert np.abs(shares[0] - shares[1]).max() < 4.5 * np.sqrt(0.5 / len(kept))
    for one, other in [
        ("trunk_flexion", "neck_flexion"),
        ("right_elbow_flexion", "left_shoulder_flexion"),
    ]:
        products = [
            np.abs(sample[:, INDEX[one]] * sample[:, INDEX[other]]) for sample in (kept, drawn)
        ]
        error = np.hypot(*(p.std() / np.sqrt(len(p)) for p in products))
        assert abs(products[0].mean() - products[1].mean()) < 4.5 * error


def test_options_and_method_count():
    method = reba.Method(arms="segments", additive=True)
    options = {"activity": 2, "seated": True, "load_kg": 7.0, "arm_supported": (True, False)}
    postures, scores = balanced_postures(
        40, np.random.default_rng(0), method, scores=(4, 8, 12), **options
    )
    np.testing.assert_array_equal(reba.assess(postures, method, **options).final, scores)
    assert sorted(set(scores)) == [4, 8, 12]


def test_joints_that_are_not_drawn_are_zero():
    joints = (
        "trunk_flexion",
        "neck_flexion",
        "right_shoulder_flexion",
        "left_elbow_flexion",
        "right_hip_flexion",
    )
    postures, scores = balanced_postures(
        100, np.random.default_rng(0), scores=(1, 3, 5), joints=joints
    )
    drawn = [INDEX[joint] for joint in joints]
    assert (np.delete(postures, drawn, axis=1) == 0).all()
    assert (postures[:, drawn].std(axis=0) > 0.1).all()
    np.testing.assert_array_equal(reba.assess(postures).final, scores)


def test_a_zero_on_a_band_end_is_scored_as_the_sheet_scores_it():
    # With no tolerance the trunk is upright at exactly 0 deg only, and a neck at 0 deg is on the
    # end of its band.
    for band_ends in ("lower", "higher"):
        method = reba.Method(trunk_upright_deg=0.0, neck_extension_deg=0.0, band_ends=band_ends)
        joints = ["right_shoulder_flexion", "right_knee_flexion"]
        postures, scores = balanced_postures(
            50, np.random.default_rng(0), method, scores=(2, 3), joints=joints
        )
        np.testing.assert_array_equal(reba.assess(postures, method).final, scores)


def test_unreachable_scores_are_named():
    with pytest.raises(InputError, match=r"scores: got 1, allowed under these options: 4, 5, .*14"):
        balanced_postures(1, np.random.default_rng(0), activity=3)
    with pytest.raises(InputError, match=r"scores: got 9, allowed under these options: 1, 2$"):
        balanced_postures(1, np.random.default_rng(0), scores=[9], joints=["trunk_flexion"])
    with pytest.raises(InputError, match="joints: got 'tail_flexion', allowed names of"):
        balanced_postures(1, np.random.default_rng(0), joints=["tail_flexion"])
    with pytest.raises(InputError, match="per_score: got 0"):
        balanced_postures(0, np.random.default_rng(0))
    with pytest.raises(InputError, match="scores: got none"):
        balanced_postures(1, np.random.default_rng(0), scores=())
