"""Problems and steppers made once, and states to step from."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from ergoqp.joints import LOWER, UPPER
from ergoqp.limits import AxisCone, WorkspaceBox
from ergoqp.problem.load import load_problem
from ergoqp.problem.problem import Problem
from ergoqp.problem.settings import DeclaredRobot, Frames
from ergoqp.simulation.robot import moved
from ergoqp.step.stepper import Step, Stepper

STRANGERS = Frames(compare=False)
"""Whoever stands still while the object moves away is no test of frames."""

NAMES = ("dentist", "desk", "low_bin", "overhead", "screwing")


@cache
def problem_of(name: str) -> Problem:
    return load_problem(name)


@cache
def plain_of(name: str) -> Problem:
    """The problem without the mean: what is planned is sent, so that answers and braking are those
    of the law itself."""
    problem = problem_of(name)
    return problem.replace(control=replace(problem.control, average=0.0), frames=STRANGERS)


@cache
def bold_of(name: str) -> Problem:
    """The problem with an object that goes at full speed and never rests by itself, so that it
    comes to its walls."""
    boldly = {"effort_linear": 0.01, "effort_angular": 0.01, "contact": 0.0, "caution": 0.0}
    problem = problem_of(name)
    return problem.replace(
        control=replace(problem.control, rest_below=0.0, stall_after=1e6, **boldly),
        frames=STRANGERS,
    )


@cache
def bold_stepper(name: str) -> Stepper:
    return Stepper(bold_of(name))


@cache
def _stepper(name: str, solver: str, plain: bool) -> Stepper:
    return Stepper((plain_of if plain else problem_of)(name), solver=solver)


def stepper_of(name: str, solver: str = "daqp", plain: bool = False) -> Stepper:
    """A stepper as new; there is one per problem and solver, and one of each problem without the
    mean."""
    stepper = _stepper(name, solver, plain)
    stepper.reset()
    return stepper


def small(name: str, robot: DeclaredRobot, average: float | None) -> Problem:
    """A problem in a box of 6 cm and a cone of 6 degrees, whose object is always on its way to some
    wall."""
    problem = bold_of(name)
    box, cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
    middle = held_pose(name)[:3, 3]
    kept = [limit for limit in problem.limits if limit not in (box, cone)]
    limits = [
        *kept,
        WorkspaceBox(tuple(middle - 0.03), tuple(middle + 0.03)),
        AxisCone(cone.direction, 6.0),
    ]
    return problem.replace(
        limits=limits, robot=robot, control=replace(problem.control, average=average)
    )


def outside(problem: Problem, pose: np.ndarray) -> float:
    """How far out of box and cone (4, 4) [m, rad]."""
    box, cone, point = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone), pose[:3, 3]
    toward = np.asarray(cone.direction)
    angle = np.arctan2(np.linalg.norm(np.cross(toward, pose[:3, 0])), toward @ pose[:3, 0])
    beyond = np.maximum(np.asarray(box.lower) - point, point - np.asarray(box.upper))[
        problem.twist_limit.speed[:3] > 0
    ]
    return float(max(beyond.max(), angle - np.radians(cone.half_angle_deg)))


class Held:
    """A stepper in a loop with a robot that does what it is sent, and is measured without an
    error."""

    def __init__(self, stepper: Stepper, pose: np.ndarray) -> None:
        self.stepper, self.pose = stepper, pose.copy()

    def step(self, posture: Any, **given: Any) -> Step:
        """Step from where the object is, and move it as it is sent; other arguments as those of
        `Stepper.step`."""
        step = self.stepper.step(posture, given.pop("pose", self.pose), **given)
        dt = given.get("dt", self.stepper.dt)
        usable = isinstance(dt, (int, float)) and 0 < dt <= 1
        self.pose = moved(self.pose, step.twist * (dt if usable else self.stepper.dt))
        return step


def comfort_of(name: str) -> np.ndarray:
    return np.asarray(problem_of(name).response.comfort).copy()  # type: ignore[attr-defined]


def near_comfort(name: str, rng: np.random.Generator, spread_deg: float = 8.0) -> np.ndarray:
    """A posture around comfort, every joint at least 5 degrees inside its range."""
    inside = np.radians(5)
    q = comfort_of(name) + np.radians(spread_deg) * rng.normal(size=32)
    return np.clip(q, LOWER + inside, UPPER - inside)


def held_pose(name: str) -> np.ndarray:
    """A pose well inside the workspace, its tool in the middle of the cone."""
    from ergoqp.problem.geometry import frame_of

    problem = problem_of(name)
    box, cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
    pose = np.eye(4)
    pose[:3, 3] = (np.asarray(box.lower) + np.asarray(box.upper)) / 2
    pose[:3, :3] = frame_of(np.asarray(cone.direction))
    return pose
