"""The loops of `benchmarks.tracking`: an object driven about by one robot, judged throughout."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.step_c import built
from benchmarks.tracking_judges import Faults, Found, Sent, outside
from benchmarks.tracking_robots import Case, OddRobot, period, told
from ergoqp.joints import LOWER, UPPER
from ergoqp.limits import AxisCone, WorkspaceBox
from ergoqp.problem.geometry import frame_of
from ergoqp.problem.load import load_problem
from ergoqp.problem.problem import Problem
from ergoqp.problem.settings import DeclaredRobot, Frames
from ergoqp.step.constants import stand_in
from ergoqp.step.stepper import Stepper

JUMP = 0.6
"""Every so often the posture is another one [s]."""

ROOM = 0.03
"""Half the size of the box that the object is driven about in [m].

It is so small that the object is at a wall most of the time.
"""

TILT = 6.0
"""Half the angle of the cone [deg]."""

NEAR = (-2.0, -0.4)
"""What is at a wall, or at the end of the cone [mm, deg]."""


@cache
def driven(name: str, declared: DeclaredRobot, narrow: bool = True) -> Problem:
    """Return a problem with a robot, in its own workspace or with walls all around the object."""
    # Its person stands for nobody: postures and poses have nothing to do with each other.
    problem = load_problem(name).replace(frames=Frames(compare=False))
    if not narrow:
        return problem.replace(robot=declared)
    box, cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
    lower, upper = np.asarray(box.lower), np.asarray(box.upper)
    middle = (lower + upper) / 2
    walls = WorkspaceBox(
        tuple(np.maximum(lower, middle - ROOM)), tuple(np.minimum(upper, middle + ROOM))
    )
    kept = [limit for limit in problem.limits if limit not in (box, cone)]
    return problem.replace(
        limits=[*kept, walls, AxisCone(cone.direction, min(TILT, cone.half_angle_deg))],
        robot=declared,
    )


def drive(
    problem: Problem,
    case: Case,
    reports: str,
    step: Callable[..., Any],
    brake: Callable[..., Any],
    seconds: float,
    seed: int,
    enable: bool = True,
) -> Found:
    """Drive the object about for some seconds and judge everything."""
    rng, found = np.random.default_rng([seed, 11]), Found()
    box, cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
    pose = np.eye(4)
    pose[:3, 3], pose[:3, :3] = (
        (np.asarray(box.lower) + np.asarray(box.upper)) / 2,
        frame_of(np.asarray(cone.direction)),
    )
    robot = OddRobot(case, pose, np.random.default_rng([seed, 12]))
    sent, faults = Sent(problem, found), Faults(case, found)
    comfort, dt, time, until, held = stand_in(problem), problem.dt, 0.0, 0.0, False
    posture, first = comfort, {"pose": pose}
    while time < seconds:
        if time >= until:
            posture, until = (
                np.clip(comfort + 0.6 * rng.normal(size=32), LOWER, UPPER),
                until + JUMP,
            )
        meant, late = period(case, dt, rng)
        if case.periods == "one hiccup":
            # What is declared is one until it stands still again; of a robot that lags two are more
            # than that.
            late = 0.0 if held else late
            held = late > 0 or (held and bool(np.abs(robot.velocity).max() > 1e-4))
        given = told(case, robot, reports, len(found.twists)) | first
        answer = step(posture, **given, dt=meant, enable=enable)
        first = {}
        _send(
            problem,
            found,
            robot,
            sent,
            answer.twist,
            meant,
            0.0 if case.periods == "watched" else late,
        )
        faults.judge(given, answer.reason, answer.twist, meant, late)
        found.twists.append(answer.twist)
        time += meant + late
        if case.periods == "watched":
            for _ in range(round(late / dt)):
                answer = brake(dt)
                _send(problem, found, robot, sent, answer.twist, dt, 0.0)
                faults.judge(
                    told(case, robot, reports, len(found.twists)),
                    answer.reason,
                    answer.twist,
                    dt,
                    0.0,
                )
    return found


def _send(
    problem: Problem,
    found: Found,
    robot: OddRobot,
    sent: Sent,
    twist: np.ndarray,
    meant: float,
    late: float,
) -> None:
    sent.judge(twist, meant)
    before = robot.pose
    parts = max(1, round((meant + late) / 0.005))
    for _ in range(parts):
        for pose in robot.execute(twist, (meant + late) / parts):
            beyond = outside(problem, pose)
            found.outside = np.maximum(found.outside, beyond)
            found.at_wall, found.moments = (
                found.at_wall + bool(np.any(beyond > NEAR)),
                found.moments + 1,
            )
    found.path += float(np.linalg.norm(robot.pose[:3, 3] - before[:3, 3]))


@cache
def stepper_of(
    name: str, declared: DeclaredRobot, form: str = "interpreted", narrow: bool = True
) -> Any:
    """Return a stepper of a `driven` problem, in one form of the step."""
    problem = driven(name, declared, narrow)
    if form == "c":
        return _CStepper(problem)
    return Stepper(problem, compiled=form == "compiled")


class _CStepper:
    """The exported step, called as the one in Python."""

    def __init__(self, problem: Problem) -> None:
        self.problem, self._scratch = problem, tempfile.TemporaryDirectory()
        folder, self._wrapper = built(problem, Path(self._scratch.name) / "step")
        self._stepper = self._wrapper.Stepper(str(folder / "build/libergoqp_step.so"))

    def reset(self) -> None:
        self._stepper.reset()

    def step(self, posture: np.ndarray, **given: Any) -> Any:
        return _CAnswer(self._stepper.step(posture, **given))

    def brake(self, dt: float) -> Any:
        return _CAnswer(self._stepper.brake(dt))


class _CAnswer:
    def __init__(self, output: Any) -> None:
        self.twist, self.reason = np.array(output.twist[:]), "robot: " if output.fault else ""
