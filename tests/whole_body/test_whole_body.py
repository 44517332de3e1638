"""The whole body's step: the object's own twist where the robot has no limits, and one within its limits where it has."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("mink")

import ergoqp
from ergoqp.simulation.best import draw_starts
from ergoqp.simulation.people import Senses, sample_person
from ergoqp.whole_body import WholeBody, load_robot
from ergoqp.whole_body.loop import run_whole_body


def without_limits():
    """The Panda's tree without ranges, rates and accelerations to speak of."""
    robot = load_robot("panda")
    k = np.ones(len(robot.joints))
    return replace(robot, lower=robot.lower - 50, upper=robot.upper + 50, velocity=1e3 * k, acceleration=1e6 * k)


@pytest.mark.parametrize("name", ["screwing", "desk", "low_bin"])
def test_without_limits_of_the_robot_it_is_the_twist_of_the_fast_step(name):
    problem = ergoqp.load_problem(name)
    person = sample_person(problem, 0, body=problem.response.body)
    start = draw_starts(problem, person, 1, 0, 3)[0]
    whole = WholeBody(problem, without_limits(), posture=start.posture, distance=None)
    trace = run_whole_body(whole, person, start, duration=2.5, senses=Senses())
    compared = [step for step in trace.steps if step.object_step.status in ("optimal", "relaxed", "recovering")]
    compared = [step for step in compared if step.object_step.residuals["accepted"] == 1]
    assert len(compared) > 150
    assert max(np.abs(step.twist).max() for step in compared) > 0.04
    assert max(np.abs(step.twist - step.object_step.twist).max() for step in compared) < 1e-8
