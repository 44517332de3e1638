"""What `benchmarks.faults` draws: a way of the object, limits that it reaches, a robot beside them.

The problem is screwing with less price on the effort, so that the object is fast. Without limits a
person at an awkward start gives the object a way. A wall of the workspace is set across that way, a
ball to keep out of beside it, and a cone about the tool's axis that its turn would leave. The robot
is drawn inside what the problem declares about it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from ergoqp.joints import INDEX
from ergoqp.problem.load import load_problem
from ergoqp.problem.problem import Problem
from ergoqp.step.stepper import Stepper

RAISED: Final = {
    "right_shoulder_flexion": (-0.3, 2.2),
    "right_elbow_flexion": (0.1, 1.9),
    "right_shoulder_abduction": (-0.2, 1.0),
    "trunk_flexion": (0.0, 0.8),
}
"""Joints whose angles the start draws [rad]."""

WAIT: Final = 0.005
"""Longest time that the loop waits for an answer [s]: its twist is sent so much later."""
TICK: Final = 0.001
SLACK: Final = 0.004
"""How late loop, relay and robot may be by the machine's fault [s]; it is declared as delay."""

_FREE: Final = """
[limits.workspace]
lower = [-0.6, -1.2, 0.3]
upper = [1.4, 1.2, 2.2]

[limits.tool_axis]
direction = [1.0, 0.0, 0.0]
half_angle_deg = 120
"""
_HEAD: Final = """title = "screws, for faults of the service"
dt = 0.01

[response.ik]
stance = "standing"
hands = ["right"]
tool = "along"
free_about_tool = true
comfort_deg = { elbow_flexion = 85, knee_flexion = 8, hip_flexion = 4, ankle_flexion = 4, \
neck_flexion = 10 }

[task]
load_kg = 0.5
coupling = 0
activity = 0

[control]
effort_linear = 2.0
effort_angular = 0.4

[limits.twist]
linear_speed = 0.20
angular_speed = 0.60
linear_acceleration = 0.60
angular_acceleration = 2.0
"""
_SCOUTED: Final = 250


@dataclass(frozen=True)
class Robot:
    """The true robot: what the process in C is told.

    Attributes:
        delay: until it begins to follow a twist [s].
        lag: time constant with which it follows [s].
        gain: how much of a twist it does.
        hold: after how long without a twist it ramps down [s]; negative: never.
        noise: largest error of a measured position, per axis [m].
    """

    delay: float
    lag: float
    gain: float
    hold: float
    noise: float


@dataclass(frozen=True)
class World:
    """One trial's problem and robot.

    Attributes:
        text: the problem file.
        start: posture at the start (32,) [rad]; pose: of the contact frame there (4, 4).
        robot: the true robot.
        lower, upper: corners of the workspace [m].
        axis: direction of the cone; half: half its angle [rad].
        centre, radius: the ball to keep out of [m].
        speed, acceleration: limits of the twist (6,).
        average: W [s].
        settles: how long the robot moves after it was sent zero, until its report says that it
            stands [s].
    """

    text: str
    start: np.ndarray
    pose: np.ndarray
    robot: Robot
    lower: np.ndarray
    upper: np.ndarray
    axis: np.ndarray
    half: float
    centre: np.ndarray
    radius: float
    speed: np.ndarray
    acceleration: np.ndarray
    average: float


def _free_way(problem: Problem, stepper: Stepper, start: np.ndarray) -> np.ndarray:
    """Return the poses (k, 4, 4) of an object that nothing limits."""
    stepper.reset()
    posture, contact, poses = start.copy(), problem.response.contact(), []
    for _ in range(_SCOUTED):
        poses.append(np.array(contact(posture)[0]))
        posture = posture + problem.dt * stepper.step(posture).posture_rate
    return np.array(poses)


_scout: list[Any] = []


def _scouting(folder: Path) -> tuple[Problem, Stepper]:
    if not _scout:
        path = folder / "free.toml"
        path.write_text(_HEAD + _FREE, encoding="utf-8")
        problem = load_problem(str(path))
        _scout.extend((problem, Stepper(problem)))
    return _scout[0], _scout[1]


def draw_world(rng: np.random.Generator, folder: Path, relayed: bool, hold: float) -> World:
    """Draw a world in which the object reaches its limits about a second after the start.

    Args:
        rng: where chance comes from.
        folder: for the file of the problem without limits.
        relayed: whether a relay draws lines between the twists, which is up to 2.5 periods later.
        hold: the robot's own timeout [s]; negative: it has none.
    """
    problem, stepper = _scouting(folder)
    while True:
        start = np.array(problem.response.comfort)  # type: ignore[attr-defined]
        for joint, (low, high) in RAISED.items():
            start[INDEX[joint]] = rng.uniform(low, high)
        way = _free_way(problem, stepper, start)
        along = np.linalg.norm(way[:, :3, 3] - way[0, :3, 3], axis=1)
        # At least 12 cm/s in the mean of the second in which the fault comes.
        if along[140] - along[40] > 0.12 and along[-1] > 0.2:
            break
    return _walled(rng, start, way, relayed, hold)


def _walled(
    rng: np.random.Generator, start: np.ndarray, way: np.ndarray, relayed: bool, hold: float
) -> World:
    share = rng.choice([0.0, 0.5, 1.0], size=3, p=[0.3, 0.4, 0.3])
    robot = Robot(
        delay=0.04 * float(rng.uniform(0, 1) if share[0] else 0.0),
        lag=0.15 * float(rng.uniform(0, 1) if share[1] else 0.0),
        gain=1 + float(rng.uniform(-1, 1)) * 0.05 * float(share[2]),
        hold=hold,
        noise=float(rng.choice([0.0, 0.0005])),
    )
    place, axes = way[:, :3, 3], way[:, :3, 0]
    # The wall: across the axis along which the object goes farthest.
    reached = place[int(rng.integers(110, 170))]
    far = int(np.argmax(np.abs(place[-1] - place[0])))
    lower, upper = place.min(axis=0) - 0.25, place.max(axis=0) + 0.25
    if place[-1][far] > place[0][far]:
        upper[far] = max(reached[far], place[0][far] + 0.08)
    else:
        lower[far] = min(reached[far], place[0][far] - 0.08)
    # The ball: beside the middle of the way, so near that the margins feel it.
    middle, ahead = place[80], place[120] - place[40]
    aside = np.cross(ahead, rng.normal(size=3))
    radius = float(rng.uniform(0.05, 0.12))
    centre = middle + aside / np.linalg.norm(aside) * (radius + rng.uniform(0.01, 0.03))
    # The start is further away than what is not known of the pose.
    short = radius + 0.04 - np.linalg.norm(place[0] - centre)
    if short > 0:
        centre = centre + aside / np.linalg.norm(aside) * short
    # The cone: the start is inside by 6 degrees, and the turn goes on toward its edge.
    turned = float(np.arccos(np.clip(axes[0] @ axes[-1], -1, 1)))
    axis = axes[0] if turned < 0.1 else axes[int(rng.integers(0, 30))]
    half = max(np.radians(7.0), 0.6 * turned)
    declared = {
        "delay": robot.delay + WAIT + SLACK + TICK + (0.025 if relayed else 0.0),
        "lag": min(0.2, robot.lag * float(rng.uniform(1.0, 1.2)) + 0.005),
        # With a declared error of the gain, the object comes to rest after every late answer.
        "gain_error": abs(robot.gain - 1) + float(rng.uniform(0.002, 0.02)) if share[2] else 0.0,
        "pose_delay": 0.003,
        "pose_noise": robot.noise + 1e-6,
        "pose_noise_deg": 0.01,
    }
    if hold >= 0:
        # The robot's clock ticks once per millisecond, and its own ramp is that of the limits.
        declared["longest_hold"] = hold + SLACK
    text = _HEAD + _limits(lower, upper, axis, half, centre, radius)
    text += "\n[robot]\n" + "".join(f"{key} = {value:.6f}\n" for key, value in declared.items())
    return World(
        text,
        start,
        way[0],
        robot,
        lower,
        upper,
        axis,
        half,
        centre,
        radius,
        np.repeat([0.20, 0.60], 3),
        np.repeat([0.60, 2.0], 3),
        0.05,
    )


def _limits(
    lower: np.ndarray,
    upper: np.ndarray,
    axis: np.ndarray,
    half: float,
    centre: np.ndarray,
    radius: float,
) -> str:
    def listed(numbers: np.ndarray) -> str:
        return ", ".join(f"{each:.12g}" for each in numbers)

    return f"""
[limits.workspace]
lower = [{listed(lower)}]
upper = [{listed(upper)}]

[limits.tool_axis]
direction = [{listed(axis)}]
half_angle_deg = {np.degrees(half):.12g}

[[limits.keep_out]]
name = "ball"
tolerance = 0.0
ball = {{ centre = [{listed(centre)}], radius = {radius:.12g} }}
"""
