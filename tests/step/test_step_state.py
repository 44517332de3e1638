"""The state of a loop: all that its calls leave to the next one, as one vector."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from step_calls import wandering_steps
from step_samples import held_pose, near_comfort, problem_of

import ergoqp
from ergoqp.errors import InputError
from ergoqp.problem.settings import DeclaredRobot
from ergoqp.step.stepper import Stepper

LATE = DeclaredRobot(delay=0.03, lag=0.05, pose_delay=0.02, pose_noise=0.001)


def walked(stepper: Stepper, count: int, seed: int) -> list[dict[str, Any]]:
    """The calls of a bad day, made."""
    return [call for call, _ in wandering_steps(stepper.problem, stepper, count, seed)]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["plain", "late", "guided", "points"])
def test_from_a_state_the_loop_goes_on_as_it_did(kind: str) -> None:
    """Lost frames included: what is left of the last posture is in the state."""
    problem = problem_of("forearm" if kind == "points" else "screwing")
    problem = problem.replace(robot=LATE) if kind == "late" else problem
    guide = held_pose("screwing") if kind == "guided" else None
    one, other = Stepper(problem, guide=guide), Stepper(problem, guide=guide)
    walked(one, 60, 1)
    state = one.state()
    more = [{"posture": None}, *walked(one, 40, 2)]
    other.restore(state)
    one.restore(state)
    for call in more:
        first, second = one.step(**call), other.step(**call)
        np.testing.assert_array_equal(first.values, second.values)
    np.testing.assert_array_equal(one.state(), other.state())
    np.testing.assert_array_equal(one.brake().twist, other.brake().twist)


@pytest.mark.slow
def test_it_is_the_state_of_the_function() -> None:
    problem, posture = problem_of("screwing"), near_comfort("screwing", np.random.default_rng(1))
    stepper, state = Stepper(problem), ergoqp.initial_state(problem)
    function, n = ergoqp.step_function(problem), len(posture)
    np.testing.assert_array_equal(state, stepper.state())
    for _ in range(20):
        found = function(
            posture=posture, observed=np.ones(n), dt=0.01, frame=1, enable=1, state=state
        )
        state = found["next_state"].full().ravel()
        step = stepper.step(posture)
        np.testing.assert_array_equal(found["twist"].full().ravel(), step.twist)
        np.testing.assert_array_equal(state, stepper.state())
    assert step.twist.any()


def test_it_is_that_of_a_guide_or_of_a_moving_object_where_asked() -> None:
    problem, moving = problem_of("screwing"), np.array([9.0, 0.01, 0, 0, 0.1, -9])
    stepper = Stepper(problem, guide=held_pose("screwing"))
    np.testing.assert_array_equal(ergoqp.initial_state(problem, guided=True), stepper.state())
    stepper.reset(twist=moving)
    state = ergoqp.initial_state(problem, moving, guided=True)
    np.testing.assert_array_equal(state, stepper.state())
    speed = problem.twist_limit.speed
    np.testing.assert_array_equal(state[:6], [speed[0], 0.01, 0, 0, 0.1, -speed[5]])


def _with_fault(state: np.ndarray, code: float) -> np.ndarray:
    changed = state.copy()
    changed[Stepper(problem_of("screwing"))._parts["fault"].start] = code
    return changed


@pytest.mark.slow
def test_hold_is_a_part_of_it() -> None:
    stepper, other = Stepper(problem_of("screwing")), Stepper(problem_of("screwing"))
    free = stepper.state()
    stepper.hold()
    other.restore(stepper.state())
    posture = near_comfort("screwing", np.random.default_rng(1))
    assert "held: the object stays at rest" in other.step(posture).reason
    assert "held" in other.brake().reason
    np.testing.assert_array_equal(other.stop(), np.zeros((1, 6)))
    other.restore(free)
    assert "held" not in other.step(posture).reason
    other.restore(stepper.state())
    other.try_again()
    assert "held" not in other.step(posture).reason


def test_the_caller_may_write_to_it() -> None:
    stepper = Stepper(problem_of("screwing"))
    posture = near_comfort("screwing", np.random.default_rng(1))
    step = stepper.step(posture)
    state = stepper.state()
    kept = state.copy()
    state[:], step.account("next_state")[:], step.twist[:] = 9.0, 9.0, 9.0
    for array in stepper.frame:
        array[:] = 9.0
    np.testing.assert_array_equal(stepper.state(), kept)
    np.testing.assert_array_equal(stepper.frame[0], posture)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda s: s[1:], r"state: got .*allowed \d+ finite numbers, as state\(\) returns them"),
        (lambda s: np.append(s, 0.0), "state: got"),
        (lambda s: np.where(np.arange(len(s)) == 99, np.nan, s), "state: got"),
        (lambda s: np.where(np.arange(len(s)) == 0, np.inf, s), "state: got"),
        (lambda s: "state", "state: got"),
        (lambda s: None, "state: got"),
        (lambda s: s.astype(complex), "state: got"),
        (lambda s: np.where(np.arange(len(s)) == 0, 0.5, s), r"state: got twists of up to \[0.5"),
        (lambda s: np.where(np.arange(len(s)) == 5, -5.0, s), "allowed within the speed limits"),
        (np.zeros_like, "state: got ages that do not grow from 0 s on"),
        (lambda s: _with_fault(s, 100.0), "state: got 100 for a fault, allowed"),
        (lambda s: _with_fault(s, 1.5), "state: got 1.5 for a fault, allowed"),
    ],
)
def test_what_is_no_state_is_one_sentence_and_changes_nothing(change: Any, sentence: str) -> None:
    stepper = Stepper(problem_of("screwing"))
    stepper.step(near_comfort("screwing", np.random.default_rng(1)))
    before = stepper.state()
    with pytest.raises(InputError, match=sentence) as raised:
        stepper.restore(change(before.copy()))
    assert "\n" not in str(raised.value)
    np.testing.assert_array_equal(stepper.state(), before)


def test_an_initial_state_is_that_of_a_problem() -> None:
    with pytest.raises(InputError, match="problem: got 'screwing', allowed a Problem"):
        ergoqp.initial_state("screwing")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="twist: got"):
        ergoqp.initial_state(problem_of("screwing"), [1.0, 2.0])
