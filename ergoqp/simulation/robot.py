"""A simulated robot that holds the object, with delay, lag, gain error and measurement errors.

The simulation is exact between periods.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Final, Self

import numpy as np

from ergoqp.arguments import Range, check_parameters
from ergoqp.problem.geometry import between, turned
from ergoqp.problem.settings import DeclaredRobot

_IDENTITY: Final = np.eye(3)
_PART: Final = 0.002
"""Longest part of a period in which a robot with lag turns about one axis [s]."""


@dataclass(frozen=True)
class RobotKind:
    """How a robot executes the sent twist s: w' = (gain s(t - delay) - w) / lag.

    Attributes:
        delay: time until it begins to follow a twist [s].
        lag: time constant with which it follows [s].
        gain: ratio of its motion to the sent twist (dimensionless).
        pose_delay: age of the measured pose and of the reported twist [s].
        pose_noise: largest error of a measured position, uniform, per axis [m].
        pose_noise_deg: largest error of a measured orientation, uniform, about each axis
            [deg].
        speed_noise: standard deviation of the reported twist, as a share of it.

    Raises:
        InputError: if a value has the wrong type or is out of range.

    Example:
        >>> import ergoqp
        >>> from ergoqp.simulation.robot import RobotKind
        >>> problem = ergoqp.load_problem("screwing")
        >>> late = RobotKind(delay=0.02, lag=0.05)
        >>> run = ergoqp.simulate(problem, problem.response.comfort, duration=0.1, robot=late)
        >>> run.poses.shape
        (10, 4, 4)
    """

    delay: Annotated[float, Range(0.0, 10.0, "s")] = 0.0
    lag: Annotated[float, Range(0.0, 10.0, "s")] = 0.0
    gain: Annotated[float, Range(0.0, 10.0)] = 1.0
    pose_delay: Annotated[float, Range(0.0, 10.0, "s")] = 0.0
    pose_noise: Annotated[float, Range(0.0, 1.0, "m")] = 0.0
    pose_noise_deg: Annotated[float, Range(0.0, 90.0, "deg")] = 0.0
    speed_noise: Annotated[float, Range(0.0, 10.0)] = 0.0

    def __post_init__(self) -> None:
        """Check the values."""
        check_parameters(self, "robot ")

    @classmethod
    def of(cls, declared: DeclaredRobot, rng: np.random.Generator, share: float = 1.0) -> Self:
        """Return a robot as declared: `share` of the delays, and a gain drawn within its error."""
        return cls(
            delay=share * declared.delay,
            lag=share * declared.lag,
            gain=1 + declared.gain_error * share * float(rng.uniform(-1, 1)),
            pose_delay=share * declared.pose_delay,
            pose_noise=share * declared.pose_noise,
            pose_noise_deg=share * declared.pose_noise_deg,
        )


class SimulatedRobot:
    """The true motion of the object.

    Args:
        kind: how the robot executes the sent twist.
        pose: pose of the object at the start, at rest (4, 4) [m].
        rng: source of the noise.

    Attributes:
        pose: true pose now (4, 4) [m].
        velocity: true velocity now (6,) [m/s, rad/s].
    """

    def __init__(self, kind: RobotKind, pose: np.ndarray, rng: np.random.Generator) -> None:
        """Start at rest."""
        self.kind, self._rng = kind, rng
        self.pose, self.velocity = pose.copy(), np.zeros(6)
        self._time, self._part = 0.0, _PART if kind.lag else np.inf
        self._began = 0.0
        self._coming: deque[tuple[float, np.ndarray]] = deque([(-np.inf, np.zeros(6))])
        self._seen: deque[tuple[float, np.ndarray, np.ndarray]] = deque(
            [(0.0, self.pose, np.zeros(6))]
        )

    def execute(self, twist: np.ndarray, duration: float) -> Iterator[np.ndarray]:
        """Execute a sent twist (6,) that holds for a duration [s].

        It yields the true poses on the way, the last one at the end.
        """
        self._coming.append((self._time + self.kind.delay, np.array(twist)))
        end = self._time + duration
        while self._time < end - 1e-12:
            while len(self._coming) > 1 and self._coming[1][0] <= self._time + 1e-12:
                self._coming.popleft()
            until = min(
                end,
                self._time + self._part,
                *(self._coming[1][0],) if len(self._coming) > 1 else (),
            )
            self._advance(self._coming[0][1], until - self._time)
            self._time = until
            self._seen.append((self._time, self.pose, self.velocity.copy()))
            yield self.pose
        self._began = end - duration
        while len(self._seen) > 1 and self._seen[1][0] <= self._time - self.kind.pose_delay + 1e-12:
            self._seen.popleft()

    def _advance(self, twist: np.ndarray, seconds: float) -> None:
        target = self.kind.gain * twist
        if self.kind.lag > 0:
            fades = float(np.exp(-seconds / self.kind.lag))
            way = target * seconds + (self.velocity - target) * self.kind.lag * (1 - fades)
            self.velocity = target + (self.velocity - target) * fades
        else:
            way, self.velocity = target * seconds, target.copy()
        self.pose = moved(self.pose, way)

    def see(self, pose: np.ndarray) -> None:
        """Set the true pose of the object (4, 4) [m] for the measurements.

        With a soft robot the sent twists alone do not determine it.
        """
        velocity = self._seen[-1][2]
        while len(self._seen) > 1 and self._seen[-1][0] > self._began + 1e-12:
            self._seen.pop()
        self._seen.append((self._time, pose, velocity))

    def measured_pose(self) -> np.ndarray:
        """Return the pose as measured now (4, 4) [m], with its delay and its error."""
        pose, _ = self._delayed()
        if not (self.kind.pose_noise or self.kind.pose_noise_deg):
            return pose.copy()
        most = np.repeat([self.kind.pose_noise, np.radians(self.kind.pose_noise_deg)], 3)
        return moved(pose, self._rng.uniform(-most, most))

    def reported_twist(self) -> np.ndarray:
        """Return the twist as the robot reports it (6,) [m/s, rad/s]."""
        _, velocity = self._delayed()
        return velocity * (1 + self.kind.speed_noise * self._rng.normal(size=6))

    def _delayed(self) -> tuple[np.ndarray, np.ndarray]:
        """Return pose and velocity as they were `pose_delay` ago."""
        start, pose, velocity = self._seen[0]
        past = self._time - self.kind.pose_delay - start
        if len(self._seen) == 1 or past <= 1e-12:
            return pose, velocity
        end, after, later = self._seen[1]
        share = past / (end - start)
        if self.kind.lag:
            return between(pose, after, share), velocity + share * (later - velocity)
        return between(pose, after, share), later


def moved(pose: np.ndarray, displacement: np.ndarray) -> np.ndarray:
    """Return a pose (4, 4) after a world-aligned displacement (6,) [m, rad]."""
    after = pose.copy()
    after[:3, 3] += displacement[:3]
    if displacement[3:].any():
        rotation = turned(pose[:3, :3], displacement[3:])
        # Keep it orthonormal up to rounding over any number of periods.
        after[:3, :3] = rotation @ (1.5 * _IDENTITY - 0.5 * rotation.T @ rotation)
    return after
