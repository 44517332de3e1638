"""The judges of `benchmarks.tracking`.

They judge what is sent against limits, where the object is, and what is said of its robot.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from benchmarks.tracking_robots import Case, moved
from ergoqp.limits import AxisCone, WorkspaceBox
from ergoqp.problem.problem import Problem


@dataclass
class Found:
    """What one run left behind."""

    over: dict[str, float] = field(
        default_factory=lambda: dict.fromkeys(("speed", "acceleration", "jerk"), -np.inf)
    )
    outside: np.ndarray = field(default_factory=lambda: np.full(2, -np.inf))
    at_wall: int = 0
    moments: int = 0
    path: float = 0.0
    unnamed: int = 0
    apart: int = 0
    named: list[str] = field(default_factory=list)
    twists: list[np.ndarray] = field(default_factory=list)


class Sent:
    """Judges what is sent against the limits, from the twists and periods alone."""

    def __init__(self, problem: Problem, found: Found) -> None:
        """Start from rest."""
        limit = problem.twist_limit
        self._speed = np.where(limit.speed > 0, limit.speed, np.nan)
        self._most = np.repeat([limit.linear_acceleration, limit.angular_acceleration], 3)
        self._jerk, self._found = 2 * self._most / problem.average, found
        self._frozen = limit.speed == 0
        self._twist, self._slope, self._lasted = np.zeros(6), np.zeros(6), problem.dt

    def judge(self, twist: np.ndarray, dt: float) -> None:
        """Take over the next twist, which is meant for `dt` seconds."""
        slope, over = (twist - self._twist) / dt, self._found.over
        rounding = 4e-16 * np.nan_to_num(self._speed) / dt
        jerk = (np.abs(slope - self._slope) - 2 * rounding) / ((dt + self._lasted) / 2)
        frozen = np.max(np.abs(twist[self._frozen]), initial=0.0)
        over["speed"] = max(
            over["speed"], float(np.nanmax(np.abs(twist) / self._speed)) - 1, frozen
        )
        over["acceleration"] = max(
            over["acceleration"], float(np.max((np.abs(slope) - rounding) / self._most)) - 1
        )
        over["jerk"] = max(over["jerk"], float(np.max(jerk / self._jerk)) - 1)
        self._twist, self._slope, self._lasted = twist, slope, dt


class Faults:
    """Whether the loop says in time that the robot does something else.

    This is judged from the same reports that the loop gets.
    """

    def __init__(self, case: Case, found: Found) -> None:
        """Nothing moved yet."""
        robot = case.declared
        self._found, self._noise = (
            found,
            np.repeat([robot.pose_noise, np.radians(robot.pose_noise_deg)], 3),
        )
        self._rest, self._since, self._said = 10.0, 0.0, False
        self._expected: np.ndarray | None = None
        self._drift, self._sent = np.zeros(6), (np.zeros(6), 0.0)

    def judge(
        self, given: dict[str, Any], reason: str, twist: np.ndarray, dt: float, late: float
    ) -> None:
        """Compare motion since the object last stood still.

        `late` is how much longer than `dt` the twist will last.
        """
        before, lasted = self._sent
        apart: list[np.ndarray] = []
        expected = (
            given.get("pose") if self._expected is None else moved(self._expected, before * lasted)
        )
        if "pose" in given and expected is not None:
            apart.append(_between(expected, given["pose"]))
        self._expected = expected
        if "twist" in given:
            self._drift += (given["twist"] - before) * lasted
            # An integral of samples is off by half a period.
            apart.append(
                np.sign(self._drift) * np.maximum(np.abs(self._drift) - dt / 2 * np.abs(before), 0)
            )
        sizes = [(np.linalg.norm(each[:3]) - self._noise[0]) / 0.001 for each in apart]
        sizes += [(np.linalg.norm(each[3:]) - self._noise[3]) / np.radians(0.2) for each in apart]
        before_that = self._since
        self._since = self._since + lasted if max(sizes, default=0.0) > 1 else 0.0
        self._found.apart += before_that <= 0.2 < self._since
        if reason.startswith("robot") or "; robot" in reason:
            self._found.named.append(reason)
            self._said = True
        if self._since > 0.2 and not self._said:
            self._found.unnamed += 1
            self._said = True
        rested, self._rest = self._rest, 0.0 if np.any(twist) else self._rest + dt
        # From where the object came to stand still, and from where it was said to have moved then.
        if self._rest > 0.1 and (rested <= 0.1 or self._said):
            self._expected, self._drift, self._since, self._said = None, np.zeros(6), 0.0, False
        self._sent = (twist, dt)


def _between(expected: np.ndarray, pose: np.ndarray) -> np.ndarray:
    turned = pose[:3, :3] @ expected[:3, :3].T
    sines = (
        np.array(
            [turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]]
        )
        / 2
    )
    return np.concatenate([pose[:3, 3] - expected[:3, 3], sines])


def outside(problem: Problem, pose: np.ndarray) -> np.ndarray:
    """Return by how much a pose (4, 4) is beyond (box [mm], cone [deg]); negative inside."""
    box, cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
    beyond = np.maximum(np.asarray(box.lower) - pose[:3, 3], pose[:3, 3] - np.asarray(box.upper))[
        problem.twist_limit.speed[:3] > 0
    ]
    toward, axis = np.asarray(cone.direction), pose[:3, 0]
    angle = (
        np.degrees(np.arctan2(np.linalg.norm(np.cross(toward, axis)), toward @ axis))
        - cone.half_angle_deg
    )
    return np.array([1e3 * np.max(beyond, initial=-np.inf), angle])
