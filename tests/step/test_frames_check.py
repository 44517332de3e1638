"""Wrong frames are named, honest people are not."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ergoqp.human import Body
from ergoqp.joints import INDEX
from ergoqp.problem.load import load_problem
from ergoqp.problem.problem import Problem
from ergoqp.problem.settings import Frames
from ergoqp.simulation.robot import moved
from ergoqp.step.causes import Cause
from ergoqp.step.frames_check import AGREED, BEYOND, DOUBTED, PERIOD, _judged, bounds
from ergoqp.step.model import StepModel
from ergoqp.step.stepper import Step, Stepper


@cache
def problem_of(name: str = "screwing") -> Problem:
    return load_problem(name)


@cache
def stepper_of(name: str = "screwing") -> Stepper:
    return Stepper(problem_of(name))


def contact(problem: Problem, posture: np.ndarray) -> np.ndarray:
    return np.array(problem.response.contact()(posture)[0])


def at_work(problem: Problem) -> np.ndarray:
    posture = np.array(problem.response.comfort)
    posture[INDEX["right_shoulder_flexion"]] = 0.6
    return posture


def led(
    stepper: Stepper, posture: np.ndarray, pose: np.ndarray, seconds: float, **more: object
) -> list[Step]:
    """Steps of a loop in which the person stays and a robot does as told."""
    steps, pose = [], pose.copy()
    for _ in range(round(seconds / stepper.dt)):
        steps.append(stepper.step(posture, pose=pose, **more))
        pose = moved(pose, steps[-1].twist * stepper.dt)
    return steps


def names(step: Step) -> bool:
    return bool(int(step.account("causes")[0]) >> Cause.frames & 1)


def shifted(pose: np.ndarray, *by: float) -> np.ndarray:
    other = pose.copy()
    other[:3, 3] += by
    return other


ROUND_Z = np.array([[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
OTHER_TOOL = np.array([[0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1.0]])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("wrong", "mends"),
    [
        (lambda pose: shifted(pose, 0.6, 0, 0), "world's origin?"),
        (lambda pose: shifted(pose, 0, -1.0, 0), "world's origin?"),
        (lambda pose: shifted(pose, 0, 0, -0.5), "base and flange"),
        (lambda pose: ROUND_Z @ pose, "base and flange"),
        (lambda pose: pose @ OTHER_TOOL, "along the tool?"),
        (lambda pose: shifted(pose, 30.0, 0, 0), "is it in m?"),
    ],
)
@pytest.mark.parametrize("name", ["screwing", "dentist"])
def test_a_wrong_frame_brakes_within_a_second_and_says_what_to_mend(
    name: str, wrong: object, mends: str
) -> None:
    stepper, posture = stepper_of(name), at_work(problem_of(name))
    stepper.reset()
    steps = led(stepper, posture, wrong(contact(problem_of(name), posture)), 1.0)  # type: ignore
    first = next(number for number, step in enumerate(steps) if names(step))
    # One step after the last comparison; the first is at once.
    assert first == round((BEYOND - 1) * PERIOD / stepper.dt) + 1
    assert steps[-1].status == "braking"
    said = [part for part in steps[-1].reason.split("; ") if part.startswith("frames: ")]
    assert len(said) == 1
    assert mends in said[0]
    assert len({step.reason for step in steps[first + 50 :]}) == 1


@pytest.mark.parametrize("trusted", [False, True])
@pytest.mark.parametrize("distance", [0.1, 0.3, 0.5, 0.8, 1.0])
@pytest.mark.parametrize("degrees", [0.0, 25.0, 55.0, 85.0, 100.0])
@pytest.mark.parametrize("explained", [0.9, 1.5])
def test_what_counts_is_the_distance_and_the_angle_together(
    trusted: bool, distance: float, degrees: float, explained: float
) -> None:
    """An ellipse of 0.38 m and 60 deg, and of 0.9 m and 90 deg once they have agreed."""
    block = np.array([0, 3.0, 4.0, AGREED if trusted else 2, 0, 0])
    apart = np.array([0, distance, 0, 0, 0, 2 * np.sin(np.radians(degrees) / 2)])
    after = np.array(_judged(StepModel(problem_of()))(block, apart, [1.5, explained])).ravel()
    outside = (distance / 0.38) ** 2 + (degrees / 60) ** 2 > 1
    walked = (distance / 0.9) ** 2 + (degrees / 90) ** 2 > 1
    assert after[1] == 3 + (1 if (walked if trusted else outside) else -1)
    assert after[2] == 4 + (1 if outside or explained < 1 else -1)
    assert after[3] == (AGREED if trusted else 0 if outside else 3)
    np.testing.assert_allclose(after[4:], [distance, np.radians(degrees)], atol=1e-9)


@pytest.mark.slow
def test_millimetres_are_no_pose() -> None:
    stepper, posture = stepper_of(), at_work(problem_of())
    stepper.reset()
    pose = contact(problem_of(), posture)
    pose[:3, 3] *= 1000
    step = stepper.step(posture, pose=pose)
    assert step.status == "invalid"
    assert "is it in m?" in step.reason


def test_the_right_frame_says_nothing_and_is_trusted() -> None:
    stepper, posture = stepper_of(), at_work(problem_of())
    stepper.reset()
    steps = led(stepper, posture, contact(problem_of(), posture), 1.5)
    assert not any(names(step) or "frames:" in step.reason for step in steps)
    assert steps[-1].account("frames")[3] == AGREED


def test_a_bad_posture_for_a_moment_is_no_wrong_frame() -> None:
    problem, stepper, posture = problem_of(), stepper_of(), at_work(problem_of())
    stepper.reset()
    pose = contact(problem, posture)
    glitch = posture.copy()
    glitch[INDEX["right_shoulder_flexion"]], glitch[INDEX["right_elbow_flexion"]] = 2.8, 0.0
    assert np.linalg.norm(contact(problem, glitch)[:3, 3] - pose[:3, 3]) > bounds(problem)[0]
    for number in range(100):
        bad = 1 <= number % 100 <= (BEYOND - 1) * round(PERIOD / stepper.dt)
        step = stepper.step(glitch if bad else posture, pose=pose)
        assert not names(step)
    for _ in range(65):
        step = stepper.step(glitch, pose=pose)
    assert names(step)


def test_it_moves_again_once_pose_and_posture_agree() -> None:
    stepper, posture = stepper_of(), at_work(problem_of())
    stepper.reset()
    pose = contact(problem_of(), posture)
    assert names(led(stepper, posture, shifted(pose, 0.7, 0, 0), 1.0)[-1])
    steps = led(stepper, posture, pose, 3.0)
    assert not names(steps[-1])
    assert any(step.status == "optimal" for step in steps)


@pytest.mark.parametrize(
    ("unseen", "compared"), [("right_elbow_flexion", False), ("left_elbow_flexion", True)]
)
def test_only_a_posture_whose_joints_are_seen_is_compared(unseen: str, compared: bool) -> None:
    stepper, posture = stepper_of(), at_work(problem_of())
    stepper.reset()
    seen = np.ones(32, bool)
    seen[INDEX[unseen]] = False
    wrong = shifted(contact(problem_of(), posture), 0.7, 0, 0)
    assert names(led(stepper, posture, wrong, 1.0, observed=seen)[-1]) == compared


def test_nothing_is_compared_without_a_measured_pose() -> None:
    stepper, posture = stepper_of(), at_work(problem_of())
    stepper.reset()
    stepper.step(posture, pose=contact(problem_of(), posture))
    raised = posture.copy()
    raised[INDEX["right_shoulder_flexion"]] = 2.8
    assert not any(names(stepper.step(raised)) for _ in range(100))


@pytest.mark.parametrize("lost", ["pose", "ankle"])
def test_what_is_not_compared_any_more_ends_by_trying_again(lost: str) -> None:
    """The object rested for ever once an ankle was not seen any more."""
    stepper, posture = Stepper(problem_of()), at_work(problem_of())
    pose, seen = contact(problem_of(), posture), np.ones(32)
    seen[INDEX["right_ankle_flexion"]] = 0
    for wrong in (shifted(pose, 0.3, 0.5, 0.0),):
        led(stepper, posture, wrong, 1.0)
    given = {"pose": None} if lost == "pose" else {"pose": pose, "observed": seen}
    steps = [stepper.step(posture, **given) for _ in range(200)]
    assert names(steps[-1])
    stepper.try_again()
    steps = [stepper.step(posture, **given) for _ in range(200)]
    assert not any(names(step) for step in steps)
    assert "braking" not in {step.status for step in steps[50:]}


def test_after_trying_again_wrong_frames_are_seen_as_often_as_at_first() -> None:
    stepper, posture = Stepper(problem_of()), at_work(problem_of())
    wrong = shifted(contact(problem_of(), posture), 0.7, 0, 0)
    until = []
    for _ in range(2):
        steps = 1
        while not names(stepper.step(posture, pose=wrong)):
            steps += 1
        until.append(steps)
        stepper.try_again()
    # The first comparison of all is made at once.
    all_of_them = round(BEYOND * PERIOD / stepper.dt)
    assert until[0] < until[1] == all_of_them


def test_a_person_who_steps_aside_later_is_doubted_and_not_braked() -> None:
    stepper, posture = stepper_of(), at_work(problem_of())
    stepper.reset()
    pose = contact(problem_of(), posture)
    led(stepper, posture, pose, 1.5)
    aside = [stepper.step(posture, pose=shifted(pose, 0, 0.5, 0), twist=None) for _ in range(150)]
    # The jump itself is a fault of the robot; the frames are not braked for.
    assert not any(names(step) for step in aside)
    assert any("frames:" in step.reason for step in aside)
    away = [stepper.step(posture, pose=shifted(pose, 0, 1.0, 0)) for _ in range(100)]
    assert names(away[-1])


@pytest.mark.slow
def test_what_no_usual_error_explains_is_doubted_without_braking() -> None:
    problem, stepper = problem_of("dentist"), stepper_of("dentist")
    stepper.reset()
    posture = at_work(problem)
    pose = shifted(contact(problem, posture), 0.33, 0, 0)
    steps = led(stepper, posture, pose, 1.5)
    assert not any(names(step) for step in steps)
    doubted = [number for number, step in enumerate(steps) if "frames:" in step.reason]
    assert doubted[0] == round((DOUBTED - 1) * PERIOD / stepper.dt) + 1
    assert "a stature 0.16 m wrong explain" in steps[-1].reason


def test_what_usual_errors_explain_is_not_doubted() -> None:
    problem = problem_of()
    tall = problem.replace(response=replace(problem.response, body=Body.of_stature(1.90)))
    rng = np.random.default_rng(0)
    for _ in range(6):
        posture = at_work(problem)
        read = posture + np.radians(rng.uniform(-7, 7, 32))
        stepper = stepper_of()
        stepper.reset()
        steps = led(stepper, read, contact(tall, posture), 1.2)
        assert not any("frames:" in step.reason for step in steps)


def test_after_a_calibration_the_comparison_is_sharp() -> None:
    problem, posture = problem_of(), at_work(problem_of())
    pose = contact(problem, posture)
    off = np.array([0.0, 0.1, 0.0])
    told = Frames(offset=off, spread=0.04, spread_deg=10.0)
    assert bounds(problem.replace(frames=told)) == pytest.approx((0.20, np.radians(45)))
    stepper = Stepper(problem.replace(frames=told))
    assert not any(names(s) for s in led(stepper, posture, shifted(pose, *off), 1.0))
    stepper.reset()
    assert names(led(stepper, posture, shifted(pose, 0, -0.15, 0), 1.0)[-1])


@pytest.mark.slow
def test_a_pose_as_the_robot_reports_it_gives_the_same_twists() -> None:
    problem, posture = problem_of(), at_work(problem_of())
    frames = Frames(
        base=[0.9, 0.2, 0.4, 0, 0, 1, 0], flange=[0.05, 0, 0.15, 0, -np.sqrt(0.5), 0, np.sqrt(0.5)]
    )
    plain, behind = Stepper(problem), Stepper(problem.replace(frames=frames))
    pose = contact(problem, posture)
    for _ in range(60):
        step = plain.step(posture, pose=pose)
        same = behind.step(posture, pose=frames.reported_pose(pose))
        np.testing.assert_allclose(same.twist, step.twist, atol=1e-9)
        np.testing.assert_allclose(same.pose, pose, atol=1e-12)
        pose = moved(pose, step.twist * plain.dt)
    assert behind.step(posture, pose=np.full((4, 4), np.nan)).status == "invalid"
