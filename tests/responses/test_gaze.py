"""People look at what they work on: the eyes first, then neck and trunk."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from full_kkt import eyes_of, frame, placed

import ergoqp
from ergoqp.errors import InputError
from ergoqp.joints import INDEX
from ergoqp.responses import IkResponse
from ergoqp.responses.stance_and_gaze import EYES_TURN, VIEWING_DISTANCE, beyond_ease
from ergoqp.rest.model_person import ModelPerson

NOBODY = np.zeros(32)


def missing(seen: list[float]) -> np.ndarray:
    point = ca.SX.sym("seen", 3)
    return np.array(ca.Function("missing", [point], [beyond_ease(point)])(seen)).ravel()


def toward(angle_deg: float, distance: float = 0.6) -> np.ndarray:
    """What is missing where the work is seen so far to the left of the eyes at ease."""
    angle = np.radians(angle_deg)
    return missing([distance * np.cos(angle), distance * np.sin(angle), 0.0])


def test_the_eyes_take_the_first_degrees_and_the_head_the_rest() -> None:
    assert np.degrees(toward(5.0)[0]) < 0.4
    # Beyond the eyes' turn what is missing grows as the angle does, less what they take.
    for angle in (40.0, 60.0, 80.0):
        left = np.degrees(toward(angle)[0])
        assert 0.5 * (angle - np.degrees(EYES_TURN)) < left < 1.7 * angle
        assert toward(-angle)[0] == pytest.approx(-toward(angle)[0])
    sizes = [toward(angle)[0] for angle in np.linspace(0.0, 150.0, 60)]
    assert np.all(np.diff(sizes) > 0)
    assert np.isfinite(toward(180.0)).all()


def test_nobody_works_with_the_eyes_on_the_work() -> None:
    assert missing([0.8, 0, 0])[2] < 0.01
    assert missing([VIEWING_DISTANCE / 2, 0, 0])[2] == pytest.approx(0.5, abs=0.01)


def turned_head(response: IkResponse, posture: np.ndarray, twist: np.ndarray, dt: float) -> float:
    rates = np.array(response.sensitivity()(posture, NOBODY)[0]) @ twist
    return float(np.degrees(rates[INDEX["neck_twist"]]) * dt)


def test_the_neck_turns_after_work_that_is_carried_aside() -> None:
    problem = ergoqp.load_problem("screwing")
    response = problem.response
    person, start = ModelPerson(response), ModelPerson(response).start_at(response.comfort)
    aside = start.pose.copy()
    aside[1, 3] += 0.45
    ahead, _ = person.settle(start.posture, start.pose, start.grasp, start.soles)
    turned, reached = person.settle(ahead, aside, start.grasp, start.soles)
    assert reached
    assert turned[INDEX["neck_twist"]] - ahead[INDEX["neck_twist"]] > np.radians(10)
    assert turned_head(response, turned, np.array([0, 0.1, 0, 0, 0, 0]), 1.0) > 1.0
    # Who does not look keeps the neck as it was.
    blind = ModelPerson(replace(response, looks=False))
    kept, _ = blind.settle(start.posture, aside, start.grasp, start.soles)
    necks = [INDEX[f"neck_{way}"] for way in ("flexion", "side_bend", "twist")]
    np.testing.assert_array_equal(kept[necks], start.posture[necks])


@pytest.mark.parametrize("name", ["screwing", "low_bin", "dentist"])
def test_rest_is_where_neither_comfort_nor_eyes_pull_more(name: str) -> None:
    """At rest no motion that the contact allows lowers discomfort and what is missing together."""
    response = replace(ergoqp.load_problem(name).response, damping=1e-4)
    person = ModelPerson(response)
    start = person.start_at(response.comfort)
    posture, _ = person.settle(start.posture, start.pose, start.grasp, start.soles, steps=2000)
    rates = np.array(response.drift()(posture, NOBODY)).ravel()
    assert np.abs(rates).max() < 1e-3
    seen, _, _ = eyes_of(response, placed(response, posture))
    assert np.abs(seen[:2]).max() < np.radians(15)


def test_a_neck_that_is_locked_leaves_the_looking_to_the_trunk() -> None:
    response = ergoqp.load_problem("screwing").response
    posture = response.comfort.copy()
    locked = np.zeros(32)
    locked[[INDEX[f"neck_{way}"] for way in ("flexion", "side_bend", "twist")]] = 1
    aside = np.array([0, 0.1, 0, 0, 0, 0])
    free, without = (
        np.array(response.sensitivity()(posture, locks)[0]) @ aside for locks in (NOBODY, locked)
    )
    twist = INDEX["trunk_twist"]
    assert without[INDEX["neck_twist"]] == 0
    assert without[twist] > free[twist]


def test_the_eyes_are_where_eyes_are() -> None:
    response = IkResponse()
    data = placed(response, NOBODY)
    eyes, nose, top = (frame(data, name)[:3, 3] for name in ("eyes", "nose", "head_top"))
    # 0.936 of the stature (Drillis and Contini), behind the tip of the nose.
    assert eyes[2] == pytest.approx(0.936 * top[2], abs=0.005)
    assert nose[0] - 0.04 < eyes[0] < nose[0]


@pytest.mark.parametrize(
    ("terms", "sentence"),
    [
        ({"looks": "yes"}, "looks: got 'yes'"),
        ({"attention": 0.0}, "attention: got 0"),
        ({"free_arm": "floats"}, "free_arm: got 'floats', allowed hangs, rests"),
    ],
)
def test_wrong_terms_are_named(terms: dict, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        IkResponse(**terms)
