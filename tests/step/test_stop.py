"""The stop that a step was certified for, told before it is needed."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from step_calls import start_of
from step_samples import held_pose, near_comfort, problem_of

import ergoqp
from ergoqp.step.certification import stop_function
from ergoqp.step.model import StepModel
from ergoqp.step.stepper import Stepper


def moving(average: float | None, log: list | None = None) -> ergoqp.Stepper:
    problem = ergoqp.load_problem("screwing")
    if average is not None:
        problem = problem.replace(control=ergoqp.Control(average=average))
    stepper = ergoqp.Stepper(problem, log=None if log is None else log.append)
    bent = problem.response.comfort.copy()
    bent[0] = 0.9
    for _ in range(15):
        step = stepper.step(bent)
    assert np.abs(step.twist).max() > 0.05
    return stepper


@pytest.mark.slow
@pytest.mark.parametrize("average", [None, 0.0, 0.1])
def test_it_is_what_brake_returns_until_the_object_stands(average: float | None) -> None:
    stepper = moving(average)
    ahead = stepper.stop()
    assert ahead.shape[1] == 6
    assert len(ahead) > 5
    assert not ahead[-1].any()
    assert ahead[:-1].any(axis=1).all()
    np.testing.assert_array_equal(ahead, [stepper.brake().twist for _ in ahead])


@pytest.mark.slow
def test_nothing_changes_by_asking_for_it() -> None:
    log: list = []
    asked, other = moving(None, log), moving(None)
    entries = len(log)
    asked.stop()
    assert len(log) == entries
    comfort = asked.problem.response.comfort
    np.testing.assert_array_equal(asked.step(comfort).twist, other.step(comfort).twist)
    assert len(log) == entries + 1


@pytest.mark.slow
def test_at_rest_it_is_one_zero() -> None:
    stepper = ergoqp.Stepper(ergoqp.load_problem("screwing"))
    np.testing.assert_array_equal(stepper.stop(), np.zeros((1, 6)))


AVERAGES = [None, 0.0, 0.004, 0.01, 0.1]
LATE = ergoqp.DeclaredRobot(delay=0.1, lag=0.05, pose_delay=0.02)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
@pytest.mark.parametrize("declared", [False, True])
@pytest.mark.parametrize("dt", [0.01, 0.002, 0.1])
@pytest.mark.parametrize("average", AVERAGES)
def test_in_closed_form_it_is_what_brake_returns(
    average: float | None, dt: float, declared: bool
) -> None:
    """After uneven periods (too short ones, too), lost frames, ramps, take-overs, and outside."""
    problem, rng = problem_of("dentist" if declared else "screwing"), np.random.default_rng(2)
    problem = problem.replace(dt=dt, control=ergoqp.Control(average=average))
    problem = problem.replace(robot=LATE) if declared else problem
    stepper, statuses, moving = Stepper(problem), set(), 0
    closed = stop_function(StepModel(problem))
    posture, pose = near_comfort(problem.name, rng, 30), held_pose(problem.name)
    for number in range(60):
        if number % 6 == 0:
            stepper.reset(twist=rng.uniform(-1.5, 1.5, 6) * problem.twist_limit.speed)
            pose[2, 3] = held_pose(problem.name)[2, 3] + 0.6 * (number % 12 == 0)
        if number % 7 == 3:
            step = stepper.brake(elapsed=rng.uniform(0, 0.1))
        elif number % 7 == 5:
            step = stepper.step(None, dt=dt * rng.uniform(0.3, 3))
        else:
            step = stepper.step(posture, pose, dt=dt * rng.choice([0.2, 0.5, 1, 1, 1, 2, 3]))
        statuses.add(step.status)
        state, expected = stepper.state(), stepper.stop()
        found, kept = closed(state, problem.dt), state.copy()
        np.testing.assert_array_equal(state, kept)
        np.testing.assert_array_equal(stepper.state(), kept)
        moving += found.any()
        assert not found[-1].any()
        assert found[:-1].any(axis=1).all()
        # A stop may end with twists of 1e-17, or not.
        both = min(len(found), len(expected))
        np.testing.assert_allclose(found[:both], expected[:both], atol=1e-14, rtol=0)
        for rest in (found[both:], expected[both:]):
            assert not (np.abs(rest) > 1e-14).any()
    assert "recovering" in statuses
    assert moving > 3


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_compiled_it_is_in_closed_form_except_along_a_surface() -> None:
    fast = Stepper(problem_of("screwing"), compiled=True)
    plain = Stepper(problem_of("screwing"))
    posture = near_comfort("screwing", np.random.default_rng(1), 30)
    for stepper in (fast, plain):
        for _ in range(15):
            stepper.step(posture)
    before, expected = fast.state(), plain.stop()
    np.testing.assert_allclose(fast.stop(), expected, atol=1e-9)
    np.testing.assert_array_equal(fast.state(), before)
    assert len(expected) > 3
    # Braking along the length of a forearm is no straight line.
    points = Stepper(problem_of("forearm"), compiled=True)
    start = start_of(points.problem) + 0.02 * np.random.default_rng(1).normal(size=6)
    for _ in range(10):
        points.step(start)
    stop = points.stop()
    assert stop[0].any()
    np.testing.assert_array_equal(stop, [points.brake().twist for _ in stop])
