"""An ideal robot that reports its twist wrongly, and never its pose, for `benchmarks.tracking`.

The pose is given once. What is reported after that is the twist in the tool's frame, scaled, with a
bias, with half of its samples zero, or in coarse steps. The object starts in the middle, or 5 mm
and half a degree from the ends; a posture drives it to all of them. The control believes the
report: it integrates it from the first pose.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.tracking_faults import driven_problem
from benchmarks.tracking_judges import outside
from ergoqp.joints import JOINTS
from ergoqp.limits import AxisCone, WorkspaceBox
from ergoqp.problem.settings import DeclaredRobot
from ergoqp.simulation.robot import moved
from ergoqp.step.stepper import Stepper

WALLS: Final = (
    WorkspaceBox((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)),
    AxisCone((1.0, 0.0, 0.0), 30.0),
)

NEAR: Final = (0.005, 0.5)
"""How far from the ends some objects start [m, deg]."""

ACKNOWLEDGED: Final = 2.0
"""How often the stop is acknowledged, where it is [s]."""

LIES: Final = ("tool frame", "scaled 0.5", "scaled 0.97", "biased", "half zero", "quantised")
NOISES: Final = (0.0, 0.01, 0.03)
"""Noise of a twist that is reported truly [m/s, rad/s]."""


def reported(
    kind: str, twist: np.ndarray, pose: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Return a twist (6,) as it is reported."""
    turn = pose[:3, :3].T
    return {
        "tool frame": np.concatenate([turn @ twist[:3], turn @ twist[3:]]),
        "scaled 0.5": 0.5 * twist,
        "scaled 0.97": 0.97 * twist,
        "biased": twist - np.array([0.002, 0.0, 0.0, 0.0, 0.0, 0.0]),
        "half zero": twist * (rng.random() < 0.5),
        "quantised": np.floor(twist / 0.05) * 0.05,
        **{f"noise {size}": twist + size * rng.normal(size=6) for size in NOISES},
    }[kind]


def start(near: bool) -> np.ndarray:
    """Return the first pose (4, 4)."""
    pose = np.eye(4)
    pose[:3, 3] = 1.0 - NEAR[0] if near else 0.5
    angle = 30.0 - NEAR[1] if near else 0.0
    pose[:3, :3] = Rotation.from_euler("z", angle, degrees=True).as_matrix()
    return pose


def drive_blind(
    kind: str, near: bool, acknowledged: bool, seconds: float, seed: int
) -> tuple[float, float, float]:
    """Return (how far the object was outside at most [mm, deg], its path [m])."""
    problem = driven_problem(DeclaredRobot(), WALLS)
    stepper, rng, dt = Stepper(problem), np.random.default_rng([seed, 61]), problem.dt
    pose, q, twist = start(near), np.zeros(len(JOINTS)), np.zeros(6)
    worst, path = np.full(2, -np.inf), 0.0
    for number in range(round(seconds / dt)):
        if number % 150 == 0:
            way = rng.normal(size=6)
            q[:6] = -3 * way / np.abs(way).max()
        told = reported(kind, twist, pose, rng)
        twist = stepper.step(q, None if number else pose, told).twist
        if acknowledged and (number + 1) % round(ACKNOWLEDGED / dt) == 0:
            stepper.try_again()
        pose = moved(pose, twist * dt)
        worst = np.maximum(worst, outside(problem, pose))
        path += float(np.linalg.norm(twist[:3])) * dt
    return float(worst[0]), float(worst[1]), path


def believed(kind: str, near: bool, seconds: float, seed: int) -> tuple[float, float, float]:
    """Return the same of a step that is told the integral of the report as its pose: the control.

    Its robot watch is off, so that nothing stops it.
    """
    problem = driven_problem(DeclaredRobot(), WALLS)
    stepper, rng, dt = Stepper(problem), np.random.default_rng([seed, 61]), problem.dt
    pose, q = start(near), np.zeros(len(JOINTS))
    told, worst, path = pose, np.full(2, -np.inf), 0.0
    sent = np.zeros(6)
    for number in range(round(seconds / dt)):
        if number % 150 == 0:
            way = rng.normal(size=6)
            q[:6] = -3 * way / np.abs(way).max()
        # A loop that begins anew with every step compares nothing with what was sent.
        stepper.reset(sent)
        sent = stepper.step(q, pose=told).twist
        pose, told = moved(pose, sent * dt), moved(told, reported(kind, sent, pose, rng) * dt)
        worst = np.maximum(worst, outside(problem, pose))
        path += float(np.linalg.norm(sent[:3])) * dt
    return float(worst[0]), float(worst[1]), path
