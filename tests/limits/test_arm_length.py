import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ergoqp
from ergoqp.errors import InputError, ProblemError
from ergoqp.limits import ArmLength, JointLimit, TwistLimit
from ergoqp.limits.state import RETURN
from ergoqp.responses import IkResponse, LinearResponse
from ergoqp.simulation.check import Checker
from ergoqp.step.stepper import Stepper

LENGTH = 0.26
SPEED = TwistLimit(0.15, 0.15, 1.5, 1.5)


class Toward:
    """Cost that pulls elbow and wrist to places that the forearm's length may not allow."""

    name, minimum = "toward", 0.0

    def __init__(self, goal):
        self.goal = np.asarray(goal, dtype=float)

    def expression(self, q):
        return 20 * ca.sumsqr(q - ca.DM(self.goal))

    def __call__(self, points):
        return 20 * ((np.atleast_2d(points) - self.goal) ** 2).sum(axis=1)


def problem(goal, length=LENGTH, speed=SPEED):
    control = ergoqp.Control(comfort=0.0)
    return ergoqp.Problem(
        cost=Toward(goal),
        response=LinearResponse(),
        limits=[speed, ArmLength(length)],
        control=control,
        name="arm",
    )


def a_pair(rng):
    elbow, direction = rng.uniform(-0.4, 0.4, 3), rng.normal(size=3)
    return np.concatenate([elbow, elbow + LENGTH * direction / np.linalg.norm(direction)])


@pytest.mark.parametrize("seed", range(4))
def test_the_length_holds_at_every_step_and_so_do_the_bounds(seed):
    rng = np.random.default_rng(seed)
    task = problem(rng.uniform(-0.6, 0.6, 6))
    stepper, checker = Stepper(task), Checker(task)
    state, previous = a_pair(rng), np.zeros(6)
    start = float(task.cost(state)[0])
    for _ in range(900):
        step = stepper.step(state)
        assert checker.check(step.twist, previous, np.eye(4), state, step.posture_rate, 0.01) == []
        state, previous = state + step.twist * 0.01, step.twist
        assert abs(np.linalg.norm(state[3:] - state[:3]) - LENGTH) <= 1e-12
    assert task.cost(state)[0] < start
    assert step.status == "settled"
    assert not step.twist.any()


def test_it_ends_where_the_cost_is_lowest_at_this_length():
    goal = np.array([0.1, -0.2, 0.3, 0.1, -0.2, 0.9])
    task = problem(goal)
    stepper, state = Stepper(task), a_pair(np.random.default_rng(5))
    for _ in range(1500):
        state = state + stepper.step(state).twist * 0.01
    # The nearest pair of this length lies along the goal's own line, both ends missing the same.
    short = (0.6 - LENGTH) / 2
    assert state == pytest.approx([0.1, -0.2, 0.3 + short, 0.1, -0.2, 0.9 - short], abs=0.02)


def test_a_wrong_length_is_mended_within_the_bounds_and_announced():
    task = problem(np.array([0.1, 0.1, 0.1, 0.36, 0.1, 0.1]))
    stepper, checker = Stepper(task), Checker(task)
    state, previous = np.array([0.0, 0.0, 0.0, LENGTH + 2e-3, 0.0, 0.0]), np.zeros(6)
    first = stepper.step(state)
    assert first.status == "recovering"
    assert "arm length" in first.reason
    stepper.reset()
    for _ in range(600):
        step = stepper.step(state)
        assert checker.check(step.twist, previous, np.eye(4), state, step.posture_rate, 0.01) == []
        state, previous = state + step.twist * 0.01, step.twist
    assert abs(np.linalg.norm(state[3:] - state[:3]) - LENGTH) < 1e-9


@given(st.integers(0, 10_000))
@settings(max_examples=50, deadline=None)
def test_projection_reaches_the_length_by_the_shortest_way(seed):
    rng = np.random.default_rng(seed)
    limit, points = ArmLength(LENGTH), rng.uniform(-1, 1, (5, 6))
    projected = limit.project(points)
    apart = projected[:, 3:] - projected[:, :3]
    assert np.linalg.norm(apart, axis=1) == pytest.approx(LENGTH, abs=1e-12)
    way = np.linalg.norm(projected - points, axis=1)
    for _ in range(20):
        other = limit.project(projected + rng.normal(size=projected.shape) * 0.05)
        assert (np.linalg.norm(other - points, axis=1) >= way - 1e-12).all()


def test_the_retracted_twist_leads_to_the_projection():
    rng = np.random.default_rng(3)
    limit, state, twist = ArmLength(LENGTH), a_pair(rng), rng.uniform(-0.1, 0.1, 6)
    q, xi = ca.SX.sym("q", 6), ca.SX.sym("xi", 6)
    function = ca.Function("f", [q, xi], [limit.retract(q, xi, ca.SX(0.02), ca.DM([1.0]))])
    moved = state + np.array(function(state, twist)).ravel() * 0.02
    assert moved == pytest.approx(limit.project(state + twist * 0.02)[0], abs=1e-12)


def test_the_bow_bounds_how_far_an_arc_strays_from_its_tangent():
    limit = ArmLength(LENGTH)
    q, apart = ca.SX.sym("q", 6), ca.SX.sym("apart")
    function = ca.Function("bow", [q, apart], list(limit.bow(q, apart)))
    state = np.array([0.0, 0.0, 0.0, LENGTH, 0.0, 0.0])
    for way in np.linspace(0.001, 0.1, 20):
        pull, rest = (np.array(part).ravel() for part in function(state, way))
        angle = way / LENGTH
        straight = np.array([0.0, way / 2, 0.0, 0.0, -way / 2, 0.0])
        # Both points turn about their middle.
        turn = (
            LENGTH
            / 2
            * np.array(
                [1 - np.cos(angle), np.sin(angle), 0, -(1 - np.cos(angle)), -np.sin(angle), 0]
            )
        )
        assert np.linalg.norm(turn - straight - pull) <= rest[0] + LENGTH * angle**4 / 24


@pytest.mark.parametrize("length", [0.0, -1.0, np.inf, np.nan])
def test_a_length_that_is_none_is_refused(length):
    with pytest.raises(InputError, match="arm length"):
        ArmLength(length)


def test_speeds_that_leave_no_acceleration_are_refused():
    with pytest.raises(InputError, match="lower the speed or raise the acceleration"):
        Stepper(problem(np.zeros(6), speed=TwistLimit(0.5, 0.5, 0.5, 0.5)))


def test_limits_of_another_state_are_refused():
    with pytest.raises(ProblemError, match="JointLimit"):
        ergoqp.Problem(
            cost=Toward(np.zeros(6)), response=LinearResponse(), limits=[SPEED, JointLimit()]
        )
    with pytest.raises(ProblemError, match="elbow_x"):
        ergoqp.Problem(
            cost=Toward(np.zeros(32)),
            response=IkResponse(),
            limits=[TwistLimit(), ArmLength(LENGTH)],
        )
    with pytest.raises(ProblemError, match="elbow_x"):
        ergoqp.Problem(
            cost=Toward(np.zeros(6)),
            response=LinearResponse(matrix=2 * np.eye(6)),
            limits=[SPEED, ArmLength(LENGTH)],
        )


def test_what_is_set_aside_is_what_turning_takes_and_the_mending():
    """Two points that circle each other at a relative speed v at a distance L: each is pulled in by
    v^2 / (2 L)."""
    limit = TwistLimit(0.15, 0.15, 1.5, 1.5)
    apart, dt = np.linalg.norm(2 * limit.speed[:3]), 1e-4
    angles = apart / LENGTH * np.array([-dt, 0, dt])
    point = LENGTH / 2 * np.column_stack([np.cos(angles), np.sin(angles)])
    pulled = np.linalg.norm(point[0] - 2 * point[1] + point[2]) / dt**2
    assert ArmLength(LENGTH).aside(limit) == pytest.approx(pulled + RETURN * 1.5, rel=1e-6)
