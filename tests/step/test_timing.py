"""How long a step can take: its largest number of operations, and its deadline."""

from __future__ import annotations

import json
import time
from typing import Any

import numpy as np
import pytest
from step_samples import comfort_of, near_comfort, problem_of

import ergoqp
from ergoqp.errors import InputError
from ergoqp.native.compiled import c_text
from ergoqp.simulation.robot import moved
from ergoqp.solvers import QpSolver, solver_named
from ergoqp.solvers.daqp import ITERATIONS
from ergoqp.step.function import build_shared_step, build_step
from ergoqp.step.qp import PASSES
from ergoqp.step.stepper import Stepper
from ergoqp.step.timing import LARGEST_ITERATIONS, StepTimes, _largest_step, benchmark_step

POSTURE = near_comfort("screwing", np.random.default_rng(3), 20)


class Counting(QpSolver):
    """A solver that keeps the sizes of its QPs."""

    def __init__(self) -> None:
        self.sizes: list[tuple[int, int]] = []

    def workspace(self, n: int, m: int, accuracy: float) -> Any:
        self.sizes.append((n, m))
        return solver_named("qrqp").workspace(n, m, accuracy)


class Slow:
    """A posture that takes its time to be read."""

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds

    def __array__(self, *_: object, **__: object) -> np.ndarray:
        time.sleep(self.seconds)
        return POSTURE


def test_the_largest_number_of_iterations_is_that_of_every_form() -> None:
    assert LARGEST_ITERATIONS == PASSES * ITERATIONS == 1500
    assert f"settings.iter_limit = {ITERATIONS};" in c_text("qp_daqp.h")


@pytest.mark.slow
@pytest.mark.parametrize("guided", [False, True])
def test_the_form_that_is_timed_takes_every_branch(guided: bool) -> None:
    """Three QPs, each with slack, where a plain step solves one without."""
    problem, state = problem_of("screwing"), None
    counts = {}
    for every_branch in (False, True):
        solver = Counting()
        function = build_step(problem, solver, guided=guided, every_branch=every_branch)
        state = ergoqp.initial_state(problem, guided=guided)
        given = {
            "posture": comfort_of("screwing"),
            "observed": np.ones(32),
            "dt": 0.01,
            "frame": 1,
            "enable": 1,
        }
        found = function(**given, state=state)
        assert np.isfinite(found["twist"].full()).all()
        counts[every_branch] = solver.sizes
    [(unknowns, rows)] = counts[False]
    assert unknowns == 6
    assert counts[True] == [(6 + rows, rows)] * PASSES


def test_the_form_that_is_timed_is_the_one_that_takes_every_branch() -> None:
    problem, solver = problem_of("forearm"), solver_named("daqp")
    timed = _largest_step(problem, compiled=False, guided=False)
    every, usual = (
        build_shared_step(problem, solver, "largest_step", every_branch=every)
        for every in (True, False)
    )
    assert timed.serialize() == every.serialize() != usual.serialize()


def test_nothing_is_compiled_that_was_not_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ergoqp.step.timing, "machine_code", lambda build: pytest.fail("compiled"))
    benchmark_step(problem_of("forearm"), steps=1)


@pytest.mark.slow
def test_its_times_add_up() -> None:
    times = benchmark_step(problem_of("forearm"), steps=10)
    assert isinstance(times, StepTimes)
    assert 0 < times.median_us <= times.p99_us <= times.max_us
    assert 0 < times.operations_us < times.worst_us
    assert times.worst_us == times.operations_us + 1500 * times.iteration_us
    assert benchmark_step(problem_of("screwing"), dt=0.02, guided=True, steps=1).max_us > 0


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"problem": "screwing"}, "problem: got 'screwing'"),
        ({"steps": 0}, "steps: got 0"),
        ({"dt": 7.0}, "dt: got 7.0 s"),
        ({"compiled": "yes"}, "compiled: got"),
    ],
)
def test_what_it_cannot_measure_is_one_sentence(given: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        benchmark_step(**{"problem": problem_of("screwing"), **given})


@pytest.mark.slow
def test_a_step_after_its_deadline_brakes_and_says_so() -> None:
    log: list = []
    stepper = Stepper(problem_of("screwing"), deadline=0.05, log=log.append)
    usual = Stepper(problem_of("screwing"))
    for _ in range(20):
        one, other = stepper.step(POSTURE), usual.step(POSTURE)
    if "deadline" in one.reason:
        pytest.skip("the machine is too slow for a step of 50 ms")
    assert one.twist.tobytes() == other.twist.tobytes()
    before, entries = stepper.state(), len(log)
    pose = moved(one.pose, one.twist * stepper.dt)
    pose[0, 3] += 3e-4
    late = stepper.step(Slow(0.06), pose)
    assert late.status == "braking"
    assert late.reason.startswith("the step took ")
    assert late.reason.endswith(" ms, allowed 50 ms (deadline)")
    assert late.solve_time > 0.06
    usual.restore(before)
    np.testing.assert_array_equal(late.twist, usual.brake().twist)
    # What was measured is not lost.
    np.testing.assert_allclose(late.pose, pose, atol=1e-12)
    np.testing.assert_array_equal(stepper.state(), late.account("next_state"))
    # Two records, one step, and the same answer.
    assert len(log) == entries + 2
    again = ergoqp.replay(problem_of("screwing"), json.loads(json.dumps(log)))
    assert len(again) == 21
    assert again[-1].twist.tobytes() == late.twist.tobytes()
    assert again[-1].reason == late.reason
    assert "deadline" not in stepper.step(POSTURE).reason


@pytest.mark.slow
def test_a_deadline_counts_from_the_call_and_only_if_there_is_one() -> None:
    assert "deadline" not in Stepper(problem_of("screwing")).step(Slow(0.02)).reason
    stepper = Stepper(problem_of("screwing"), deadline=1e-5)
    assert "deadline" in stepper.step(POSTURE).reason
    assert "deadline" not in stepper.brake().reason


@pytest.mark.parametrize("deadline", [0.0, -1.0, float("nan"), "soon", True])
def test_what_is_no_deadline_is_one_sentence(deadline: Any) -> None:
    with pytest.raises(InputError, match=r"deadline: got .*allowed"):
        Stepper(problem_of("screwing"), deadline=deadline)
