"""Calls of a step as a bad day brings them: a wandering posture, lost frames, late ones, other
periods, wrong poses, NaN."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from step_samples import held_pose

from ergoqp.joints import JOINTS, LOWER, UPPER
from ergoqp.limits import ArmLength, WorkspaceBox
from ergoqp.problem.problem import Problem
from ergoqp.simulation.robot import moved
from ergoqp.step.stepper import Step, Stepper


def wandering_steps(
    problem: Problem, stepper: Stepper, count: int, seed: int
) -> Iterator[tuple[dict[str, Any], Step]]:
    """Yield keyword arguments of `Stepper.step` and the answer to each: a measured pose has to
    follow from what was sent."""
    rng = np.random.default_rng(seed)
    posture, twist, dt = start_of(problem), np.zeros(6), 0.01
    of_person = problem.coordinates == JOINTS
    pose = _beside_the_box(problem) if of_person else np.eye(4)
    for number in range(count):
        posture = _wander(problem, posture, rng)
        call: dict[str, Any] = {
            "posture": posture.copy(),
            "dt": rng.choice([0.003, 0.01, 0.01, 0.01, 0.02]),
            "age": 0.0,
        }
        if of_person and (number == 0 or rng.random() < 0.5):
            call["pose"] = pose
        chance = rng.random()
        if chance < 0.02:
            call["posture"] = None
        elif chance < 0.04:
            call["posture"][rng.integers(len(posture))] = np.nan
        elif chance < 0.06:
            call["age"] = rng.uniform(0, 0.3)
        elif chance < 0.07:
            call["enable"] = False
        elif chance < 0.08:
            call["pose"] = rng.normal(size=(4, 4))
        elif chance < 0.10:
            call["observed"] = rng.random(len(posture)) < 0.8
        elif chance < 0.18:
            call["twist"] = twist * (1 + 0.05 * rng.normal(size=6))
        elif chance < 0.182:
            call["twist"] = rng.normal(size=6)
        elif chance < 0.185 and of_person:
            call["pose"] = moved(pose, 0.005 * rng.normal(size=6))
        elif chance < 0.21:
            call["dt"] = rng.choice([0.05, 2.0])
        step = stepper.step(**call)
        twist, dt = step.twist, call["dt"] if call["dt"] <= 1 else problem.dt
        pose = moved(pose, twist * dt)
        yield call, step


def start_of(problem: Problem) -> np.ndarray:
    """A usable state to begin with."""
    if problem.coordinates == JOINTS:
        return problem.response.comfort.copy()  # type: ignore[attr-defined]
    length = problem.limit_of(ArmLength).length
    return np.array([0.0, -0.2, 0.2, length, -0.2, 0.2])


def _beside_the_box(problem: Problem) -> np.ndarray:
    """A little outside the workspace, so that the object comes back first."""
    pose = held_pose(problem.name)
    pose[2, 3] = problem.limit_of(WorkspaceBox).upper[2] + 0.004
    return pose


def _wander(problem: Problem, posture: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    moves = posture + 0.03 * rng.normal(size=len(posture))
    if problem.coordinates == JOINTS:
        return np.clip(moves, LOWER - 0.02, UPPER + 0.02)
    apart = moves[3:] - moves[:3]
    moves[3:] = moves[:3] + apart * problem.limit_of(ArmLength).length / np.linalg.norm(apart)
    return moves
