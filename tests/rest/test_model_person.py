"""The person who follows: keeps contact, stays on the soles and within the ranges, rests nearest to
comfort."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ergoqp.joints import INDEX, LOWER, UPPER
from ergoqp.problem.load import TASKS, load_problem
from ergoqp.rest import model_person
from ergoqp.rest.best_place import workspace_poses
from ergoqp.rest.model_person import PATIENCE, REACHED, ModelPerson, person_of, sample_person


@pytest.fixture(scope="module", params=TASKS)
def person(request: pytest.FixtureRequest) -> ModelPerson:
    return sample_person(load_problem(request.param), seed=2)


def test_at_rest_the_person_holds_the_object_and_stands_where_they_stood(
    person: ModelPerson,
) -> None:
    comfort = person.response.comfort
    soles, grasp, home = person.stand(comfort), person.grasp(comfort), person.contact(comfort)[0]
    rng, reached_any = np.random.default_rng(0), 0
    for _ in range(4):
        pose = home.copy()
        pose[:3, 3] += rng.uniform(-0.08, 0.08, 3)
        posture, reached = person.settle(comfort, pose, grasp, soles)
        assert np.all(posture >= LOWER)
        assert np.all(posture <= UPPER)
        np.testing.assert_allclose(person.stand(posture)[:3, 3], soles[:3, 3], atol=REACHED)
        if reached:
            reached_any += 1
            grips = np.split(
                np.array(person.response.grips()(posture)), len(person.response.hands), axis=1
            )
            for grip, held in zip(grips, grasp, strict=True):
                np.testing.assert_allclose(grip[:3, 3], (pose @ held)[:3, 3], atol=REACHED)
    assert reached_any >= 3


def test_what_is_out_of_reach_is_not_reached(person: ModelPerson) -> None:
    comfort = person.response.comfort
    pose = person.contact(comfort)[0].copy()
    pose[0, 3] += 3.0
    posture, reached = person.settle(comfort, pose, person.grasp(comfort), person.stand(comfort))
    assert not reached
    assert np.isfinite(posture).all()


def test_the_rest_is_where_plain_steps_end(person: ModelPerson) -> None:
    comfort = person.comfort
    grasp, soles, pose = person.grasp(comfort), person.stand(comfort), person.contact(comfort)[0]
    pose[:3, 3] += [0.03, -0.05, -0.04]
    targets = np.hstack([pose @ grip for grip in grasp])
    posture, relax = comfort, 0.5 * person.response.relaxation_time
    for _ in range(600):
        posture, _, _ = person.move(posture, targets, soles, 1.0, relax)
    rest, _ = person.settle(comfort, pose, grasp, soles)
    np.testing.assert_allclose(rest, posture, atol=1e-6)


def test_an_arm_that_is_just_too_short_does_not_swing() -> None:
    problem = load_problem("overhead")
    person = ModelPerson(person_of(problem))
    comfort, relax = person.comfort, 0.5 * person.response.relaxation_time
    grasp, soles, pose = (
        person.grasp(comfort),
        person.stand(comfort),
        workspace_poses(problem, 0.1)[532],
    )
    targets = np.hstack([pose @ grip for grip in grasp])
    swinging, before = comfort, comfort
    for _ in range(100):
        before, swinging = swinging, person.move(swinging, targets, soles, 1.0, relax)[0]
    assert np.abs(swinging - before).max() > 0.1
    rest, reached = person.settle(comfort, pose, grasp, soles)
    after, distance, _ = person.move(rest, targets, soles, 1.0, relax)
    assert reached
    assert distance < REACHED
    np.testing.assert_allclose(after, rest, atol=1e-6)


def test_near_the_rest_steps_are_extrapolated(person: ModelPerson, monkeypatch) -> None:
    comfort = person.comfort
    pose = person.contact(comfort)[0]
    pose[:3, 3] += [0.03, -0.05, -0.04]
    moves = []
    move = ModelPerson.move

    def counted(self: ModelPerson, *given: Any) -> tuple[np.ndarray, float, float]:
        moves.append(given)
        return move(self, *given)

    monkeypatch.setattr(ModelPerson, "move", counted)
    rest, _ = person.reach(pose)
    extrapolated = len(moves)
    moves.clear()
    monkeypatch.setattr(model_person, "NEAR", 0.0)
    plain, _ = person.reach(pose)
    assert extrapolated < 0.75 * len(moves)
    np.testing.assert_allclose(rest, plain, atol=1e-6)
    moves.clear()
    pose[0, 3] += 3.0
    assert not person.reach(pose)[1]
    assert len(moves) <= PATIENCE


def test_in_comfort_nobody_moves(person: ModelPerson) -> None:
    comfort = person.response.comfort
    held = np.hstack([person.contact(comfort)[0] @ grip for grip in person.grasp(comfort)])
    posture, distance, angle = person.move(comfort, held, person.stand(comfort), 0.2, 0.01)
    assert distance < 1e-6
    assert angle < 1e-6
    # Standing, the pelvis may still seek the middle above the feet.
    assert np.abs(posture - comfort).max() < 0.02


def test_a_joint_at_its_end_stops_and_the_others_go_on() -> None:
    person = sample_person(load_problem("dentist"), seed=2)
    posture = person.response.comfort.copy()
    joint = INDEX["right_elbow_flexion"]
    posture[joint] = LOWER[joint]
    held, soles = person.contact(posture)[0].copy(), person.stand(posture)
    grasp = person.grasp(posture)
    held[0, 3] += 0.05
    for _ in range(50):
        posture, distance, _ = person.move(
            posture, np.hstack([held @ grip for grip in grasp]), soles, 0.3, 0.0
        )
        assert np.all(posture >= LOWER)
    assert posture[INDEX["trunk_flexion"]] > person.response.comfort[INDEX["trunk_flexion"]] + 0.003
    assert distance < 0.02
