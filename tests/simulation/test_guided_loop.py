"""Whole loops with a place to be drawn to: better where descent stays at a worse place, and never
worse than it."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from ergoqp.placing.optimise import optimise
from ergoqp.problem.geometry import frame_of
from ergoqp.problem.load import load_problem
from ergoqp.problem.problem import Problem
from ergoqp.rest.model_person import ModelPerson, sample_person
from ergoqp.simulation.run import Run, summary_of_run
from ergoqp.simulation.simulate import simulate
from ergoqp.step.guide import read_guide

THERE, WAITING = "drawn toward the given place", "at the given place, waiting for the person"
BACK = "drawn back to where it was better than at the given place"


@cache
def overhead() -> tuple[Problem, ModelPerson, np.ndarray]:
    """A person far to the right of a low panel: descent comes to rest two points above what is
    possible."""
    problem = load_problem("overhead")
    person = sample_person(problem, 1)
    comfort = person.response.comfort
    posture, reached = person.settle(
        comfort, place(0.30, -0.45, 1.75), person.grasp(comfort), person.stand(comfort)
    )
    assert reached
    return problem, person, posture


def place(x: float, y: float, z: float) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = frame_of(np.array([0.3, 0.0, 0.95])), (x, y, z)
    return pose


@cache
def led(way: str) -> Run:
    problem, person, posture = overhead()
    guides = {
        "alone": lambda: None,
        "optimum": lambda: optimise(problem, problem.response.comfort, starts=8),  # type: ignore
        "worse": lambda: place(0.20, 0.18, 1.98),
    }
    return simulate(problem, posture, duration=16.0, seed=0, person=person, guide=guides[way]())


@pytest.mark.slow
def test_descent_stays_at_a_worse_place_and_the_optimum_leads_out_of_it() -> None:
    alone, guided = led("alone"), led("optimum")
    assert alone.statuses[-1] == guided.statuses[-1] == "settled"
    assert alone.reba[0] == guided.reba[0] == 5
    assert alone.reba[-100:].min() == 4
    assert guided.reba[-100:].max() == 2
    assert sum(guided.violations.values()) == 0
    assert THERE in guided.reasons
    assert WAITING in guided.reasons
    # Until descent comes to rest it is the same loop.
    begins = guided.reasons.index(THERE)
    np.testing.assert_array_equal(guided.twists[: begins - 1], alone.twists[: begins - 1])
    assert begins > 40


@pytest.mark.slow
def test_a_worse_place_is_tried_once_and_left_again() -> None:
    alone, guided = led("alone"), led("worse")
    assert THERE in guided.reasons
    assert guided.reba[-100:].max() <= alone.reba[-100:].min()
    assert sum(guided.violations.values()) == 0
    assert guided.statuses[-1] == "settled"
    left = [i for i, reason in enumerate(guided.reasons) if reason in (THERE, BACK)]
    assert len(guided.reasons) - left[-1] > 100
    begun = np.flatnonzero(
        np.diff(np.array([reason == THERE for reason in guided.reasons], dtype=int)) > 0
    )
    assert begun.size == 1


@pytest.mark.slow
def test_a_run_tells_its_place() -> None:
    assert led("alone").guide is None
    assert summary_of_run(led("alone"))["guide"] is None
    guided = led("worse")
    assert any(
        "guide is the place (0.20, 0.18, 1.98) m" in sentence for sentence in guided.assumptions
    )
    told = summary_of_run(guided)["guide"]
    assert told["position_m"] == pytest.approx([0.20, 0.18, 1.98])
    assert told["promise"] is None
    assert summary_of_run(led("optimum"))["guide"]["promise"] == pytest.approx(2.5, abs=0.2)


@pytest.mark.slow
def test_a_place_that_is_read_once_is_the_same_guide() -> None:
    problem, person, posture = overhead()
    once = simulate(problem, posture, duration=0.3, person=person, guide=place(0.4, 0.0, 1.7))
    read = simulate(
        problem,
        posture,
        duration=0.3,
        person=person,
        guide=read_guide(problem, place(0.4, 0.0, 1.7)),
    )
    np.testing.assert_array_equal(once.twists, read.twists)
