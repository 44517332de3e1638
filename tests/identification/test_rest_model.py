"""Where the model comes to rest: against a person who settles, and its derivatives."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from ergoqp.human import Body, Kinematics
from ergoqp.human.body import GROWTH
from ergoqp.identification.rest_model import RestModel, situation_of
from ergoqp.problem.geometry import Workspace
from ergoqp.problem.load import TASKS, load_problem
from ergoqp.rest.model_person import ModelPerson


@cache
def model_of(name: str) -> RestModel:
    return RestModel(load_problem(name).response)


def reached(name: str, count: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Places, and how the problem's own person settles there."""
    problem = load_problem(name)
    person, found = ModelPerson(problem.response), []
    comfort = problem.response.comfort
    for point in Workspace(problem).spread(20):
        pose = Workspace(problem).pose(point)
        posture, there = person.settle(comfort, pose, person.grasp(comfort), person.stand(comfort))
        if there:
            found.append((pose, posture))
    assert len(found) >= count
    return found[:count]


@pytest.mark.slow
@pytest.mark.parametrize("name", TASKS)
def test_it_rests_where_a_person_settles(name: str) -> None:
    model = model_of(name)
    comfort = model.response.comfort
    situation, traits = situation_of(model.response, [comfort]), np.zeros(len(model.layout.sd))
    apart = []
    for pose, posture in reached(name, 6):
        rest = model.rest(traits, situation, pose, model.begin(posture))
        apart.append(np.degrees(np.abs(rest.posture - posture).max()))
        assert rest.gap < 5e-3
    # Soles and ends of ranges are a little soft here: less so than people are steady.
    assert np.median(apart) < 1.0
    assert max(apart) < 4.0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["desk", "screwing"])
def test_slopes_are_those_of_the_rests_themselves(name: str) -> None:
    model = model_of(name)
    layout = model.layout
    situation = situation_of(model.response, [model.response.comfort])
    pose, posture = reached(name, 1)[0]
    zero = np.zeros(len(layout.sd))
    rest = model.rest(zero, situation, pose, model.begin(posture), steps=100)
    differences = []
    for trait in range(rest.by_traits.shape[1]):
        step = np.zeros(len(zero))
        step[trait] = 1e-2
        ends = [
            model.rest(sign * step, situation, pose, rest.z, steps=100).z[: len(layout.joints)]
            for sign in (1, -1)
        ]
        differences.append((ends[0] - ends[1]) / 2e-2)
    measured, told = np.array(differences).T, rest.by_traits
    # The Hessian is Gauss and Newton's, which leaves out how contact bends.
    for part in ("weights", "comfort", "lengths"):
        one, other = measured[:, layout.parts[part]], told[:, layout.parts[part]]
        cosine = np.sum(one * other) / np.linalg.norm(one) / np.linalg.norm(other)
        print(name, part, cosine, np.linalg.norm(other) / np.linalg.norm(one))
        assert cosine > 0.85, part
        assert 0.7 < np.linalg.norm(other) / np.linalg.norm(one) < 1.4, part


def test_a_body_that_grows_is_the_larger_body() -> None:
    import casadi as ca

    growth = ca.SX.sym("growth", len(GROWTH))
    grown = Kinematics(Body(), growth)
    shares = np.zeros(len(GROWTH))
    shares[GROWTH.index("upper_arm")], shares[GROWTH.index("thigh")] = 0.07, -0.05
    lengths = dict(Body().lengths)
    lengths["upper_arm"] *= 1.07
    lengths["thigh"] *= 0.95
    larger = Kinematics(Body(Body().stature, lengths))
    q = np.random.default_rng(0).uniform(-0.5, 0.5, 32)
    for frame in ("right_grip", "left_sole", "eyes"):
        for mine, other in zip(
            grown.function(frame)(q, shares), larger.function(frame)(q), strict=True
        ):
            np.testing.assert_allclose(np.array(mine), np.array(other), atol=1e-12)
    shares[:] = 0.0
    shares[0] = 0.1
    tall = Kinematics(Body.of_stature(1.1 * Body().stature))
    np.testing.assert_allclose(
        np.array(grown.function("right_grip")(q, shares)[0]),
        np.array(tall.function("right_grip")(q)[0]),
        atol=1e-12,
    )
