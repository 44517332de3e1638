"""The learned controller: its stopping rule, what it converges to, and the twists that it is
taught."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from ergoqp import load_problem
from ergoqp.errors import InputError
from ergoqp.lab.policy import (
    Policy,
    RadialFeatures,
    angles_deg,
    demonstrate,
    follow,
    solve,
    train,
    twists_of,
    unit_twists,
)
from ergoqp.lab.yardstick import GRADIENT_GAIN
from ergoqp.limits import AxisCone, TwistLimit, WorkspaceBox
from ergoqp.simulation.people import person_of_kind
from ergoqp.step.stepper import Stepper


def draw(rng, count):
    return rng.uniform(-6, 6, (count, 1))


def downhill(q):
    """Return -dV/dq of V = (q^4 - 30 q^2 + 225) / 225."""
    return -(4 * q**3 - 60 * q) / 225


FEATURES = RadialFeatures.evenly(-6, 6, 10)


def test_algorithm_1_comes_to_the_least_squares_solution():
    training = train(FEATURES, draw, downhill, rate=0.2, threshold=0.01, run=1000, most_runs=200)
    assert training.converged
    assert training.changes[-1] <= 0.01 < training.changes[-2]
    assert training.steps == 1000 * (len(training.changes) + 1)
    q = np.linspace(-6, 6, 500)[:, np.newaxis]
    closed = solve(FEATURES, q, downhill(q))
    assert np.abs(training.policy(q) - closed(q)).max() < 0.08 * np.abs(closed(q)).max()


@pytest.mark.slow
def test_one_small_step_does_not_end_it():
    """A posture whose velocity is right already changes nothing; the report's rule would stop
    there, at theta = 0."""

    def mostly_still(q):
        return np.where(np.arange(len(q)) % 10 == 0, 1.0, 0.0)[:, np.newaxis] * (np.abs(q) < 7)

    training = train(FEATURES, draw, mostly_still, rate=0.1, threshold=0.02, run=2000, most_runs=60)
    mean = training.policy(np.linspace(-5, 5, 100)[:, np.newaxis]).mean()
    np.testing.assert_allclose(mean, 0.1, atol=0.03)


def test_it_says_when_it_did_not_converge():
    training = train(FEATURES, draw, downhill, rate=0.05, threshold=1e-9, run=50, most_runs=5)
    assert not training.converged
    assert training.steps == 250
    assert len(training.changes) == 4


def test_the_controller_reaches_a_minimum_from_everywhere():
    policy = train(
        FEATURES, draw, downhill, rate=0.2, threshold=0.02, run=1000, most_runs=100
    ).policy
    q = np.linspace(-6, 6, 24)[:, np.newaxis]
    for _ in range(3000):
        q = q + 0.02 * policy(q)
    np.testing.assert_allclose(np.abs(q), np.sqrt(15), atol=0.25)


def test_least_squares_is_exact_where_it_can_be():
    rng = np.random.default_rng(0)
    postures = rng.normal(size=(300, 4))
    features = RadialFeatures.among(postures, 20, seed=1)
    assert features.constant
    theta = rng.normal(size=(6, 21))
    found = solve(features, postures, Policy(theta, features)(postures), ridge=0.0)
    np.testing.assert_allclose(found(postures), Policy(theta, features)(postures), atol=1e-8)


@pytest.mark.parametrize("constant", [False, True])
def test_expression_equals_numbers(constant):
    rng = np.random.default_rng(0)
    features = RadialFeatures(rng.normal(size=(7, 3)), 0.8, constant)
    policy = Policy(rng.normal(size=(2, 7 + constant)), features)
    q = ca.MX.sym("q", 3)
    function = ca.Function("f", [q], [policy.expression(q), features.expression(q)])
    for posture in rng.normal(size=(10, 3)):
        value, phi = (np.asarray(out).ravel() for out in function(posture))
        np.testing.assert_allclose(value, policy(posture)[0], atol=1e-12)
        np.testing.assert_allclose(
            phi[:7], np.exp(-0.5 * ((posture - features.centres) ** 2).sum(1) / 0.64), atol=1e-12
        )


@pytest.fixture(scope="module")
def problem():
    return load_problem("screwing")


@pytest.mark.slow
def test_each_posture_is_answered_from_standstill(problem):
    rng = np.random.default_rng(0)
    postures = problem.response.comfort + 0.2 * rng.normal(size=(3, 32))
    together = twists_of(problem, postures, periods=10)
    alone = np.concatenate([twists_of(problem, posture, periods=10) for posture in postures])
    np.testing.assert_array_equal(together, alone)
    assert (np.abs(together) <= problem.twist_limit.speed + 1e-9).all()
    assert (
        np.abs(twists_of(problem, postures, 1))
        <= problem.twist_limit.acceleration * problem.dt + 1e-9
    ).all()
    planned = problem.replace(control=replace(problem.control, average=0.0))
    single = Stepper(planned).step(postures[0]).twist
    np.testing.assert_array_equal(twists_of(problem, postures[0], 1)[0], single)


def test_directions_and_angles(problem):
    speed = problem.twist_limit.speed
    twists = np.array([speed, 2 * speed, np.zeros(6)])
    units = unit_twists(problem, twists)
    np.testing.assert_allclose(
        units, [np.ones(6) / np.sqrt(6), np.ones(6) / np.sqrt(6), np.zeros(6)], atol=1e-12
    )
    np.testing.assert_allclose(angles_deg(np.eye(6)[:2], np.eye(6)[[0, 0]]), [0, 90], atol=1e-6)
    assert np.isnan(angles_deg(units[2:], units[:1])).all()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: train(FEATURES, draw, downhill, 5.0, 0.1), "rate: got 5, allowed less than"),
        (lambda: train(FEATURES, draw, downhill, -1.0, 0.1), "train: got rate -1.0"),
        (lambda: train(FEATURES, draw, downhill, 0.1, 0.1, most_runs=1), "at least two runs"),
        (lambda: RadialFeatures(np.zeros((2, 1)), 0.0), "width: got 0.0"),
        (lambda: RadialFeatures(np.full((2, 1), np.nan), 1.0), "centres: got shape"),
        (lambda: RadialFeatures.evenly(1, 1, 5), "features: got 5 from 1 to 1"),
        (
            lambda: RadialFeatures.among(np.zeros((5, 2)), 6),
            "count: got 6, allowed 2 to the number of postures, 5",
        ),
        (
            lambda: solve(FEATURES, np.zeros((3, 1)), np.zeros((2, 1))),
            r"wanted: got shape \(2, 1\), allowed \(3, P\)",
        ),
        (
            lambda: solve(FEATURES, np.zeros((3, 1)), np.zeros((3, 1)), ridge=-1.0),
            "ridge: got -1.0",
        ),
        (lambda: twists_of(load_problem("screwing"), np.zeros(32), 0), "periods: got 0"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(InputError, match=message):
        call()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["alike", "follower"])
def test_a_demonstration_shows_who_holds_the_object_all_over_the_workspace(kind):
    problem = load_problem("screwing")
    person = person_of_kind(kind, problem, 3)
    postures, poses = demonstrate(problem, person.hold(person.comfort), 60.0, seed=1)
    assert 250 < len(postures) == len(poses) <= 300
    box, cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
    places = poses[40:, :3, 3]
    assert (places >= np.array(box.lower) - 1e-6).all()
    assert (places <= np.array(box.upper) + 1e-6).all()
    assert (np.ptp(places, axis=0) > 0.4 * np.subtract(box.upper, box.lower)).all()
    toward = np.array(cone.direction) / np.linalg.norm(cone.direction)
    assert (poses[40:, :3, 0] @ toward >= np.cos(np.radians(cone.half_angle_deg)) - 1e-6).all()
    # The hand is at the object, or as far behind as its delay makes it.
    held = replace(problem.response, body=person.body)
    hands = np.array([np.array(held.contact()(q)[0])[:3, 3] for q in postures])
    assert np.linalg.norm(hands - poses[:, :3, 3], axis=1).max() < 0.06
    other, _ = demonstrate(problem, person.hold(person.comfort), 10.0, seed=2)
    assert not np.allclose(other[-1], postures[len(other) - 1])


def test_a_policy_follows_a_direction_no_faster_than_the_object_may():
    problem, rng = load_problem("screwing"), np.random.default_rng(4)
    postures = problem.response.comfort + rng.normal(size=(300, 32)) * np.r_[[0.3] * 3, [0] * 29]
    q, speed = ca.MX.sym("q", 32), problem.twist_limit.speed
    wanted = 100 * ca.vertcat(1 + q[0], -1 + q[1], q[2], 0, 0, 0.02)
    for down, fast in ((wanted, True), (1e-4 * wanted, False)):
        training = follow(problem, ca.Function("down", [q], [down]), postures, 40)
        assert training.converged
        told = np.array([np.array(ca.Function("d", [q], [down])(row)).ravel() for row in postures])
        sent = training.policy(postures)
        assert np.median(angles_deg(sent, told)) < 10
        largest = np.abs(sent / speed).max(axis=1)
        expected = 1.0 if fast else GRADIENT_GAIN * np.abs(told / speed).max(axis=1)
        assert np.abs(largest / expected - 1).mean() < 0.1
    frozen = problem.replace(
        limits=[
            replace(limit, axes=("x", "y", "z")) if isinstance(limit, TwistLimit) else limit
            for limit in problem.limits
        ]
    )
    still = follow(frozen, ca.Function("down", [q], [wanted]), postures, 40)
    assert not still.policy(postures)[:, 3:].any()
