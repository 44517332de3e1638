"""The score in words: sentences that read well and whose numbers add up."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sheet_postures import posture, random_postures

from ergoqp import reba
from ergoqp.errors import InputError


def test_reasons_read_well():
    result = reba.assess(
        posture(
            neck_flexion=24.4,
            neck_twist=-15,
            right_knee_flexion=20.0,
            left_knee_flexion=30.02,
            left_elbow_flexion=80,
        ),
        load_kg=7.5,
        shock=True,
        one_leg=True,
        coupling=1,
        activity=1,
        arm_supported=(False, True),
    )
    assert result.reasons(0)[:5] == [
        "neck 24 deg flexion, over 20: 2; twisted right 15 deg: +1",
        "trunk 0 deg flexion, within 5: 1",
        "legs, left knee 30.02 deg flexion, 30 to 60: 2; on one leg or unstable: +1",
        "right upper arm 0 deg flexion, within 20: 1",
        "left upper arm 0 deg flexion, within 20: 1; arm supported: -1; at least 1: +1",
    ]
    assert result.reasons(0)[-3:] == [
        "score A: table 5, load of 7.5 kg with shock +2: 7",
        "score B of the right arm: table 1, coupling +1: 2",
        "REBA: table C 7, activity +1: 8, high",
    ]
    assert reba.assess(np.zeros(32), seated=True).reasons(-1)[2] == "legs seated: 1"
    with pytest.raises(InputError, match="got posture 1, allowed: 0 to 0"):
        result.reasons(1)


@given(
    seed=st.integers(0, 10**6),
    additive=st.booleans(),
    arms=st.sampled_from(["whole", "segments"]),
    extension=st.sampled_from(["worksheet", "capped", "mirrored"]),
    flags=st.tuples(*[st.booleans()] * 6),
)
@settings(max_examples=60, deadline=None)
def test_the_numbers_in_the_reasons_add_up(seed, additive, arms, extension, flags):
    shock, seated, one_leg, *pair, raised = flags
    result = reba.assess(
        random_postures(3, seed),
        reba.Method(additive=additive, arms=arms, trunk_extension=extension, final_max=12),
        shock=shock,
        seated=seated,
        one_leg=one_leg,
        activity=2,
        arm_supported=tuple(pair),
        shoulder_raised=(raised, raised),
    )
    for i in range(3):
        sentences = result.reasons(i)
        for name, scores in result.segments.items():
            if name in ("upper_arm", "lower_arm", "wrist"):
                continue
            (sentence,) = (
                s for s in sentences if s.startswith(name.replace("_", " ")) and ": " in s
            )
            assert sum(int(n) for n in re.findall(r": ([+-]?\d+)(?:;|$)", sentence)) == scores[i]
        final = re.fullmatch(
            r"REBA: table C \d+, activity \+2(?:, at most 12)?: (\d+), (.*)", sentences[11]
        )
        assert final is not None
        assert (int(final[1]), final[2]) == (result.final[i], reba.ACTION_LEVELS[result.band[i]])


def test_what_costs_points_is_what_counts():
    degrees = {
        "trunk_flexion": 23,
        "right_elbow_flexion": 80,
        "left_wrist_flexion": 57,
        "right_wrist_flexion": 5,
    }
    found = reba.assess(posture(**degrees), load_kg=7).costly(0)
    assert [sentence.partition(",")[0] for sentence in found] == [
        "trunk 23 deg flexion",
        "left lower arm 0 deg flexion",
        "left wrist 57 deg flexion",
        "load: +1",
    ]
    upright = reba.assess(posture())
    assert upright.final[0] == 1
    assert upright.costly(0) == upright.costly(-1) == []
    with pytest.raises(InputError, match="costly: got posture 1, allowed: 0 to 0"):
        upright.costly(1)


@pytest.mark.parametrize(
    ("angles", "words"),
    [
        ({"trunk_flexion": -30}, "trunk 30 deg extension, over 20: 3"),
        ({"trunk_flexion": -12}, "trunk 12 deg extension, 5 to 20: 2"),
        ({"trunk_flexion": 0}, "trunk 0 deg flexion, within 5: 1"),
        ({"trunk_flexion": 12}, "trunk 12 deg flexion, 5 to 20: 2"),
        ({"trunk_flexion": 70}, "trunk 70 deg flexion, over 60: 4"),
        ({"neck_flexion": -8}, "neck 8 deg extension, over 5: 2"),
        ({"neck_flexion": 3}, "neck 3 deg flexion, 5 extension to 20 flexion: 1"),
        ({"right_elbow_flexion": 30}, "right lower arm 30 deg flexion, under 60: 2"),
        ({"right_elbow_flexion": 80}, "right lower arm 80 deg flexion, 60 to 100: 1"),
        (
            {"trunk_twist": 20, "trunk_side_bend": -20},
            "within 5: 1; twisted left 20 deg and bent to the right 20 deg: +1",
        ),
    ],
)
def test_every_kind_of_band_has_its_words(angles, words):
    assert any(words in sentence for sentence in reba.assess(posture(**angles)).reasons(0))


def test_where_both_count_both_are_told():
    sentences = reba.assess(
        posture(trunk_twist=20, trunk_side_bend=-20), method=reba.Method(additive=True)
    ).reasons(0)
    assert sentences[1].endswith("; twisted left 20 deg: +1; bent to the right 20 deg: +1")


@pytest.mark.parametrize(("worse", "other"), [("right", "left"), ("left", "right")])
def test_of_the_arms_the_one_that_counts_is_named_alone(worse: str, other: str) -> None:
    arms = {f"{worse}_shoulder_flexion": 100.0, f"{other}_shoulder_flexion": 50.0}
    assessment = reba.assess(posture(trunk_flexion=30.0, **arms))
    assert assessment.arm[0] == worse
    assert assessment.segments[f"{other}_upper_arm"][0] > 1
    named = " ".join(assessment.costly(0))
    assert "trunk" in named
    assert f"{worse} upper arm" in named
    assert f"{other} upper arm" not in named
