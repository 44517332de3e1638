"""An arm that holds nothing hangs whatever the trunk does, or stays where it is."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import mujoco
import numpy as np
import pytest
from full_kkt import frame, placed

import ergoqp
from ergoqp.joints import INDEX
from ergoqp.responses import IkResponse
from ergoqp.responses.stance_and_gaze import TRUNK, arm_of, hanging, swinging
from ergoqp.rest.model_person import ModelPerson

NOBODY = np.zeros(32)


def upper_arm(response: IkResponse, posture: np.ndarray, side: str) -> np.ndarray:
    """Direction of the upper arm in the pelvis's axes (3,), by MuJoCo."""
    data: mujoco.MjData = placed(response, posture)
    arm = frame(data, f"{side}_elbow")[:3, 3] - frame(data, f"{side}_shoulder")[:3, 3]
    return frame(data, "pelvis")[:3, :3].T @ arm / np.linalg.norm(arm)


@pytest.mark.parametrize("side", ["right", "left"])
def test_an_arm_at_ease_points_down_beside_every_trunk(side: str) -> None:
    response = IkResponse(hands=("left" if side == "right" else "right",))
    trunk, ease = ca.SX.sym("trunk", 3), ca.SX.sym("ease", 2)
    hangs = ca.Function("hangs", [trunk, ease], [hanging(trunk, side, ease)])
    rng = np.random.default_rng(0)
    for _ in range(20):
        bend = np.radians(rng.uniform([-20, -30, -40], [80, 30, 40]))
        beside = np.radians(rng.uniform([-10, 0], [20, 15]))
        upright, bent = np.zeros(32), np.zeros(32)
        upright[swinging(side)], upright[INDEX["trunk_twist"]] = beside, bend[2]
        bent[swinging(side)] = np.array(hangs(bend, beside)).ravel()
        bent[TRUNK] = bend
        np.testing.assert_allclose(
            upper_arm(response, bent, side), upper_arm(response, upright, side), atol=1e-9
        )


def test_it_goes_on_hanging_while_the_object_moves() -> None:
    response = ergoqp.load_problem("screwing").response
    person = ModelPerson(response)
    start = person.start_at(response.comfort)
    low = start.pose.copy()
    low[:3, 3] += [0.15, 0.1, -0.35]
    posture, reached = person.settle(start.posture, low, start.grasp, start.soles)
    assert reached
    assert posture[INDEX["trunk_flexion"]] > np.radians(5)
    before = upper_arm(response, posture, "left")
    rates = np.array(response.sensitivity()(posture, NOBODY)[0]) @ [0, 0, -1, 0, 0, 0]
    after = upper_arm(response, posture + 0.02 * rates, "left")
    assert abs(rates[INDEX["trunk_flexion"]]) > 0.1
    # Down, but for the turn about the vertical that it makes with the trunk.
    assert after[2] == pytest.approx(before[2], abs=2e-4)
    assert abs(rates[INDEX["left_shoulder_flexion"]]) > 0.1


def test_a_recorded_habit_of_the_arm_fades() -> None:
    response = ergoqp.load_problem("screwing").response
    person, posture = ModelPerson(response), response.comfort.copy()
    posture[INDEX["left_shoulder_flexion"]] = np.radians(70)
    posture[INDEX["left_elbow_flexion"]] = np.radians(110)
    start = person.start_at(posture)
    settled, _ = person.settle(posture, start.pose, start.grasp, start.soles)
    assert upper_arm(response, settled, "left")[2] < -0.99
    elbow = INDEX["left_elbow_flexion"]
    assert settled[elbow] == pytest.approx(response.comfort[elbow], abs=1e-3)


def test_a_resting_arm_stays_as_it_is() -> None:
    response = replace(ergoqp.load_problem("screwing").response, free_arm="rests")
    assert response.hanging is None
    posture = response.comfort.copy()
    posture[INDEX["left_shoulder_flexion"]] = 0.9
    person = ModelPerson(response)
    start = person.start_at(posture)
    low = start.pose.copy()
    low[2, 3] -= 0.2
    settled, _ = person.settle(posture, low, start.grasp, start.soles)
    np.testing.assert_array_equal(settled[arm_of("left")], posture[arm_of("left")])
    assert not np.array(response.sensitivity()(posture, NOBODY)[0])[arm_of("left")].any()


def test_who_sits_lays_it_down_and_who_stands_lets_it_hang() -> None:
    assert IkResponse(stance="standing").hanging == "left"
    assert IkResponse(stance="standing", hands=("left",)).hanging == "right"
    assert IkResponse(stance="standing", hands=("right", "left")).hanging is None
    assert IkResponse(stance="seated").hanging is None
    assert IkResponse(stance="seated", free_arm="hangs").hanging == "left"


def test_comfort_of_arms_is_that_of_the_working_arm() -> None:
    response = IkResponse(comfort_deg={"elbow_flexion": 85, "left_shoulder_flexion": 9})
    angle = dict(zip(ergoqp.JOINTS, np.degrees(response.comfort), strict=True))
    assert angle["right_elbow_flexion"] == pytest.approx(85)
    assert angle["left_elbow_flexion"] == pytest.approx(12)
    assert angle["left_shoulder_flexion"] == pytest.approx(9)
