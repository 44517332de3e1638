"""Whole loops with people who are not the model: no violation, no exception, nobody worse off."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.loops import power_above
from ergoqp.joints import LOWER, UPPER
from ergoqp.problem.geometry import frame_of
from ergoqp.problem.load import TASKS, load_problem
from ergoqp.problem.settings import DeclaredRobot
from ergoqp.rest.model_person import sample_person
from ergoqp.rest.person_protocol import SensorModel, frames
from ergoqp.simulation.check import Checker
from ergoqp.simulation.loop import run_loop, settle_time
from ergoqp.simulation.robot import RobotKind, moved
from ergoqp.step.stepper import Stepper


def starts_of(problem, person, seed: int, count: int = 2):
    """Settled postures at random places of the workspace, without the brute-force map."""
    from ergoqp.limits import AxisCone, WorkspaceBox

    rng = np.random.default_rng(seed)
    box, cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
    comfort = person.response.comfort
    soles, grasp, found = person.stand(comfort), person.grasp(comfort), []
    for _ in range(60):
        pose = np.eye(4)
        pose[:3, :3] = frame_of(np.asarray(cone.direction))
        pose[:3, 3] = rng.uniform(box.lower, box.upper)
        posture, reached = person.settle(comfort, pose, grasp, soles)
        if reached and problem.assess(posture).final[0] >= 3:
            found.append(person.start_at(posture))
        if len(found) == count:
            break
    return found


@pytest.mark.slow
@pytest.mark.parametrize("name", TASKS)
def test_a_loop_breaks_no_limit_and_leaves_nobody_worse_off(name: str) -> None:
    problem = load_problem(name)
    person, stepper = sample_person(problem, seed=3), Stepper(problem)
    starts = starts_of(problem, person, seed=1)
    assert starts
    changes = []
    for number, start in enumerate(starts):
        checker = Checker(problem)
        trace = run_loop(
            problem,
            person.holding(start),
            duration=6.0,
            seed=number,
            controller=stepper,
            checker=checker,
        )
        assert sum(checker.violations.values()) == 0, checker.max_violation
        assert "invalid" not in {step.status for step in trace.steps}
        assert np.isfinite(trace.twists).all()
        postures = np.array(trace.postures)
        assert np.all(postures >= LOWER - 1e-9)
        assert np.all(postures <= UPPER + 1e-9)
        begin, end = problem.assess(postures[[0, -1]]).final
        smooth = problem.cost(postures[[0, -1]])
        changes.append((end - begin, smooth[1] - smooth[0]))
    assert max(change for change, _ in changes) <= 1
    assert np.mean([change for _, change in changes]) <= 0.05


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_a_robot_as_bad_as_declared_breaks_no_limit_and_is_no_fault(seed: int) -> None:
    robot = DeclaredRobot(
        delay=0.02, lag=0.08, gain_error=0.05, pose_delay=0.02, pose_noise=5e-4, pose_noise_deg=0.1
    )
    problem = load_problem("screwing").replace(robot=robot)
    person = sample_person(problem, seed=3)
    start, checker = starts_of(problem, person, seed=seed, count=1)[0], Checker(problem)
    trace = run_loop(problem, person.holding(start), duration=4.0, seed=seed, checker=checker)
    assert sum(checker.violations.values()) == 0, checker.max_violation
    assert not [step.reason for step in trace.steps if "robot:" in step.reason]
    assert np.linalg.norm(trace.poses[-1][:3, 3] - start.pose[:3, 3]) > 0.03
    # The robot is really that late: the object moves less in the first tenth of a second than it
    # was sent.
    moves = next(number for number, twist in enumerate(trace.twists) if twist.any())
    sent = sum(np.abs(twist[:3]) * 0.01 for twist in trace.twists[moves : moves + 10])
    went = np.abs(trace.poses[moves + 10][:3, 3] - trace.poses[moves][:3, 3])
    assert np.all(went < 0.5 * sent + 1e-12)


@pytest.mark.slow
def test_a_robot_that_was_not_declared_is_named_and_stopped() -> None:
    problem = load_problem("screwing")
    person = sample_person(problem, seed=3)
    start, checker = starts_of(problem, person, seed=1, count=1)[0], Checker(problem)
    trace = run_loop(
        problem,
        person.holding(start),
        duration=4.0,
        seed=0,
        checker=checker,
        robot=RobotKind(lag=0.2),
    )
    assert sum(checker.violations[name] for name in ("speed", "acceleration", "axes", "jerk")) == 0
    named = [step for step in trace.steps if "robot:" in step.reason]
    assert named
    assert {step.status for step in named} == {"braking"}


@pytest.mark.slow
def test_a_loop_is_the_same_for_the_same_seed_and_another_for_another() -> None:
    problem = load_problem("dentist")
    person = sample_person(problem, seed=1)
    start = person.start_at(person.response.comfort)
    one, same, other = (
        run_loop(problem, person.holding(start), duration=0.5, seed=seed) for seed in (1, 1, 2)
    )
    assert np.array(one.twists).tobytes() == np.array(same.twists).tobytes()
    assert np.array(one.twists).tobytes() != np.array(other.twists).tobytes()


@pytest.mark.slow
def test_lost_frames_and_blind_joints_stop_nothing() -> None:
    problem = load_problem("dentist")
    person = sample_person(problem, seed=1)
    start, checker = person.start_at(person.response.comfort), Checker(problem)
    seen = np.random.default_rng(0).random(32) > 0.3
    senses = SensorModel(lost=0.3)
    trace = run_loop(
        problem, person.holding(start, senses), duration=1.0, seed=1, observed=seen, checker=checker
    )
    assert sum(checker.violations.values()) == 0, checker.max_violation
    assert any(step.status == "braking" for step in trace.steps) or len(trace.steps) == 100
    blind = run_loop(problem, person.holding(start, SensorModel(lost=1.0)), duration=0.5, seed=1)
    assert {step.status for step in blind.steps[12:]} == {"braking"}
    assert np.abs(blind.twists[-1]).max() == 0


def test_people_are_the_same_for_the_same_seed_and_not_the_model() -> None:
    problem = load_problem("screwing")
    one, same, other = (sample_person(problem, seed).response for seed in (5, 5, 6))
    assert one.weights == same.weights
    assert one.weights != other.weights
    factors = one.weight_vector / problem.response.weight_vector
    assert np.all((factors >= 0.5 - 1e-9) & (factors <= 2 + 1e-9))
    assert factors.std() > 0.1
    assert 0 < abs(one.body.stature - problem.response.body.stature) <= 0.10  # type: ignore


def test_noise_and_lost_frames_are_as_announced() -> None:
    seen = frames(SensorModel(), 0.01, np.random.default_rng(0))
    errors, arrives = zip(*(next(seen) for _ in range(20_000)), strict=True)
    assert np.mean(arrives) == pytest.approx(0.99, abs=0.003)
    white = np.diff(np.array(errors), axis=0).std() / np.sqrt(2)
    assert np.degrees(white) == pytest.approx(0.5, rel=0.03)
    slow = np.array(errors).reshape(200, 100, 32).mean(axis=1)
    assert np.degrees(slow.std()) == pytest.approx(1.0, rel=0.25)


def test_yardsticks_of_a_twist() -> None:
    time = np.arange(0, 4, 0.01)
    slow, fast = (np.sin(2 * np.pi * f * time)[:, None] * np.ones(6) for f in (1.0, 10.0))
    speed = np.ones(6)
    assert power_above(slow, 0.01, speed) < 0.01
    assert power_above(fast, 0.01, speed) > 0.99
    assert power_above(0 * slow, 0.01, speed) == 0


def test_settling_is_when_the_object_rests_for_good() -> None:
    from ergoqp.simulation.loop import Trace

    twists = [np.full(6, float(40 <= i < 60)) for i in range(400)]
    assert settle_time(Trace(time=[0.01 * i for i in range(400)], twists=twists)) == pytest.approx(
        0.59
    )
    restless = [np.ones(6)] * 400
    assert settle_time(Trace(time=[0.01 * i for i in range(400)], twists=restless)) == float("inf")


def test_moved_turns_about_the_axis_and_stays_a_rotation() -> None:
    pose = np.eye(4)
    quarter = moved(pose, np.array([0.1, 0, 0, 0, 0, np.pi / 2]))
    np.testing.assert_allclose(quarter[:3, 0], [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(quarter[:3, 3], [0.1, 0, 0])
    rng = np.random.default_rng(0)
    for _ in range(2000):
        pose = moved(pose, 0.02 * rng.normal(size=6))
    np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-13)
