"""A loop around a person with mass: the controller is told of their robot, and the score falls."""

from __future__ import annotations

import numpy as np
import pytest

import ergoqp
from ergoqp.errors import InputError
from ergoqp.lab.mass import person as holding
from ergoqp.lab.mass.body import SOFT_ROBOT_DECLARED
from ergoqp.lab.mass.person import draw
from ergoqp.problem.load import load_problem
from ergoqp.problem.settings import DeclaredRobot
from ergoqp.rest.best_place import awkward_start
from ergoqp.simulation.loop import with_own_robot
from ergoqp.simulation.people import person_of_kind
from ergoqp.simulation.robot import RobotKind


@pytest.mark.slow
@pytest.mark.parametrize("name", ["dentist", "low_bin"])
def test_the_loop_helps_and_meets_no_fault_of_the_robot(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(holding, "STILL", 3.0)
    problem = load_problem(name)
    person = person_of_kind("mass", problem, seed=0)
    start = awkward_start(problem, person, seed=0, places=10)
    run = ergoqp.simulate(problem, start, duration=6.0, person=person)
    assert run.follower == "mass"
    assert not [reason for reason in run.reasons if reason.startswith("robot")]
    assert run.fell is None
    assert run.let_go is None
    assert run.unbalanced == 0.0
    assert np.isfinite(run.forces).all()
    assert min(run.cost[-100:]) < run.cost[0]
    assert any("spring and a damper" in sentence for sentence in run.assumptions)
    assert any("lag 80 ms" in sentence for sentence in run.assumptions)


def test_a_robot_that_a_problem_declares_stands_before_the_soft_one() -> None:
    problem = load_problem("desk")
    own = problem.replace(robot=DeclaredRobot(delay=0.02, lag=0.2, gain_error=0.02))
    mass, alike = (person_of_kind(kind, problem, 0) for kind in ("mass", "alike"))
    assert with_own_robot(problem, alike, None, 0) == (problem, None)
    told, robot = with_own_robot(problem, mass, None, 0)
    assert told.robot == SOFT_ROBOT_DECLARED
    assert robot == RobotKind()
    told, robot = with_own_robot(own, mass, None, 0)
    assert told.robot.lag == pytest.approx(0.2 + SOFT_ROBOT_DECLARED.lag)
    assert (told.robot.delay, told.robot.gain_error) == (0.02, 0.02)
    assert told.robot.pose_noise == SOFT_ROBOT_DECLARED.pose_noise
    assert robot is not None
    assert (robot.delay, robot.lag) == (0.02, 0.2)
    assert 0 < abs(robot.gain - 1) <= 0.02
    assert with_own_robot(own, mass, RobotKind(lag=0.1), 0)[1] == RobotKind(lag=0.1)


@pytest.mark.slow
def test_a_task_that_says_too_little_is_named() -> None:
    forearm = load_problem("forearm")
    with pytest.raises(InputError, match="allowed IkResponse"):
        person_of_kind("mass", forearm, 0)


@pytest.mark.slow
def test_people_differ_within_what_is_drawn() -> None:
    people = [draw(load_problem("screwing"), seed) for seed in range(60)]
    statures = [person.body.stature for person in people]
    assert min(statures) >= 1.50
    assert max(statures) <= 1.95
    assert np.ptp(statures) > 0.2
    assert {person.traits.sex for person in people} == {"female", "male"}
    compensation = [person.traits.compensation for person in people]
    assert 0.9 <= min(compensation) < max(compensation) <= 1.0
    assert all(0.0 <= person.senses.delay <= 0.3 for person in people)
