"""Calls of a step as a bad day brings them: a wandering posture, lost frames, late ones, other periods, wrong poses, NaN."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ergoqp.joints import JOINTS, LOWER, UPPER
from ergoqp.limits import ArmLength
from ergoqp.problem import Problem


def wandering_calls(problem: Problem, count: int, seed: int) -> Iterator[dict[str, Any]]:
    """Yield keyword arguments of `Stepper.step`."""
    rng = np.random.default_rng(seed)
    posture = _start(problem)
    for _ in range(count):
        posture = _wander(problem, posture, rng)
        call: dict[str, Any] = {"posture": posture.copy(), "dt": rng.choice([0.001, 0.01, 0.01, 0.01, 0.05]), "age": 0.0}
        if problem.coordinates == JOINTS and rng.random() < 0.5:
            call["pose"] = np.array(problem.response.contact()(posture)[0])
        chance = rng.random()
        if chance < 0.02:
            call["posture"] = None
        elif chance < 0.04:
            call["posture"][rng.integers(len(posture))] = np.nan
        elif chance < 0.06:
            call["age"] = rng.uniform(0, 0.3)
        elif chance < 0.08:
            call["enable"] = False
        elif chance < 0.10:
            call["pose"] = rng.normal(size=(4, 4))
        elif chance < 0.12:
            call["observed"] = rng.random(len(posture)) < 0.8
        elif chance < 0.20:
            call["twist"] = 0.05 * rng.normal(size=6)
        yield call


def _start(problem: Problem) -> np.ndarray:
    if problem.coordinates == JOINTS:
        return problem.response.comfort.copy()  # type: ignore[attr-defined]
    length = problem.limit_of(ArmLength).length
    return np.array([0.0, -0.2, 0.2, length, -0.2, 0.2])


def _wander(problem: Problem, posture: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    moved = posture + 0.03 * rng.normal(size=len(posture))
    if problem.coordinates == JOINTS:
        return np.clip(moved, LOWER - 0.02, UPPER + 0.02)
    apart = moved[3:] - moved[:3]
    moved[3:] = moved[:3] + apart * problem.limit_of(ArmLength).length / np.linalg.norm(apart)
    return moved
