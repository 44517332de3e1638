"""Robots for `benchmarks.tracking`: what each does, its declaration, its reports and its calls."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ergoqp.problem.settings import DeclaredRobot
from ergoqp.simulation.robot import RobotKind, SimulatedRobot, moved

NONE = DeclaredRobot()
PERFECT = RobotKind()
HICCUP = 0.3
"""How long a hiccup is [s]."""

LOST = 37
"""Where the pose is lost now and then, it is there for so many calls and away for twice as many."""


@dataclass(frozen=True)
class Case:
    """One robot.

    Attributes:
        name: of the robot.
        kind: how it does what it is sent.
        declared: what the problem says of it.
        oddity: what else it does, see `OddRobot`; empty: nothing.
        periods: ``even``, ``uneven`` (0.5 to 3 times), ``hiccups`` (one call in 150 comes 0.3 s
            late), ``one hiccup`` (no second one before the object stands still) or ``watched``
            (hiccups, and a watchdog brakes meanwhile).
        honest: nothing that it does is beyond what is declared.
        slow: it is at most 20 ms late, and that is not declared.
    """

    name: str
    kind: RobotKind = PERFECT
    declared: DeclaredRobot = NONE
    oddity: str = ""
    periods: str = "even"
    honest: bool = False
    slow: bool = False


class OddRobot(SimulatedRobot):
    """A robot with a fault.

    It is ``stalled`` for a second now and then, ``half`` as fast for a while; or one that reports
    its twist with ``spikes``, in millimetres (``mm``) or in another frame (``frame``).
    """

    def __init__(self, case: Case, pose: np.ndarray, rng: np.random.Generator) -> None:
        """Start at rest."""
        super().__init__(case.kind, pose, rng)
        self._oddity, self._passed = case.oddity, 0.0

    def execute(self, twist: np.ndarray, duration: float) -> Iterator[np.ndarray]:
        """Do what is sent, or not."""
        self._passed += duration
        ill = self._passed % 2.5 > 1.5
        share = {"stalled": 0.0, "half": 0.5}.get(self._oddity, 1.0) if ill else 1.0
        yield from super().execute(share * twist, duration)

    def reported_twist(self) -> np.ndarray:
        """Return the twist as it is reported."""
        twist = super().reported_twist()
        if self._oddity == "spikes" and self._rng.random() < 0.01:
            twist[self._rng.integers(3)] += self._rng.choice([-1.0, 1.0])
        if self._oddity == "mm":
            twist[:3] *= 1000
        if self._oddity == "frame":
            twist = np.concatenate([twist[[1, 2, 0]], twist[[4, 5, 3]]])
        return twist


def cases(dt: float) -> list[Case]:
    """Return all robots for a control period `dt` [s]."""
    noise = {"pose_noise": 0.001, "pose_noise_deg": 0.2}
    declared = {f"lag {1e3 * lag:.0f} ms": DeclaredRobot(lag=lag) for lag in (0.02, 0.05, 0.1, 0.2)}
    declared |= {f"delay {n} periods": DeclaredRobot(delay=n * dt) for n in (1, 3, 5)}
    declared |= {f"pose late by {n} periods": DeclaredRobot(pose_delay=n * dt) for n in (1, 3, 10)}
    declared |= {"pose noise": DeclaredRobot(**noise)}
    late = {"delay": 3 * dt, "lag": 0.05, "pose_delay": 2 * dt}
    everything = DeclaredRobot(**late, **noise, gain_error=0.02)
    declared |= {"everything": everything}
    found = [Case("ideal", honest=True), Case("uneven periods", periods="uneven", honest=True)]
    for name, robot in declared.items():
        kind = RobotKind.of(robot, np.random.default_rng(1))
        found.append(Case(name, kind, robot, honest=True))
        half = replace(
            kind,
            **{
                part: getattr(kind, part) / 2
                for part in ("delay", "lag", "pose_delay", "pose_noise")
            },
        )
        found.append(Case(f"{name}, half of it", half, robot, honest=True))
        if "noise" not in name:
            slow = robot.lag + robot.delay <= 0.0201 and not robot.pose_delay
            found.append(Case(f"{name}, undeclared", replace(kind, gain=1.0), slow=slow))
    kind = RobotKind.of(everything, np.random.default_rng(1))
    found.append(
        Case("everything, uneven periods", kind, everything, periods="uneven", honest=True)
    )
    for gain, error in ((0.9, 0.1), (1.02, 0.02), (1.1, 0.1)):
        found.append(
            Case(f"gain {gain}", RobotKind(gain=gain), DeclaredRobot(gain_error=error), honest=True)
        )
        found.append(Case(f"gain {gain}, undeclared", RobotKind(gain=gain)))
    found += [
        Case(f"speed noise {share:.0%}", RobotKind(speed_noise=share), honest=True)
        for share in (0.01, 0.05, 0.2)
    ]
    found += [Case(name, oddity=name) for name in ("spikes", "mm", "frame", "stalled", "half")]
    held = DeclaredRobot(longest_hold=HICCUP)
    found.append(Case("hiccups, declared", declared=held, periods="hiccups", honest=True))
    lagging = DeclaredRobot(lag=0.1, longest_hold=HICCUP)
    found.append(
        Case(
            "hiccups and lag, declared",
            RobotKind(lag=0.1),
            lagging,
            periods="one hiccup",
            honest=True,
        )
    )
    found.append(Case("hiccups, undeclared", periods="hiccups"))
    found.append(Case("hiccups, watchdog", periods="watched", honest=True))
    return found


def period(case: Case, dt: float, rng: np.random.Generator) -> tuple[float, float]:
    """Return (for how long the twist is meant, how much longer it is executed) [s].

    It is executed longer because the next call is late.
    """
    if case.periods == "uneven":
        return float(rng.uniform(0.5, 3.0)) * dt, 0.0
    late = case.periods in ("hiccups", "one hiccup", "watched") and rng.random() < 1 / 150
    return dt, HICCUP - dt if late else 0.0


def told(case: Case, robot: SimulatedRobot, reports: str, number: int) -> dict[str, Any]:
    """Return what the loop hears of the robot in a call.

    Args:
        case: the robot.
        robot: the same, simulated.
        reports: ``pose``, ``twist``, ``both``, ``lost`` (the pose is, for two thirds of the time)
            or ``nothing``.
        number: of the call.
    """
    given: dict[str, Any] = {}
    if reports in ("pose", "both") or (reports == "lost" and number // LOST % 3 == 0):
        given["pose"] = robot.measured_pose()
    if reports in ("twist", "both"):
        given["twist"] = robot.reported_twist()
    return given


__all__ = ["HICCUP", "NONE", "Case", "OddRobot", "cases", "moved", "period", "told"]
