"""Problems and steppers made once, and states to step from."""

from __future__ import annotations

from functools import cache

import numpy as np

from ergoqp.joints import LOWER, UPPER
from ergoqp.problem import Problem
from ergoqp.problem_file import load_problem
from ergoqp.step import Stepper

NAMES = ("dentist", "desk", "low_bin", "overhead", "screwing")


@cache
def problem_of(name: str) -> Problem:
    return load_problem(name)


@cache
def _stepper(name: str, solver: str) -> Stepper:
    return problem_of(name).stepper(solver=solver)


def stepper_of(name: str, solver: str = "daqp") -> Stepper:
    """A stepper as new; there is one per problem and solver."""
    stepper = _stepper(name, solver)
    stepper.reset()
    return stepper


def comfort_of(name: str) -> np.ndarray:
    return np.asarray(problem_of(name).response.comfort).copy()  # type: ignore[attr-defined]


def near_comfort(name: str, rng: np.random.Generator, spread_deg: float = 8.0) -> np.ndarray:
    """A posture around comfort, every joint at least 5 degrees inside its range."""
    inside = np.radians(5)
    q = comfort_of(name) + np.radians(spread_deg) * rng.normal(size=32)
    return np.clip(q, LOWER + inside, UPPER - inside)


def held_pose(name: str) -> np.ndarray:
    """A pose well inside the workspace, its tool in the middle of the cone."""
    from ergoqp.limits import AxisCone, WorkspaceBox
    from ergoqp.simulation.best import frame_of

    problem = problem_of(name)
    box, cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
    pose = np.eye(4)
    pose[:3, 3] = (np.asarray(box.lower) + np.asarray(box.upper)) / 2
    pose[:3, :3] = frame_of(np.asarray(cone.direction))
    return pose
