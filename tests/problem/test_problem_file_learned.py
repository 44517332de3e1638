"""Problem files with learned models, and problems whose state is two points."""

import numpy as np
import pytest

import ergoqp
from ergoqp.coordinates import FOREARM, SCORED_JOINTS
from ergoqp.costs.neural import Neural
from ergoqp.errors import ErgoqpError
from ergoqp.learning.one_class import OneClass
from ergoqp.limits import ArmLength, JointLimit, OneClassBoundary
from ergoqp.problem.load import problem_from_dict
from ergoqp.responses import IkResponse, LinearResponse
from ergoqp.step.stepper import Stepper


def save_models(folder, name, coordinates):
    """A small network and a boundary of these coordinates."""
    rng, d = np.random.default_rng(0), len(coordinates)
    network = {
        "places": rng.normal(size=(d, 3)),
        "sharpness": np.ones((d, 3)),
        "mixing": rng.normal(size=(d, 3, 2)),
    }
    network |= {
        "W1": rng.normal(size=(2 * d, 4)),
        "b1": np.zeros(4),
        "W2": rng.normal(size=(4, 3)),
        "b2": np.zeros(3),
    }
    Neural(network, [1, 2, 3], coordinates, 1.0).save(folder / f"{name}_cost.npz")
    OneClass.fit(rng.normal(size=(200, d)), coordinates, nu=0.1).save(
        folder / f"{name}_boundary.npz"
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("models")
    save_models(folder, "body", SCORED_JOINTS)
    save_models(folder, "arm", FOREARM)
    return folder


def arm(**limits):
    return {
        "response": {"points": {}},
        "cost": {"learned": {"model": "arm_cost.npz"}},
        "limits": {
            "arm_length": {"length": 0.26},
            "one_class_boundary": {"model": "arm_boundary.npz", "hard": True},
        }
        | limits,
    }


def body(**tables):
    return {
        "response": {"ik": {}},
        "cost": {"learned": {"model": "body_cost.npz"}},
        "limits": {"one_class_boundary": {"model": "body_boundary.npz", "tolerance": 0.05}},
    } | tables


def test_a_problem_of_points(folder):
    problem = problem_from_dict(arm(point_speed={"speed": 0.1}), "arm", folder)
    assert problem.coordinates == FOREARM
    assert isinstance(problem.response, LinearResponse)
    assert problem.limit_of(ArmLength).length == 0.26
    assert problem.limit_of(OneClassBoundary).hard
    assert problem.limit_of(JointLimit) is None
    assert problem.twist_limit.speed.tolist() == [0.1] * 6
    step = Stepper(problem).step([0.1, 0.0, 0.0, 0.1, 0.26, 0.0])
    assert step.margins.keys() == {"arm length", "boundary"}


def test_a_persons_problem_with_learned_terms(folder):
    problem = problem_from_dict(body(), "body", folder)
    assert isinstance(problem.response, IkResponse)
    assert isinstance(problem.cost, Neural)
    assert problem.limit_of(JointLimit) is not None
    step = Stepper(problem).step(problem.response.comfort)
    assert step.cost == pytest.approx(problem.cost(problem.response.comfort)[0], abs=1e-10)
    assert step.status != "invalid"


def test_a_path_is_relative_to_the_file(folder):
    path = folder / "mine.toml"
    path.write_text('[response.ik]\n[cost.learned]\nmodel = "body_cost.npz"\n', encoding="utf-8")
    assert isinstance(ergoqp.load_problem(path).cost, Neural)


@pytest.mark.parametrize(
    ("raw", "said"),
    [
        (body(cost={"learned": {"model": "absent.npz"}}), "model: got 'absent.npz', allowed"),
        (body(cost={"learned": {"model": "absent"}}), "model: got 'absent', allowed"),
        (
            body(cost={"learned": {"model": "body_cost.npz"}, "smooth_reba": {}}),
            "only one of smooth_reba and learned",
        ),
        (body(cost={"learned": {"model": "arm_cost.npz"}}), "cost: got a model of elbow_x"),
        (body(task={"load_kg": 6.0}), "allowed none: the cost was learned without them"),
        (
            body(limits={"one_class_boundary": {"model": "arm_boundary.npz"}}),
            "limits: got a model of elbow_x",
        ),
        (body(limits={"one_class_boundary": {"model": "body_cost.npz"}}), "one_class"),
        (body(limits={"arm_length": {"length": 0.26}}), "allowed only where the state is elbow_x"),
        (body(response={}), "exactly one of ik, points and gmr"),
        (arm(joints={}), "got a JointLimit, allowed only where the state is a person's posture"),
        (arm(twist={}), "got 2 twist limits, allowed exactly one"),
        (arm(arm_length={"length": 0.0}), "limits.arm_length.length"),
    ],
)
def test_every_mistake_has_its_sentence(folder, raw, said):
    with pytest.raises(ErgoqpError) as caught:
        Stepper(problem_from_dict(raw, "mine", folder))
    assert said in str(caught.value)
