"""The fuzzer's judge of twists: what was sent, and what could have been sent instead.

It is written in numpy, without the step's code.

`Sent` holds speed, allowed axes, acceleration and jerk against what was sent before, and nothing
else. `Law` decides whether some twist other than braking was possible. It goes by the law of the
stop alone (the docstring of `ergoqp.limits.twist_and_stopping`), in its own arithmetic: what is
under way counts first, then half a period at the new plan, the stop from it, and what a mean that
still rises can add.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Final, Self

import numpy as np

from ergoqp.joints import INDEX, JOINTS, LOWER, UPPER
from ergoqp.limits import JointLimit
from ergoqp.problem.problem import Problem
from tools.fuzz.world import HardRows, moved

ROUNDING: Final = 1e-9
"""Of a speed, an acceleration or a jerk, relative to its limit."""

_TRIED: Final = 60
"""So many twists are tried before none is called possible, each also shortened toward braking."""


@dataclass
class Tally:
    """What one chunk found.

    Attributes:
        steps: calls made.
        judged: steps that count for ``certified_share``.
        answered: those of them that were not answered by braking.
        stops: stops that were braked down to rest.
        interrupted: calls that were interrupted.
        spoiled: steps where a term of the problem gave no number.
        counts: how often each thing was wrong, by figure and by kind.
        statuses: how often each status was answered.
        examples: the first two of each kind.
    """

    steps: int = 0
    judged: int = 0
    answered: int = 0
    stops: int = 0
    interrupted: int = 0
    spoiled: int = 0
    counts: Counter = field(default_factory=Counter)
    statuses: Counter = field(default_factory=Counter)
    examples: list[str] = field(default_factory=list)

    def wrong(self, figure: str, kind: str, where: str, what: str) -> None:
        """Count something wrong and keep the first of each kind as an example."""
        self.counts[figure] += 1
        self.counts[f"{figure}: {kind}"] += 1
        if self.counts[f"{figure}: {kind}"] <= 2:
            self.examples.append(f"{figure} ({kind}) at {where}: {what}")

    def add(self, other: Tally) -> None:
        """Take over what another chunk found."""
        for name in vars(self):
            setattr(self, name, getattr(self, name) + getattr(other, name))


@dataclass
class Sent:
    """What was sent last, and the judge of what is sent next.

    Attributes:
        problem: whose limits are held.
        twist: sent last (6,).
        rate: acceleration with which it was reached (6,).
        lasted: how long it was meant for [s].
    """

    problem: Problem
    twist: np.ndarray
    rate: np.ndarray
    lasted: float

    @classmethod
    def begin(cls, problem: Problem, twist: np.ndarray) -> Self:
        """Return the history of an object that has moved at a twist for ever."""
        return cls(problem, np.array(twist), np.zeros(6), problem.dt)

    def copy(self) -> Self:
        """Return another one with the same past."""
        return replace(self)

    def take(self, twist: np.ndarray, dt: float) -> dict[str, float]:
        """Judge a twist sent for a period and keep it as the last one.

        Return by how much (relative) it broke what.
        """
        limit, W = self.problem.twist_limit, self.problem.average
        speed, acceleration, broken = limit.speed, limit.acceleration, {}
        full = np.repeat([limit.linear_speed, limit.angular_speed], 3)
        rate, between = (twist - self.twist) / dt, (dt + self.lasted) / 2
        broken["speed"] = np.max((np.abs(twist) / full)[speed > 0], initial=0.0) - 1
        broken["axes"] = np.max(np.abs(twist)[speed == 0], initial=0.0)
        broken["acceleration"] = (
            np.max((np.abs(twist - self.twist) - 4e-16 * full) / (acceleration * dt)) - 1
        )
        if W:
            # An acceleration is the difference of two twists over a period: its rounding is that of
            # the twists.
            rounding = 2e-15 * full * (1 / dt + 1 / self.lasted)
            broken["jerk"] = (
                np.max((np.abs(rate - self.rate) - rounding) / (2 * acceleration / W * between)) - 1
            )
        self.twist, self.rate, self.lasted = np.array(twist), rate, dt
        return {name: float(by) for name, by in broken.items() if by > ROUNDING}


class Joints:
    """The joint ranges and rates of a problem as numbers."""

    def __init__(self, problem: Problem) -> None:
        """Read the limits."""
        limit: JointLimit = problem.limit_of(JointLimit)
        self.low, self.high = LOWER.copy(), UPPER.copy()
        for name, ends in limit.ranges_deg.items():
            self.low[INDEX[name]], self.high[INDEX[name]] = np.radians(ends)
        self.rate, self.tolerance = np.radians(limit.rate_deg), np.radians(limit.tolerance_deg)
        self.may_return = np.array([limit.recover and name in limit.ranges_deg for name in JOINTS])

    def outside(self, posture: np.ndarray) -> np.ndarray:
        """How far outside its range each joint is (.., 32) [rad]; negative inside."""
        return np.maximum(self.low - posture, posture - self.high)


class Law:
    """How a problem's object stops, in numbers, and what could be sent instead of braking.

    The law is that of `ergoqp.limits.twist_and_stopping`.

    The planned twists are the only thing that is read from the step: they are what its law is
    about. What was sent must be their mean over the last W seconds, which is checked here by
    integration.
    """

    def __init__(self, problem: Problem) -> None:
        """Read the limits."""
        self.problem, self.rows, self.joints = problem, HardRows(problem), Joints(problem)
        self._sensitivity = problem.response.sensitivity()
        self.restart(np.zeros(6))

    def restart(self, twist: np.ndarray) -> None:
        """Begin with an object that has moved at a twist (6,) for ever."""
        self._plan, self._sent = [(np.array(twist), np.inf)], [(np.array(twist), np.inf)]

    def take(self, planned: np.ndarray, sent: np.ndarray, dt: float) -> None:
        """Keep what was planned for the end of a period (6,), and what was sent for it (6,)."""
        robot = self.problem.robot
        for history, twist, seconds in (
            (self._plan, planned, self.problem.average),
            (self._sent, sent, robot.delay + robot.pose_delay + 15 * robot.lag),
        ):
            history.append((np.array(twist), dt))
            age = 0.0
            for number in range(len(history) - 1, 0, -1):
                age += history[number][1]
                if age > seconds:
                    # What is older is over.
                    history[: number - 1] = []
                    break

    @property
    def planned(self) -> np.ndarray:
        """The twist that was planned last (6,)."""
        return self._plan[-1][0]

    def mean(self) -> np.ndarray:
        """Return the mean of the plan over the last W seconds (6,)."""
        W = self.problem.average
        return self._integral(lambda age: 1 / W) if W else self.planned

    def under_way(self, dt: float) -> np.ndarray:
        """Return what the mean still has to send of the plan (6,).

        The last twist's half of this period is included.
        """
        W = self.problem.average
        return self._integral(lambda age: 1 - age / W) + self.planned * dt / 2 if W else np.zeros(6)

    def _integral(self, weight, plan: list | None = None) -> np.ndarray:
        """Integrate the plan times a weight that is linear in its age, up to the age W.

        The plan is a line from period to period.
        """
        W, age, total, plan = self.problem.average, 0.0, np.zeros(6), plan or self._plan
        plan = [*plan[::-1], plan[0]]
        for (newer, lasted), (older, _) in pairwise(plan):
            end = min(age + lasted, W)
            share = (end - age) / lasted
            at_end = newer + (older - newer) * share
            middle = (newer + at_end) / 2 * weight((age + end) / 2)
            total = total + (end - age) / 6 * (
                newer * weight(age) + 4 * middle + at_end * weight(end)
            )
            age += lasted
            if age >= W:
                break
        return total

    def owed(self) -> np.ndarray:
        """Return what the declared robot has yet to do of what was sent, piece by piece (k, 6)."""
        robot = self.problem.robot
        dead, lag, age, pieces = robot.delay + robot.pose_delay, robot.lag, 0.0, []
        for twist, lasted in self._sent[::-1]:
            end = age + lasted
            seconds = min(end, dead) - min(age, dead)
            if lag:
                seconds += lag * (
                    np.exp(-max(age - dead, 0) / lag) - np.exp(-max(end - dead, 0) / lag)
                )
            pieces.append(twist * seconds)
            age = end
        return np.array(pieces)

    def braked(self, dt: float) -> np.ndarray:
        """Return the plan's braking twist (6,)."""
        previous = self.planned
        seconds = float(np.max(np.abs(previous) / self.problem.twist_limit.acceleration))
        return previous * max(0.0, 1 - dt / seconds) if seconds > 0 else previous

    def climb(self) -> np.ndarray:
        """Return what is added (6,) while the mean still rises to the last planned twist.

        See `ergoqp.limits.twist_and_stopping`.
        """
        W, way = self.problem.average, np.zeros(6)
        for sign in (1, -1) if W else ():
            plan = [(np.maximum(sign * twist, 0), lasted) for twist, lasted in self._plan]
            missing = [(np.maximum(plan[-1][0] - twist, 0), lasted) for twist, lasted in plan]
            way += sign * 3 * self.problem.dt * self._integral(lambda age: 1 / W, missing)
        return way

    def rise(self, seconds: float) -> np.ndarray:
        """Return the most that a mean that rises for some seconds more can add (6,)."""
        h = 3 * self.problem.dt
        most = (h * seconds + h**2 / 8) * self.problem.twist_limit.acceleration
        return most if self.problem.average else np.zeros(6)

    def apart(self, longest: float) -> np.ndarray:
        """Return how much a stop's way can differ (6,) from one with periods up to `longest` [s].

        A period is held at its end: while the twist falls, shorter ones lead further, by half a
        period; while it rises, longer ones.
        """
        h, planned = 3 * self.problem.dt, np.abs(self.planned)
        rise = np.minimum(1.5 * h * planned, self.rise(self.problem.average / 2 + h))
        return longest / 2 * np.maximum(planned, np.abs(self._sent[-1][0])) + rise

    def way(self, twists: np.ndarray, dt: float) -> np.ndarray:
        """Return what planned twists (n, 6) add to what is under way (n, 6).

        They add their period, and the stop after it.
        """
        W, h, rise = self.problem.average, 3 * self.problem.dt, self.rise(dt)
        seconds = np.max(
            np.abs(twists) / self.problem.twist_limit.acceleration, axis=1, keepdims=True
        )
        way = twists * ((dt / 2 if W else dt) + seconds / 2)
        return way + np.clip(1.5 * h * twists, -rise, rise)

    def fastest(self, posture: np.ndarray, locked: tuple[str, ...]) -> np.ndarray:
        """Return the largest rate of each joint (32,) at full speed of the object [rad/s]."""
        S = np.array(self._sensitivity(posture, np.isin(JOINTS, locked).astype(float))[0])
        return np.abs(S) @ self.problem.twist_limit.speed

    def another_way(
        self,
        posture: np.ndarray,
        seen: np.ndarray,
        locked: tuple[str, ...],
        pose: np.ndarray,
        dt: float,
        rng: np.random.Generator,
        presumed: bool,
    ) -> bool:
        """Whether another reachable twist keeps everything through its stop as well as braking.

        Where the pose is `presumed`, taken from a posture, the object may be as far off as is
        declared.
        """
        limit, brake = self.problem.twist_limit, self.braked(dt)
        previous = self.planned
        low = np.minimum(np.maximum(-limit.speed, previous - limit.acceleration * dt), brake)
        high = np.maximum(np.minimum(limit.speed, previous + limit.acceleration * dt), brake)
        targets = rng.uniform(low, high, (_TRIED, 6))
        tried = np.concatenate([brake + share * (targets - brake) for share in (1.0, 0.3, 0.1)])
        tried = tried[np.abs(tried - brake).max(axis=1) > 1e-5]
        if not len(tried):
            return False
        comfort = self.problem.response.comfort  # type: ignore[attr-defined]
        known = np.where(seen & np.isfinite(posture), posture, comfort)
        S = np.array(self._sensitivity(known, np.isin(JOINTS, locked).astype(float))[0])
        outside = self._outside(np.vstack([brake, tried]), known, seen, S, pose, dt)
        if presumed:
            robot = self.problem.robot
            turn = [np.radians(robot.pose_from_posture_deg), 0.0, 0.0]
            first = np.array([*[robot.pose_from_posture] * 3, *turn])
            outside[:, : len(self.rows.names)] += self.rows.reach(first)
        joints = np.where(seen, self.joints.outside(known), -np.inf)
        now = np.concatenate([self.rows.outside(pose), joints])
        allowed = np.maximum(np.maximum(now, outside[0]), 0) + 1e-9
        return bool(np.any(np.all(outside[1:] <= allowed, axis=1)))

    def _outside(
        self,
        twists: np.ndarray,
        known: np.ndarray,
        seen: np.ndarray,
        S: np.ndarray,
        pose: np.ndarray,
        dt: float,
    ) -> np.ndarray:
        """How far outside all is at worst (n, k + 32) through the stop from planned twists (n, 6).

        Of a declared robot all ends are tried: what it owes done already or not, slower and faster,
        held on once or not.
        """
        robot, first, ways = (
            self.problem.robot,
            self.under_way(dt) + self.climb(),
            self.way(twists, dt),
        )
        owed, worst = self.owed().sum(axis=0), []
        late = bool(robot.delay or robot.pose_delay or robot.lag)
        for done in (0.0, 1.0) if late else (1.0,):
            for gain in {1 - robot.gain_error, 1 + robot.gain_error}:
                for held in (0, twists, self._sent[-1][0]) if robot.longest_hold else (0,):
                    ahead = gain * ((1 - done) * owed + first)
                    there = np.repeat(moved(pose, ahead)[None], len(twists), axis=0)
                    onward = gain * (ways + robot.longest_hold * held)
                    worst.append(
                        np.maximum(
                            self.rows.along(pose[None], ahead[None]), self.rows.along(there, onward)
                        )
                    )
        noise = np.repeat([robot.pose_noise, np.radians(robot.pose_noise_deg)], 3)
        hard = np.max(worst, axis=0) + self.rows.reach(noise)
        q = known + (owed * late + first + (1 + robot.gain_error) * ways) @ S.T
        return np.hstack([hard, np.where(seen, self.joints.outside(q), -np.inf)])
