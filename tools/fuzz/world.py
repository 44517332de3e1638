"""What the fuzzer's judge takes to be true: where the object is, whatever the step makes of it.

It does without the step's code.

`HardRows` says how far outside its workspace and its tool cone an object is, at a place and on the
way from one to the next. `TrueObject` is the object in the hands of a robot that is late, lags,
moves more or less than it is sent, and is measured late and with an error; exact between the
periods.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final, Self

import numpy as np

from ergoqp.limits import AxisCone, WorkspaceBox
from ergoqp.problem.problem import Problem
from ergoqp.simulation.robot import RobotKind

_PART: Final = 0.005
"""Longest part of a period in which a robot that lags is taken to turn about one axis [s]."""

Way = list[tuple[np.ndarray, np.ndarray]]
"""Poses (4, 4), each with the straight displacement (6,) that leads on from it."""


class HardRows:
    """Workspace box and tool cone of a problem, as numbers."""

    def __init__(self, problem: Problem) -> None:
        """Read the limits."""
        self._box, self._cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
        self.names = [
            *(self._box.names if self._box else ()),
            *(self._cone.names if self._cone else ()),
        ]
        if self._box:
            self._low, self._high = np.asarray(self._box.lower), np.asarray(self._box.upper)
        if self._cone:
            self._toward, self._half = (
                np.asarray(self._cone.direction),
                float(np.radians(self._cone.half_angle_deg)),
            )

    def outside(self, pose: np.ndarray) -> np.ndarray:
        """How far outside each row is (k,) [m, rad]; negative inside."""
        return self.along(pose[None], np.zeros((1, 6)))[0]

    def along(self, poses: np.ndarray, displacements: np.ndarray) -> np.ndarray:
        """How far outside each row is at worst (n, k) in a straight shift and turn about one axis.

        Args:
            poses: where each way begins (n, 4, 4).
            displacements: where it leads (n, 6).
        """
        parts = []
        if self._box:
            start = poses[:, :3, 3]
            end = start + displacements[:, :3]
            parts.append(
                np.maximum(self._low - np.minimum(start, end), np.maximum(start, end) - self._high)
            )
        if self._cone:
            parts.append(
                (self._widest(poses[:, :3, 0], displacements[:, 3:]) - self._half)[:, None]
            )
        return np.hstack(parts) if parts else np.zeros((len(poses), 0))

    def worst(self, way: Way) -> np.ndarray:
        """How far outside each row is at worst (k,) on a way."""
        return self.along(
            np.stack([pose for pose, _ in way]), np.stack([part for _, part in way])
        ).max(axis=0)

    def reach(self, displacement: np.ndarray) -> np.ndarray:
        """Most change of each row (k,) with a displacement of this size (6,) along each axis."""
        turn = float(np.linalg.norm(displacement[3:]))
        return np.array(
            [
                displacement["xyz".index(name[-1])] if name != "tool axis" else turn
                for name in self.names
            ]
        )

    def _widest(self, axes: np.ndarray, turns: np.ndarray) -> np.ndarray:
        """The largest angle (n,) to the cone's middle while an axis turns.

        The axis turns on a circle, so look where that is farthest.
        """
        toward, end = self._toward, np.linalg.norm(turns, axis=1, keepdims=True)
        u = turns / np.maximum(end, 1e-30)
        along = u * np.sum(u * axes, axis=1, keepdims=True)
        across = axes - along
        beside = _cross(u, across)
        phase = np.arctan2(beside @ toward, across @ toward)[:, None]
        angles = np.minimum(
            np.maximum(np.hstack([0 * end, end, phase + np.pi, phase - np.pi]), 0), end
        )[:, :, None]
        reached = (
            along[:, None] + across[:, None] * np.cos(angles) + beside[:, None] * np.sin(angles)
        )
        apart, together = reached - toward, reached + toward
        squares = (
            np.einsum("nki,nki->nk", apart, apart),
            np.einsum("nki,nki->nk", together, together),
        )
        return 2 * np.arctan2(np.sqrt(squares[0]), np.sqrt(squares[1])).max(axis=1)


def _cross(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Cross products of rows (n, 3)."""
    return u[:, [1, 2, 0]] * v[:, [2, 0, 1]] - u[:, [2, 0, 1]] * v[:, [1, 2, 0]]


def moved(pose: np.ndarray, displacement: np.ndarray) -> np.ndarray:
    """Return a pose (4, 4) after a world-aligned displacement (6,) [m, rad]."""
    after = pose.copy()
    after[:3, 3] += displacement[:3]
    x, y, z = displacement[3:].tolist()
    angle = (x * x + y * y + z * z) ** 0.5
    if angle > 0:
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        turn = cross * (np.sin(angle) / angle) + cross @ cross * (
            2 * (np.sin(angle / 2) / angle) ** 2
        )
        after[:3, :3] += turn @ pose[:3, :3]
    return after


@dataclass
class _Mover:
    """Something that follows the twists that were sent: w' = (gain s(t - dead) - w) / lag.

    Attributes:
        pose: now (4, 4).
        velocity: now (6,).
        dead: seconds until it begins to follow.
        lag: time constant [s].
        gain: how many times the sent twist it moves.
        does: what it makes of a twist (6, 6), for a robot that disobeys; None: the twist.
    """

    pose: np.ndarray
    velocity: np.ndarray
    dead: float
    lag: float
    gain: float
    does: np.ndarray | None = None

    def advance(self, sent: Sequence[tuple[float, np.ndarray]], start: float, end: float) -> Way:
        """Move on between two times, by twists sent at times that rise; returns the way."""
        begins = [begin + self.dead for begin, _ in sent]
        times = [start, *(begin for begin in begins if start + 1e-12 < begin < end - 1e-12), end]
        way, active = [], 0
        for now, then in pairwise(times):
            while active + 1 < len(sent) and begins[active + 1] <= now + 1e-12:
                active += 1
            parts = int(np.ceil((then - now) / _PART)) if self.lag else 1
            for _ in range(parts):
                way.append((self.pose, self._move(sent[active][1], (then - now) / parts)))
        return way

    def _move(self, twist: np.ndarray, seconds: float) -> np.ndarray:
        target = self.gain * (twist if self.does is None else self.does @ twist)
        if self.lag > 0:
            fades = float(np.exp(-seconds / self.lag))
            shift = target * seconds + (self.velocity - target) * self.lag * (1 - fades)
            self.velocity = target + (self.velocity - target) * fades
        else:
            shift, self.velocity = target * seconds, target
        self.pose = moved(self.pose, shift)
        return shift


class TrueObject:
    """The object's true motion.

    Args:
        kind: how the robot does what it is sent.
        measured: pose of the object as it would be measured now, without an error (4, 4).
        twist: that it has been sent for ever (6,).
    """

    def __init__(self, kind: RobotKind, measured: np.ndarray, twist: np.ndarray) -> None:
        """Start, at rest or moving."""
        self.kind, self._time, self._sent = kind, 0.0, [(-np.inf, np.array(twist))]
        self.seen = _Mover(
            measured.copy(), kind.gain * twist, kind.delay + kind.pose_delay, kind.lag, kind.gain
        )
        self.now = self.seen
        if kind.pose_delay:
            self.now = replace(
                self.seen,
                pose=moved(measured, kind.gain * twist * kind.pose_delay),
                dead=kind.delay,
            )
        self._reported = kind.gain * twist

    @property
    def pose(self) -> np.ndarray:
        """Where it is (4, 4)."""
        return self.now.pose

    @property
    def at_rest(self) -> bool:
        """Whether nothing of what was sent moves it any more, to 1e-9 m/s and rad/s."""
        since = self._time - self.kind.delay - self.kind.pose_delay
        coming = (
            any(twist.any() for begin, twist in self._sent if begin > since)
            or self._active(since).any()
        )
        return (
            not coming
            and bool(np.abs(self.now.velocity).max() < 1e-9)
            and bool(np.abs(self.seen.velocity).max() < 1e-9)
        )

    def _active(self, time: float) -> np.ndarray:
        return next(twist for begin, twist in reversed(self._sent) if begin <= time)

    def send(self, twist: np.ndarray, seconds: float) -> Way:
        """Send a twist (6,) for some seconds and return the way that the object takes meanwhile."""
        self._sent.append((self._time, np.array(twist)))
        end = self._time + seconds
        way = self.now.advance(self._sent, self._time, end)
        seen = way if self.seen is self.now else self.seen.advance(self._sent, self._time, end)
        self._reported = sum((part for _, part in seen), np.zeros(6)) / seconds
        self._time = end
        oldest = end - self.seen.dead
        while len(self._sent) > 1 and self._sent[1][0] <= oldest:
            self._sent.pop(0)
        return way

    def disobey(self, does: np.ndarray | None) -> None:
        """Make something else (6, 6) of every twist from now on; None: obey again."""
        self.seen.does = self.now.does = does

    def teleport(self, measured: np.ndarray) -> None:
        """Be elsewhere, so that the object is measured there (4, 4); its motion goes on."""
        was, now = self.seen.pose, self.now.pose.copy()
        now[:3, 3] += measured[:3, 3] - was[:3, 3]
        now[:3, :3] = now[:3, :3] @ was[:3, :3].T @ measured[:3, :3]
        self.seen.pose = measured.copy()
        if self.now is not self.seen:
            self.now.pose = now

    def measure(self, rng: np.random.Generator) -> np.ndarray:
        """Return the pose as it is measured now (4, 4), late and with an error."""
        if not (self.kind.pose_noise or self.kind.pose_noise_deg):
            return self.seen.pose.copy()
        most = np.repeat([self.kind.pose_noise, np.radians(self.kind.pose_noise_deg)], 3)
        return moved(self.seen.pose, rng.uniform(-most, most))

    def report(self, rng: np.random.Generator, mean: bool) -> np.ndarray:
        """Return the twist as the robot reports it (6,): mean of the last period, or at its end."""
        twist = self._reported if mean else self.seen.velocity
        return twist * (1 + self.kind.speed_noise * rng.normal(size=6))

    def copy(self) -> Self:
        """Return another one in the same state."""
        twin = object.__new__(type(self))
        twin.__dict__.update(self.__dict__)
        twin._sent = list(self._sent)
        twin.seen = replace(self.seen)
        twin.now = twin.seen if self.now is self.seen else replace(self.now)
        return twin


def turned(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Return the world-aligned displacement (6,) from one pose (4, 4) to another.

    It is a shift and a rotation vector.
    """
    R = after[:3, :3] @ before[:3, :3].T
    sines = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2
    sine, cosine = float(np.linalg.norm(sines)), float(np.trace(R) - 1) / 2
    angle = float(np.arctan2(sine, cosine))
    # Half a turn has no sine: any axis says that it is large.
    way = sines * (angle / sine) if sine > 1e-9 else np.array([angle, 0.0, 0.0])
    return np.concatenate([after[:3, 3] - before[:3, 3], way])
