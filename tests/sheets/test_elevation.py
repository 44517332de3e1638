"""Arms read by where they point: against the kinematics, and alike however the joints got there."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from sheet_postures import score

import ergoqp
from ergoqp import reba
from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.datasets.postures import balanced_postures
from ergoqp.errors import InputError
from ergoqp.human import Body, Kinematics
from ergoqp.joints import INDEX, LOWER, SIDES, UPPER
from ergoqp.sheets.description import elevation_of

ELEVATION = reba.Method(upper_arm="elevation")


def arm(flexion: float, abduction: float, side: str = "right") -> dict[str, float]:
    return {f"{side}_shoulder_flexion": flexion, f"{side}_shoulder_abduction": abduction}


def test_elevation_and_its_plane_are_where_the_upper_arm_points() -> None:
    kinematics = Kinematics(Body())
    postures = np.random.default_rng(0).uniform(LOWER, UPPER, (40, 32))
    for posture, elevations, planes in zip(postures, *elevation_of(postures), strict=True):
        trunk = np.array(kinematics.at("trunk", ca.DM(posture))[1])
        for side, elevation, plane in zip(SIDES, elevations, planes, strict=True):
            ends = [
                np.array(kinematics.at(f"{side}_{end}", ca.DM(posture))[0]).ravel()
                for end in ("shoulder", "elbow")
            ]
            x, y, z = trunk.T @ (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
            assert elevation == pytest.approx(np.arccos(-z), abs=1e-7)
            out = -y if side == "right" else y
            assert np.exp(1j * plane) == pytest.approx(np.exp(1j * np.arctan2(x, out)))
    hanging, plane = elevation_of(np.zeros((1, 32)))
    assert (hanging == 0).all()
    assert (plane == 0).all()


@pytest.mark.parametrize(
    ("angles", "expected"),
    [
        ((0, 170), 4),
        ((170, 10), 4),
        ((0, 60), 4),  # 60 deg sideways: 3, abducted
        ((0, 90), 4),
        ((60, 0), 3),
        ((-30, 0), 2),
        ((-81, 34), 3),  # behind is 2 however far, and abducted
        ((99, 146), 3),  # the same direction
        ((-15, 0), 1),
        ((15, 0), 1),
        ((100, -30), 4),
    ],
)
def test_an_arm_is_scored_by_where_it_points(angles: tuple[float, float], expected: int) -> None:
    for side in SIDES:
        assert score(f"{side}_upper_arm", ELEVATION, **arm(*angles, side)) == expected


def test_both_ways_of_turning_score_alike() -> None:
    generator = np.random.default_rng(2)
    one = np.zeros((500, 32))
    one[:, INDEX["right_shoulder_flexion"]] = generator.uniform(-np.pi, 0, 500)
    one[:, INDEX["right_shoulder_abduction"]] = generator.uniform(0, np.pi / 2, 500)
    other = one.copy()
    other[:, INDEX["right_shoulder_flexion"]] += np.pi
    other[:, INDEX["right_shoulder_abduction"]] *= -1
    other[:, INDEX["right_shoulder_abduction"]] += np.pi
    read = [reba.assess(each, ELEVATION).segments["right_upper_arm"] for each in (one, other)]
    np.testing.assert_array_equal(*read)
    read = [reba.assess(each).segments["right_upper_arm"] for each in (one, other)]
    assert (read[0] != read[1]).any()


def test_the_words_are_those_of_the_score() -> None:
    posture = np.zeros(32)
    posture[INDEX["right_shoulder_abduction"]] = np.radians(170)
    sentence = next(
        each for each in reba.assess(posture, ELEVATION).reasons(0) if "right upper arm" in each
    )
    assert sentence == "right upper arm 170 deg raised, over 90: 4"
    # The posture itself stays as it was given.
    assert reba.assess(posture, ELEVATION).postures[0, INDEX["right_shoulder_flexion"]] == 0


def test_costs_take_joints_one_by_one() -> None:
    with pytest.raises(
        InputError, match=r"smooth_reba: got Method\.upper_arm 'elevation', allowed"
    ):
        SmoothReba(method=ELEVATION)
    with pytest.raises(InputError, match=r"balanced_postures: got Method\.upper_arm 'elevation'"):
        balanced_postures(3, np.random.default_rng(0), ELEVATION)
    with pytest.raises(InputError, match=r"problem: got Method\.upper_arm 'elevation'"):
        ergoqp.load_problem("desk").replace(method=ELEVATION)
