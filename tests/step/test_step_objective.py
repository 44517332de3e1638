"""What the objective makes of an object that moves and improves nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from step_samples import Held, bold_of, held_pose, near_comfort, problem_of

from ergoqp.step.model import StepModel
from ergoqp.step.objective import gain_function
from ergoqp.step.qp import qp_data
from ergoqp.step.stepper import Stepper


def curvature(name: str, stalled: float, stall_after: float | None = None) -> np.ndarray:
    problem = problem_of(name)
    if stall_after is not None:
        problem = problem.replace(control=replace(problem.control, stall_after=stall_after))
    posture = near_comfort(name, np.random.default_rng(1), 20)
    given = {
        "posture": posture,
        "observed": np.ones(32),
        "pose": held_pose(name),
        "previous": np.zeros(6),
        "dt": 0.01,
    }
    return np.array(qp_data(problem)(**given, locked=np.zeros(32), final=0.0, stalled=stalled)["H"])


def test_the_longer_nothing_improves_the_dearer_it_is_to_move() -> None:
    """The object swung about the edge of a step of the cost: for 27 s where 8 s had been enough."""
    control, still = problem_of("overhead").control, curvature("overhead", 0.0)
    effort = np.diag(np.repeat([control.effort_linear, control.effort_angular], 3))
    assert np.array_equal(curvature("overhead", control.stall_after / 4), still)
    assert curvature("overhead", control.stall_after / 2) - still == pytest.approx(effort, abs=1e-9)
    assert curvature("overhead", control.stall_after) - still == pytest.approx(9 * effort, abs=1e-9)
    # Whoever still moves after twice that time is kept going by a limit.
    for stall_after in (control.stall_after, 0.5, 3.0):
        still, twice, later = (
            curvature("overhead", stalled, stall_after) for stalled in (0.0, 2 * stall_after, 100.0)
        )
        assert twice - still == pytest.approx(49 * effort, abs=1e-9)
        assert np.array_equal(twice, later)


def test_a_stepper_counts_for_how_long_nothing_improved() -> None:
    problem = bold_of("screwing")
    stepper, q = Stepper(problem), near_comfort("screwing", np.random.default_rng(5), 15)
    loop = Held(stepper, held_pose("screwing"))
    assert stepper.stalled == 0
    for number in range(30):
        loop.step(q)
        assert stepper.stalled == pytest.approx(0.01 * number)
    # A better posture, as soon as the filter believes it.
    for _ in range(60):
        loop.step(np.asarray(problem.response.comfort))  # type: ignore[attr-defined]
    assert stepper.stalled < 0.25
    stepper.reset()
    assert stepper.stalled == 0


def test_at_rest_nothing_is_dearer_so_that_what_a_move_would_gain_is_judged_as_ever() -> None:
    problem = problem_of("screwing")
    stepper = Stepper(problem)
    loop, comfort = Held(stepper, held_pose("screwing")), np.asarray(problem.response.comfort)
    statuses = [loop.step(comfort).status for _ in range(500)]
    assert statuses[-1] == "settled"
    assert stepper.stalled == 0


def test_without_a_time_to_stall_the_object_moves_as_ever() -> None:
    problem = problem_of("screwing")
    problem = problem.replace(control=replace(problem.control, stall_after=0.0))
    loop, q = (
        Held(Stepper(problem), held_pose("screwing")),
        near_comfort("screwing", np.random.default_rng(5), 15),
    )
    assert {loop.step(q).status for _ in range(5)} <= {"optimal", "settled"}


def test_a_twist_of_less_than_a_millionth_of_full_speed_promises_nothing() -> None:
    problem = problem_of("screwing")
    q, speed = near_comfort("screwing", np.random.default_rng(6), 20), problem.twist_limit.speed
    value = float(problem.cost(q)[0]) + 10.0
    S = np.array(problem.response.sensitivity()(q, np.zeros(32))[0])
    gain = gain_function(StepModel(problem))
    for pace, promises in ((1e-6, False), (1.01e-6, True)):
        xi = np.array([pace * speed[0], 0, 0, 0, 0, 0])
        assert xi[0] / speed[0] == pace
        assert (float(gain(q, value, xi, S)) > 0) == promises
