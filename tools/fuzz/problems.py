"""What the fuzzer runs: the package's problems and random ones.

Both come with and without a declared robot. The module also says where objects are.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ergoqp.errors import ErgoqpError
from ergoqp.joints import INDEX, LOWER, UPPER
from ergoqp.limits import AXES, AxisCone, JointLimit, TwistLimit, WorkspaceBox
from ergoqp.problem.load import TASKS, load_problem
from ergoqp.problem.problem import Problem
from ergoqp.problem.settings import Control, DeclaredRobot, Frames
from tools.fuzz.regions import random_regions

Rng = np.random.Generator


def problem_of(number: int, rng: Rng) -> Problem:
    """Return the problem of a chunk: in turns the package's own and random ones.

    Every other time it has a declared robot.
    """
    kinds = 2 * (len(TASKS) + 5)
    slot, declared = number % kinds // 2, number % 2
    robot = random_robot(rng) if declared else DeclaredRobot()
    if slot < len(TASKS):
        problem = load_problem(TASKS[slot])
        if rng.random() < 0.3:
            problem = _with_regions(problem, rng)
    else:
        problem = random_problem(rng, robot)
    # Postures and poses have nothing to do with each other.
    problem = problem.replace(frames=Frames(compare=False))
    return (
        problem.replace(robot=robot, name=f"{problem.name} with a robot") if declared else problem
    )


def _with_regions(problem: Problem, rng: Rng) -> Problem:
    """Return a problem with regions to keep out of, some of them where the object begins."""
    response: Any = problem.response
    middle = np.array(response.contact()(response.comfort)[0])[:3, 3]
    while True:
        try:
            kept = random_regions(rng, middle, list(problem.limits))
            return problem.replace(limits=[*problem.limits, *kept])
        except ErgoqpError:
            continue


def random_robot(rng: Rng) -> DeclaredRobot:
    """Return a robot of which some things are declared, at least one."""
    most = {
        "delay": 0.06,
        "lag": 0.1,
        "gain_error": 0.1,
        "pose_delay": 0.05,
        "pose_noise": 0.002,
        "pose_noise_deg": 0.5,
    }
    most["longest_hold"] = 0.3
    while True:
        given = {
            name: float(rng.uniform(0, value)) for name, value in most.items() if rng.random() < 0.4
        }
        if given:
            return DeclaredRobot(**given)


def random_problem(rng: Rng, robot: DeclaredRobot) -> Problem:
    """Return one of the problems with another person, limits and response, maybe contradictory."""
    while True:
        try:
            return _mutated(load_problem(str(rng.choice(TASKS))), rng, robot)
        except ErgoqpError:
            continue


def _mutated(problem: Problem, rng: Rng, robot: DeclaredRobot) -> Problem:
    response: Any = problem.response
    hands = (("right",), ("left",), ("right", "left"))[rng.integers(3)]
    response = replace(
        response,
        hands=hands,
        stance=str(rng.choice(["standing", "seated"])),
        tool=str(rng.choice(["along", "thumb"])),
        free_about_tool=bool(rng.integers(2)),
        damping=float(10 ** rng.uniform(-3, -1)),
    )
    middle = np.array(response.contact()(response.comfort)[0])
    axes = tuple(axis for axis in AXES if rng.random() < 0.7) or AXES
    twist = TwistLimit(
        *(float(10**x) for x in rng.uniform([-2, -1.5, -1, -0.5], [0, 0.3, 0.7, 1])), axes=axes
    )
    limits: list[Any] = [twist]
    dt = float(rng.choice([0.004, 0.01, 0.02, 0.05], p=[0.1, 0.6, 0.2, 0.1]))
    average = (None, 0.0, 0.02, 0.2)[rng.choice(4, p=[0.5, 0.2, 0.15, 0.15])]
    # A box without an inside along some axes (no wider than is allowed along those that move), or
    # without the start.
    size = rng.choice([0.0, 1e-9, 1e-4, 0.02, 0.3], 3, p=[0.1, 0.05, 0.1, 0.25, 0.5])
    rise = (
        (1 + robot.gain_error) * twist.linear_acceleration * (3 + 9 / 8) * dt**2 * (average != 0.0)
    )
    size = np.where(
        twist.speed[:3] > 0, np.maximum(size, 1.001 * max(rise, 1e-5) + 2 * robot.pose_noise), size
    )
    centre = middle[:3, 3] + rng.choice([0.0, 0.02, 0.3], p=[0.5, 0.3, 0.2]) * rng.normal(size=3)
    if rng.random() < 0.9:
        limits.append(WorkspaceBox(tuple(centre - size / 2), tuple(centre + size / 2)))
    if rng.random() < 0.8:
        direction = middle[:3, 0] + rng.choice([0.0, 0.3, 2.0], p=[0.4, 0.4, 0.2]) * rng.normal(
            size=3
        )
        limits.append(AxisCone(tuple(direction), float(rng.choice([0.5, 5, 35, 90, 150]))))
    if rng.random() < 0.4:
        limits += random_regions(rng, middle[:3, 3], limits)
    recover = bool(rng.random() < 0.2)
    limits.append(
        JointLimit(
            ranges_deg=_ranges(rng), rate_deg=float(10 ** rng.uniform(0.5, 2.5)), recover=recover
        )
    )
    terms: dict[str, Any] = {
        "response": response,
        "limits": limits,
        "dt": dt,
        "control": Control(average=average),
    }
    terms |= {"robot": robot}
    return problem.replace(**terms, name=f"random of {problem.name}")


def _ranges(rng: Rng) -> dict[str, tuple[float, float]]:
    ranges = {}
    for joint, number in INDEX.items():
        if rng.random() < 0.2:
            low, high = np.degrees([LOWER[number], UPPER[number]])
            middle, width = rng.uniform(low, high), rng.choice([0.1, 5.0, 40.0])
            ranges[joint] = (max(low, middle - width), min(high, middle + width))
    return ranges


def moving(rng: Rng, problem: Problem) -> np.ndarray:
    """Return a twist with which an object may be moving, now and then beyond its limits."""
    full = np.repeat([problem.twist_limit.linear_speed, problem.twist_limit.angular_speed], 3)
    return rng.uniform(-1, 1, 6) * full * rng.choice([0.3, 1.0, 1.5]) * (rng.random(6) < 0.7)


def somewhere(rng: Rng, problem: Problem) -> np.ndarray:
    """Return a pose (4, 4) in the workspace, at its edge or beyond it."""
    pose, outside = np.eye(4), rng.random() < 0.3
    pose[:3, :3] = rotation(rng)
    box, cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
    low, high = (np.asarray(box.lower), np.asarray(box.upper)) if box else (np.zeros(3), np.ones(3))
    pose[:3, 3] = rng.uniform(low, high) + outside * rng.choice([0.0, 0.01, 0.5]) * rng.normal(
        size=3
    )
    if cone is not None and not (outside and rng.random() < 0.5):
        wide = np.sin(min(np.radians(cone.half_angle_deg), 1.5)) / np.sqrt(2)
        pose[:3, :3] = along(
            np.asarray(cone.direction) + wide * rng.uniform(-1, 1) * rotation(rng)[:, 0], rng
        )
    return pose


def rotation(rng: Rng) -> np.ndarray:
    """Return any orientation (3, 3)."""
    return along(rng.normal(size=3), rng)


def along(direction: np.ndarray, rng: Rng) -> np.ndarray:
    """Return an orientation (3, 3) with its first axis along a direction (3,)."""
    x = direction / np.linalg.norm(direction)
    y = np.cross(rng.normal(size=3), x)
    y /= np.linalg.norm(y)
    return np.column_stack([x, y, np.cross(x, y)])
