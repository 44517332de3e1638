"""The exact score of postures: against a second, plain reading; at band ends; for bad input."""

import inspect
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sheet_postures import posture, random_postures, score

from ergoqp import JOINTS, reba
from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.errors import InputError
from ergoqp.joints import INDEX, LOWER, SIDES, UPPER
from ergoqp.sheets.options import DEFAULTS, TaskOptions, sheet_of

CELLS = {name: table.cells for name, table in sheet_of(reba.Method()).tables.items()}


def plain_reba(
    angles,
    load=0,
    coupling=0,
    activity=0,
    seated=False,
    one_leg=False,
    supported=(0, 0),
    raised=(0, 0),
):
    """Return REBA of one posture as a worksheet is filled in, one line at a time; `angles` by joint
    name [deg]."""
    a = angles
    flexion = a["neck_flexion"]
    neck = 1 if -5 <= flexion <= 20 else 2
    neck += abs(a["neck_twist"]) > 10 or abs(a["neck_side_bend"]) > 10
    flexion = a["trunk_flexion"]
    trunk = 1 if abs(flexion) <= 5 else 2 if abs(flexion) <= 20 else 3 if flexion <= 60 else 4
    trunk += abs(a["trunk_twist"]) > 10 or abs(a["trunk_side_bend"]) > 10
    knee = max(a["right_knee_flexion"], a["left_knee_flexion"])
    legs = 1 if seated else 1 + one_leg + (knee > 30) + (knee > 60)
    table_b = []
    for i, side in enumerate(SIDES):
        flexion = a[f"{side}_shoulder_flexion"]
        upper = 1 if abs(flexion) <= 20 else 2 if flexion <= 45 else 3 if flexion <= 90 else 4
        upper += a[f"{side}_shoulder_abduction"] > 20 or abs(a[f"{side}_shoulder_rotation"]) > 20
        upper = max(1, upper + raised[i] - supported[i])
        lower = 1 if 60 <= a[f"{side}_elbow_flexion"] <= 100 else 2
        wrist = 1 if abs(a[f"{side}_wrist_flexion"]) <= 15 else 2
        wrist += abs(a[f"{side}_wrist_deviation"]) > 10 or abs(a[f"{side}_forearm_pronation"]) > 45
        table_b.append(CELLS["B"][upper - 1, lower - 1, wrist - 1])
    score_a = CELLS["A"][neck - 1, trunk - 1, legs - 1] + load
    return int(CELLS["C"][score_a - 1, max(table_b) + coupling - 1] + activity)


@pytest.mark.parametrize("seated", [False, True])
def test_agrees_with_a_plain_reading_for_random_postures_and_tasks(seated):
    postures, rng = random_postures(3000), np.random.default_rng(1)
    points = {name: rng.integers(0, 4, 3000) for name in ("coupling", "activity")}
    load = rng.integers(0, 3, 3000)
    flags = rng.random((5, 3000)) < 0.3
    result = reba.assess(
        postures,
        load_kg=np.array([0.0, 7.0, 12.0])[load],
        shock=flags[0],
        seated=seated,
        one_leg=flags[1],
        arm_supported=(flags[2], False),
        shoulder_raised=(flags[3], flags[4]),
        **points,
    )
    expected = [
        plain_reba(
            dict(zip(JOINTS, np.degrees(postures[i]), strict=True)),
            load=load[i] + flags[0, i],
            coupling=points["coupling"][i],
            activity=points["activity"][i],
            seated=seated,
            one_leg=flags[1, i],
            supported=(flags[2, i], 0),
            raised=(flags[3, i], flags[4, i]),
        )
        for i in range(3000)
    ]
    np.testing.assert_array_equal(result.final, expected)
    assert set(result.final) >= set(range(2, 15))


def test_shapes_and_types():
    result = reba.assess(random_postures(7))
    assert result.final.shape == result.valid.shape == result.band.shape == result.arm.shape == (7,)
    assert result.outside.shape == (7, 32)
    assert result.final.dtype == np.int64
    assert all(scores.shape == (7,) for scores in result.segments.values())
    assert set(result.segments) == {
        "neck",
        "trunk",
        "legs",
        "upper_arm",
        "lower_arm",
        "wrist",
        *(f"{side}_{name}" for side in SIDES for name in ("upper_arm", "lower_arm", "wrist")),
    }
    assert reba.assess(np.zeros((0, 32))).final.shape == (0,)
    assert reba.assess(np.zeros(32)).final.tolist() == [1]
    assert reba.assess(np.zeros(32, dtype=int).tolist()).final.tolist() == [1]


def test_changing_the_given_array_afterwards_changes_nothing():
    postures = random_postures(3)
    result = reba.assess(postures)
    before = result.reasons(1)
    postures[:] = 0
    assert result.reasons(1) == before
    assert not result.postures.flags.writeable


def test_many_blocks_are_as_good_as_one():
    postures = random_postures(5000)
    whole = reba.assess(postures, load_kg=np.linspace(0, 20, 5000))
    parts = [reba.assess(postures[i], load_kg=i * 20 / 4999).final[0] for i in range(0, 5000, 97)]
    assert whole.final[::97].tolist() == parts


@pytest.mark.parametrize(
    ("segment", "joint", "edge", "below", "above"),
    [
        ("neck", "neck_flexion", 20, 1, 2),
        ("neck", "neck_flexion", -5, 2, 1),
        ("neck", "neck_twist", 10, 1, 2),
        ("neck", "neck_twist", -10, 2, 1),
        ("neck", "neck_side_bend", 10, 1, 2),
        ("trunk", "trunk_flexion", 5, 1, 2),
        ("trunk", "trunk_flexion", -5, 2, 1),
        ("trunk", "trunk_flexion", 20, 2, 3),
        ("trunk", "trunk_flexion", -20, 3, 2),
        ("trunk", "trunk_flexion", 60, 3, 4),
        ("trunk", "trunk_twist", -10, 2, 1),
        ("trunk", "trunk_side_bend", 10, 1, 2),
        ("legs", "right_knee_flexion", 30, 1, 2),
        ("legs", "left_knee_flexion", 60, 2, 3),
        ("right_upper_arm", "right_shoulder_flexion", -20, 2, 1),
        ("left_upper_arm", "left_shoulder_flexion", 20, 1, 2),
        ("left_upper_arm", "left_shoulder_flexion", 45, 2, 3),
        ("right_upper_arm", "right_shoulder_flexion", 90, 3, 4),
        ("right_upper_arm", "right_shoulder_abduction", 20, 1, 2),
        ("left_upper_arm", "left_shoulder_rotation", -20, 2, 1),
        ("right_lower_arm", "right_elbow_flexion", 60, 2, 1),
        ("left_lower_arm", "left_elbow_flexion", 100, 1, 2),
        ("left_wrist", "left_wrist_flexion", 15, 1, 2),
        ("right_wrist", "right_wrist_flexion", -15, 2, 1),
        ("left_wrist", "left_wrist_deviation", 10, 1, 2),
        ("right_wrist", "right_forearm_pronation", 45, 1, 2),
    ],
)
def test_band_ends(segment, joint, edge, below, above):
    step = 1e-6
    assert score(segment, **{joint: edge - step}) == below
    assert score(segment, **{joint: edge + step}) == above
    assert score(segment, **{joint: edge}) == min(below, above)
    assert score(segment, reba.Method(band_ends="higher"), **{joint: edge}) == max(below, above)
    # The same angle computed otherwise, a few last bits away, is at the band end too.
    for nearby in (np.nextafter(np.radians(edge), 9), np.nextafter(np.radians(edge), -9)):
        assert score(segment, **{joint: np.degrees(nearby)}) == min(below, above)


def test_task_options():
    assert score("legs", one_leg=True) == 2
    assert score("legs", one_leg=True, seated=True) == 1
    assert score("legs", right_knee_flexion=90, one_leg=True) == 4
    assert score("legs", right_knee_flexion=90, seated=True) == 1
    assert score("right_upper_arm", arm_supported=(True, False)) == 1
    assert score("left_upper_arm", left_shoulder_flexion=30, arm_supported=(True, False)) == 2
    assert score("left_upper_arm", left_shoulder_flexion=30, arm_supported=(False, True)) == 1
    assert score("left_upper_arm", shoulder_raised=(False, True)) == 2
    assert score("right_upper_arm", shoulder_raised=(False, True)) == 1
    assert score("final", activity=3) == 4
    assert score("final", load_kg=20, shock=True) == 3


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"load_kg": -1}, "load_kg: got -1"),
        ({"load_kg": np.nan}, "load_kg: got nan"),
        ({"load_kg": np.inf}, "load_kg: got inf"),
        ({"load_kg": "5"}, "load_kg: got '5'"),
        ({"load_kg": [1, 2, 3]}, r"load_kg: got shape \(3,\)"),
        ({"coupling": 4}, "coupling: got 4"),
        ({"coupling": 0.5}, "coupling: got 0.5"),
        ({"coupling": [0, 7]}, "coupling: got 7"),
        ({"activity": -1}, "activity: got -1"),
        ({"shock": 2}, "shock: got 2"),
        ({"seated": "no"}, "seated: got 'no'"),
        ({"one_leg": None}, "one_leg: got None"),
        ({"arm_supported": True}, "arm_supported: got True"),
        ({"shoulder_raised": (True, 2)}, r"shoulder_raised \(left\): got 2"),
    ],
)
def test_bad_options_are_named(options, named):
    with pytest.raises(InputError, match=f"{named}.*allowed: "):
        reba.assess(np.zeros((2, 32)), **options)


def test_the_options_have_one_set_of_names_and_defaults():
    asked = inspect.signature(reba.assess).parameters.values()
    told = {each.name: each.default for each in asked if each.kind is each.KEYWORD_ONLY}
    assert told == {**DEFAULTS, "low": None, "high": None}
    assert list(TaskOptions.__annotations__) == list(DEFAULTS)


def test_an_option_that_there_is_not():
    with pytest.raises(TypeError, match="task: got 'load', allowed load_kg, shock, "):
        SmoothReba(load=3.0)


@pytest.mark.parametrize(
    "wrong", [np.zeros(31), np.zeros((2, 33)), np.zeros((2, 2, 32)), 0.0, "upright", [[0], [0, 1]]]
)
def test_wrong_postures_are_refused(wrong):
    with pytest.raises(InputError, match=r"postures: got .*\(n, 32\)"):
        reba.assess(wrong)


@pytest.mark.parametrize("sign", [-1, 1])
def test_half_a_turn_is_still_an_angle_and_what_is_beyond_by_more_than_rounding_is_not(sign):
    half = np.zeros(32)
    half[INDEX["neck_flexion"]] = sign * (np.pi + 1e-9)
    assert reba.assess(half).valid[0]
    half[INDEX["neck_flexion"]] = sign * (np.pi + 1.1e-9)
    with pytest.raises(InputError, match="neck_flexion"):
        reba.assess(half)


@pytest.mark.parametrize("value", [90.0, -np.radians(181), np.inf, -np.inf])
def test_an_angle_beyond_half_a_turn_names_joint_and_row(value):
    postures = np.zeros((5000, 32))
    postures[3000, INDEX["left_knee_flexion"]] = value
    postures[4000, 0] = 90.0
    postures[10, 0] = np.nan
    with pytest.raises(InputError, match=r"row 3000, left_knee_flexion.*degrees given as radians"):
        reba.assess(postures)
    assert reba.assess(posture(neck_flexion=180)).valid[0]


def test_nan_makes_that_posture_invalid_and_no_other():
    postures = random_postures(40)
    clean = reba.assess(postures)
    postures[7, INDEX["left_ankle_inversion"]] = np.nan
    result = reba.assess(postures)
    others = np.arange(40) != 7
    assert result.valid.tolist() == others.tolist()
    np.testing.assert_array_equal(result.final[others], clean.final[others])
    assert (result.final[7], result.band[7]) == (0, -1)
    assert all(scores[7] == 0 for scores in result.segments.values())
    assert not result.outside[7, INDEX["left_ankle_inversion"]]
    assert result.reasons(7) == ["not scored: no angle for left ankle inversion"]


def test_beyond_the_range_is_scored_by_the_outer_band_and_flagged():
    result = reba.assess(posture(left_elbow_flexion=170, trunk_flexion=-60))
    assert np.flatnonzero(result.outside[0]).tolist() == [
        INDEX["trunk_flexion"],
        INDEX["left_elbow_flexion"],
    ]
    assert (result.segments["left_lower_arm"][0], result.segments["trunk"][0]) == (2, 3)
    assert (
        "left elbow flexion 170 deg is beyond its range 0 to 150: scored by the outer band"
        in result.reasons(0)
    )
    assert not reba.assess(np.stack([LOWER, UPPER])).outside.any()


def test_the_worse_arm_governs_and_equal_arms_give_right():
    result = reba.assess(
        np.stack(
            [posture(left_shoulder_flexion=100), posture(right_shoulder_flexion=100), posture()]
        )
    )
    assert result.arm.tolist() == ["left", "right", "right"]
    assert result.segments["upper_arm"].tolist() == [4, 4, 1]


@given(seed=st.integers(0, 10**6))
@settings(max_examples=30, deadline=None)
def test_mirrored_postures_score_the_same(seed):
    postures = random_postures(20, seed)
    mirrored = postures.copy()
    for name in ("trunk_side_bend", "trunk_twist", "neck_side_bend", "neck_twist"):
        mirrored[:, INDEX[name]] *= -1
    mirrored[:, 6:] = postures[:, [*range(13, 20), *range(6, 13), *range(26, 32), *range(20, 26)]]
    np.testing.assert_array_equal(reba.assess(mirrored).final, reba.assess(postures).final)


@pytest.mark.parametrize("degrees", [20, 45, 60, 90, 100, 180])
def test_band_ends_of_32_bit_numbers_belong_to_the_lower_score(degrees: int) -> None:
    joints = (joint for joint in range(32) if LOWER[joint] <= np.radians(degrees) <= UPPER[joint])
    joints = list(range(32)) if degrees == 180 else list(joints)
    exact = np.zeros((len(joints), 32))
    exact[range(len(joints)), joints] = np.radians(degrees)
    narrow = np.zeros(exact.shape, dtype=np.float32)
    narrow[range(len(joints)), joints] = np.radians(np.float32(degrees))
    twice = np.float32(degrees) * np.float32(np.pi) / np.float32(180) * (narrow > 0)
    expected = reba.assess(exact)
    for angles in (narrow, twice, list(narrow)):
        found = reba.assess(angles)
        np.testing.assert_array_equal(found.final, expected.final)
        for name, scores in expected.segments.items():
            np.testing.assert_array_equal(found.segments[name], scores)
        np.testing.assert_array_equal(found.outside, expected.outside)


def test_a_ten_thousandth_of_a_degree_beyond_a_band_end_counts() -> None:
    posture = np.zeros((2, 32))
    posture[:, INDEX["trunk_flexion"]] = np.radians([60.0, 60.0001])
    assert reba.assess(posture).segments["trunk"].tolist() == [3, 4]


def worst_of(*frames: tuple[float, float, float], time: Any = None) -> int:
    """The worst of postures with these flexions of trunk, neck and right shoulder [deg]."""
    postures = np.zeros((len(frames), 32))
    joints = [INDEX[name] for name in ("trunk_flexion", "neck_flexion", "right_shoulder_flexion")]
    postures[:, joints] = np.radians(frames)
    return reba.assess(postures).worst(time)


def test_ties_of_the_worst_posture_go_by_both_scores_and_then_by_duration() -> None:
    rest, low, high = (0.0, 0.0, 0.0), (70.0, 0.0, 30.0), (70.0, 0.0, 60.0)
    postures = np.zeros((3, 32))
    joints = [INDEX[name] for name in ("trunk_flexion", "neck_flexion", "right_shoulder_flexion")]
    postures[:, joints] = np.radians([rest, low, high])
    assert reba.assess(postures).final.tolist() == [1, 3, 3]  # low and high differ in score B only
    assert worst_of(rest, low, low, low, rest, high, rest) == 5
    assert worst_of(rest, low, rest, low, low, rest) == 3
    assert worst_of(low, rest, low, rest) == 0
    assert worst_of(low, rest, low, rest, time=[0.0, 0.1, 0.2, 0.5]) == 2
    assert worst_of(low, low, rest, low, time=[0.0, 0.1, 0.2, 0.3]) == 0
    assert worst_of(low) == 0
    unknown = (np.nan, 0.0, 0.0)
    assert worst_of(unknown, rest) == 1
    assert worst_of(unknown, unknown) == 0
    with pytest.raises(InputError, match="worst: got no posture"):
        reba.assess(np.zeros((0, 32))).worst()
