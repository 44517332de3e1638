import casadi as ca
import numpy as np
import pytest

import ergoqp
from ergoqp.errors import InputError
from ergoqp.limits import TwistLimit
from ergoqp.responses import LinearResponse
from ergoqp.step.stepper import Stepper

GOAL = np.array([0.3, -0.2])


class Bowl:
    name, minimum = "bowl", 0.0

    def expression(self, q):
        return 30 * ca.sumsqr(q - ca.DM(GOAL))

    def __call__(self, states):
        return 30 * ((np.atleast_2d(states) - GOAL) ** 2).sum(axis=1)


def test_the_state_follows_by_the_matrix():
    matrix = np.random.default_rng(0).normal(size=(4, 6))
    response = LinearResponse(("a", "b", "c", "d"), matrix)
    sensitivity, unmet = response.sensitivity()(np.ones(4), np.zeros(4))
    assert np.array(sensitivity) == pytest.approx(matrix)
    assert not np.array(unmet).any()
    assert response.joints == response.coordinates == ("a", "b", "c", "d")


def test_a_system_of_ones_own_runs_through_the_same_step():
    response = LinearResponse(("a", "b"), [[1, 0, 0, 0, 0, 0], [0, 0.5, 0, 0, 0, 0]])
    problem = ergoqp.Problem(
        cost=Bowl(), response=response, limits=[TwistLimit()], control=ergoqp.Control(comfort=0.0)
    )
    assert problem.coordinates == ("a", "b")
    stepper, state = Stepper(problem), np.zeros(2)
    for _ in range(800):
        step = stepper.step(state)
        state = state + np.asarray(response.matrix) @ step.twist * problem.dt
    assert state == pytest.approx(GOAL, abs=0.03)
    assert (
        stepper.step([0.0, 11.0]).reason == "posture: b is 11, allowed finite numbers within +-10"
    )
    assert "allowed (2,)" in stepper.step(np.zeros(32)).reason


@pytest.mark.parametrize(
    "terms",
    [
        {"coordinates": ("a", "b")},
        {"matrix": np.eye(5)},
        {"matrix": np.full((6, 6), np.nan)},
        {"comfort": [1.0]},
        {"largest": 0.0},
    ],
)
def test_wrong_shapes_are_refused(terms):
    with pytest.raises(InputError, match="allowed"):
        LinearResponse(**terms)
