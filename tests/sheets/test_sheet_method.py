"""Every open point of the standard as a parameter: each changes what it should, and nothing else is
accepted."""

import numpy as np
import pytest
from sheet_postures import random_postures, score

from ergoqp import reba
from ergoqp.errors import InputError

METHODS = [
    ({"band_ends": "higher"}, "neck", {"neck_flexion": 20}, 1, 2),
    ({"additive": True}, "trunk", {"trunk_twist": 20, "trunk_side_bend": 20}, 2, 3),
    (
        {"additive": True},
        "neck",
        {"neck_twist": 20, "neck_side_bend": 20, "neck_flexion": 40},
        3,
        3,
    ),
    (
        {"additive": True},
        "trunk",
        {"trunk_twist": 20, "trunk_side_bend": 20, "trunk_flexion": 70},
        5,
        5,
    ),
    ({"trunk_extension": "capped"}, "trunk", {"trunk_flexion": -25}, 3, 2),
    ({"trunk_extension": "mirrored"}, "trunk", {"trunk_flexion": -70}, 3, 4),
    ({"adduction": True}, "right_upper_arm", {"right_shoulder_abduction": -30}, 1, 2),
    ({"neck_extension_deg": 0.0}, "neck", {"neck_flexion": -3}, 1, 2),
    ({"neck_extension_deg": -10.0}, "neck", {"neck_flexion": 5}, 1, 2),
    ({"neck_flexion_deg": 30}, "neck", {"neck_flexion": 25}, 2, 1),
    ({"neck_twist_deg": 30}, "neck", {"neck_twist": -25}, 2, 1),
    ({"neck_side_bend_deg": 30}, "neck", {"neck_side_bend": 25}, 2, 1),
    ({"trunk_upright_deg": 0}, "trunk", {"trunk_flexion": 1}, 1, 2),
    ({"trunk_upright_deg": 10}, "trunk", {"trunk_flexion": -8}, 2, 1),
    ({"trunk_bent_deg": 30}, "trunk", {"trunk_flexion": 25}, 3, 2),
    ({"trunk_deep_deg": 80}, "trunk", {"trunk_flexion": 70}, 4, 3),
    ({"trunk_twist_deg": 5}, "trunk", {"trunk_twist": 8}, 1, 2),
    ({"trunk_side_bend_deg": 5}, "trunk", {"trunk_side_bend": 8}, 1, 2),
    ({"knee_bent_deg": 40}, "legs", {"left_knee_flexion": 35}, 2, 1),
    ({"knee_deep_deg": 180}, "legs", {"left_knee_flexion": 120}, 3, 2),
    ({"upper_arm_low_deg": 30}, "left_upper_arm", {"left_shoulder_flexion": -25}, 2, 1),
    ({"upper_arm_middle_deg": 60}, "left_upper_arm", {"left_shoulder_flexion": 50}, 3, 2),
    ({"upper_arm_high_deg": 120}, "left_upper_arm", {"left_shoulder_flexion": 100}, 4, 3),
    ({"shoulder_abduction_deg": 45}, "left_upper_arm", {"left_shoulder_abduction": 30}, 2, 1),
    ({"shoulder_rotation_deg": 45}, "left_upper_arm", {"left_shoulder_rotation": 30}, 2, 1),
    ({"elbow_low_deg": 40}, "left_lower_arm", {"left_elbow_flexion": 50}, 2, 1),
    ({"elbow_high_deg": 180}, "left_lower_arm", {"left_elbow_flexion": 120}, 2, 1),
    ({"wrist_flexion_deg": 30}, "left_wrist", {"left_wrist_flexion": 20}, 2, 1),
    ({"wrist_deviation_deg": 30}, "left_wrist", {"left_wrist_deviation": 20}, 2, 1),
    ({"forearm_pronation_deg": 60}, "left_wrist", {"left_forearm_pronation": -50}, 2, 1),
    ({"knees_when_seated": True}, "legs", {"left_knee_flexion": 90, "seated": True}, 1, 3),
    ({"upper_arm": "elevation"}, "left_upper_arm", {"left_shoulder_abduction": 170}, 2, 4),
    # Load and final score, in a posture whose score they move.
    ({"load_ends": "lower"}, "final", {"trunk_flexion": 70, "load_kg": 5}, 3, 2),
    ({"load_ends": "lower"}, "final", {"trunk_flexion": 70, "load_kg": 10}, 3, 3),
    ({"load_ends": "higher"}, "final", {"trunk_flexion": 70, "load_kg": 10}, 3, 4),
    ({"load_ends": "higher"}, "final", {"trunk_flexion": 70, "load_kg": 5}, 3, 3),
    ({"load_low_kg": 8}, "final", {"trunk_flexion": 70, "load_kg": 7}, 3, 2),
    ({"load_low_kg": 0.4}, "final", {"trunk_flexion": 70, "load_kg": 0.5}, 2, 3),
    ({"load_high_kg": 20}, "final", {"trunk_flexion": 70, "load_kg": 15}, 4, 3),
]


@pytest.mark.parametrize(("change", "segment", "angles", "default", "changed"), METHODS)
def test_each_method_option_changes_what_it_should(change, segment, angles, default, changed):
    assert score(segment, **angles) == default
    assert score(segment, reba.Method(**change), **angles) == changed


def test_method_options_of_arms_and_highest_score():
    # Right: upper arm 4, lower arm 1, wrist 1 (table 4); left: 1, 2, 2 (table 2); per segment: 4,
    # 2, 2 (table 6).
    angles = {"right_shoulder_flexion": 100, "right_elbow_flexion": 80, "left_wrist_flexion": 30}
    whole, per_segment = reba.Method(), reba.Method(arms="segments")
    assert [
        score(name, whole, **angles) for name in ("upper_arm", "lower_arm", "wrist", "final")
    ] == [4, 1, 1, 2]
    assert [
        score(name, per_segment, **angles) for name in ("upper_arm", "lower_arm", "wrist", "final")
    ] == [4, 2, 2, 3]
    postures = random_postures(2000)
    finals = [reba.assess(postures, method).final for method in (whole, per_segment)]
    assert (finals[1] >= finals[0]).all()
    assert (finals[1] > finals[0]).any()
    worst = {
        "trunk_flexion": 100,
        "trunk_twist": 30,
        "neck_flexion": 40,
        "neck_twist": 30,
        "right_knee_flexion": 90,
    }
    extremes = {"load_kg": 20, "shock": True, "coupling": 3, "activity": 3}
    assert score("final", whole, **worst, **extremes) == 15
    assert score("final", reba.Method(final_max=12), **worst, **extremes) == 12


def test_every_method_field_is_tested_above():
    covered = {name for change, *_ in METHODS for name in change} | {"arms", "final_max"}
    assert covered == set(reba.Method.__dataclass_fields__)


@pytest.mark.parametrize(
    "change",
    [
        {"band_ends": "upper"},
        {"arms": None},
        {"additive": "yes"},
        {"final_max": 11},
        {"final_max": 14.5},
        {"trunk_bent_deg": 4},
        {"knee_bent_deg": 60},
        {"elbow_low_deg": 120},
        {"load_low_kg": 10},
        {"neck_flexion_deg": -1},
        {"neck_twist_deg": 181},
        {"wrist_flexion_deg": np.nan},
        {"wrist_flexion_deg": "15"},
        {"neck_extension_deg": -20},
        {"upper_arm_low_deg": 50},
        {"upper_arm_high_deg": True},
    ],
)
def test_method_refuses_what_is_out_of_range(change):
    with pytest.raises(InputError, match=rf"Method\..*{next(iter(change))}.*got .*allowed:? "):
        reba.Method(**change)


def test_a_method_of_another_kind_is_refused():
    with pytest.raises(InputError, match=r"method: got 'strict', allowed: a reba\.Method"):
        reba.assess(np.zeros(32), "strict")


@pytest.mark.parametrize(
    ("extension", "scores"),
    [
        (
            "worksheet",
            {-70: 3, -25: 3, -15: 2, -6: 2, -4: 1, 4: 1, 6: 2, 15: 2, 25: 3, 55: 3, 65: 4},
        ),
        ("capped", {-70: 2, -25: 2, -15: 2, -6: 2, -4: 1, 4: 1, 6: 2, 15: 2, 25: 3, 55: 3, 65: 4}),
        (
            "mirrored",
            {-70: 4, -25: 3, -15: 2, -6: 2, -4: 1, 4: 1, 6: 2, 15: 2, 25: 3, 55: 3, 65: 4},
        ),
    ],
)
def test_every_band_of_the_trunk_in_every_reading(extension, scores):
    method = reba.Method(trunk_extension=extension)
    assert {angle: score("trunk", method, trunk_flexion=angle) for angle in scores} == scores
