"""Robots that turn without rest, as declared or a little beyond it, for `benchmarks.tracking`.

Every pair and triple of what can be declared is declared, with true values at zero, in the middle
and at the ends. A posture whose first entries are the direction drives the object, so that it turns
about one axis after another for half a minute and never stands still: errors that are present turn
with the object, and turns do not commute. Half of the objects turn within a cone, at times and
speeds that are drawn.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, Final

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ergoqp.joints import JOINTS
from ergoqp.limits import AxisCone, TwistLimit, WorkspaceBox
from ergoqp.problem.load import load_problem
from ergoqp.problem.problem import Problem
from ergoqp.problem.settings import Control, DeclaredRobot, Frames
from ergoqp.simulation.robot import RobotKind, SimulatedRobot, moved
from ergoqp.step.stepper import Stepper

TURN: Final = 1.0
"""Every so often the object turns about another axis [s]; in a cone so often on average."""

NAMED_WITHIN: Final = 3.0
"""How soon a robot that is a little beyond what is declared is to be named [s]."""

DECLARED: Final = {
    "gain_error": (0.02, 0.05, 0.1, 0.2, 0.5),
    "noise": (0.2, 0.5, 1.0, 2.0),
    "delay": (0.01, 0.03, 0.06),
    "lag": (0.02, 0.05, 0.1, 0.2),
    "longest_hold": (0.05, 0.1, 0.3),
    "pose_delay": (0.01, 0.03, 0.05),
}
"""What may be declared; noise in mm, and a fifth of it in degrees."""


@dataclass(frozen=True)
class Direction:
    """A cost that falls along the direction that the first six entries of the posture give."""

    minimum: float = 0.0
    name: str = "direction"

    def __call__(self, postures: ArrayLike) -> np.ndarray:
        """Return the cost of postures (n, 32)."""
        return 25.0 * np.sum(np.atleast_2d(postures)[:, :6] ** 2, axis=1)

    def expression(self, q: ca.MX) -> ca.MX:
        """Return the same as an expression."""
        return 25.0 * ca.sumsqr(q[:6])


@dataclass(frozen=True)
class Directly:
    """A response whose first six joints are the object's six axes."""

    coordinates = JOINTS
    joints = JOINTS[:6]
    largest = float(np.pi)

    @property
    def weight_vector(self) -> np.ndarray:
        """Return the same weight for every joint."""
        return np.ones(len(JOINTS))

    @property
    def comfort(self) -> np.ndarray:
        """Return zeros."""
        return np.zeros(len(JOINTS))

    def expression(self, q: ca.MX) -> ca.MX:
        """Return S."""
        return self.sensitivity()(q, ca.MX(len(JOINTS), 1))[0]

    def sensitivity(self) -> ca.Function:
        """Return ``(posture, locked) -> (S, E)``."""
        n = len(JOINTS)
        q, locked, S = ca.SX.sym("q", n), ca.SX.sym("locked", n), ca.SX(n, 6)
        for axis in range(6):
            S[axis, axis] = 1 - locked[axis]
        return ca.Function("sensitivity", [q, locked], [ca.densify(S), ca.SX.zeros(1, 6)])

    def contact(self) -> ca.Function:
        """Return ``posture -> (pose, axes)``: the middle of the world, whatever the posture is."""
        q = ca.SX.sym("q", len(JOINTS))
        return ca.Function("contact", [q], [ca.densify(ca.SX.eye(4)), ca.densify(ca.SX.eye(4))])


FAR: Final = WorkspaceBox((-50, -50, -50), (50, 50, 50))
CONE: Final = AxisCone((1.0, 0.0, 0.0), 35.0)


def driven_problem(robot: DeclaredRobot, walls: Sequence[Any] = (FAR,)) -> Problem:
    """Return a problem whose object goes where the posture says and never rests."""
    control = Control(comfort=0.0, stall_after=1e6, rest_below=0.0, move_above=0.0)
    return load_problem("screwing").replace(
        cost=Direction(),
        response=Directly(),
        limits=[TwistLimit(), *walls],
        control=control,
        robot=robot,
        # The contact frame of these postures is nowhere.
        frames=Frames(compare=False),
    )


class Cornered(SimulatedRobot):
    """A robot whose pose is measured with its whole noise along all axes, changing now and then."""

    def measured_pose(self) -> np.ndarray:
        """Return the pose as measured now."""
        pose, kind = self._seen[0][1], self.kind
        if not hasattr(self, "_signs") or self._rng.random() < 0.05:
            self._signs = self._rng.choice([-1.0, 1.0], 6)
        most = np.repeat([kind.pose_noise, np.radians(kind.pose_noise_deg)], 3)
        return moved(pose, self._signs * most)


def declarations(count: int, seed: int) -> Iterator[tuple[DeclaredRobot, list[str]]]:
    """Yield `count` declared robots, every pair and triple of faults in turn, and their names."""
    kinds = [each for size in (2, 3) for each in combinations(DECLARED, size)]
    rng = np.random.default_rng([seed, 31])
    for number in range(count):
        names = kinds[number % len(kinds)]
        given = {name: float(rng.choice(DECLARED[name])) for name in names}
        if noise := given.pop("noise", None):
            given |= {"pose_noise": 1e-3 * noise, "pose_noise_deg": 0.2 * noise}
        yield DeclaredRobot(**given), list(names)


def true_robot(declared: DeclaredRobot, rng: np.random.Generator) -> RobotKind:
    """Return a robot with each declared value at zero, in the middle or at its end."""

    def share() -> float:
        return float(rng.choice([0.0, 0.5, 1.0]))

    noise = share()
    return RobotKind(
        delay=share() * declared.delay,
        lag=share() * declared.lag,
        gain=1 + share() * float(rng.choice([-1.0, 1.0])) * declared.gain_error,
        pose_delay=share() * declared.pose_delay,
        pose_noise=noise * declared.pose_noise,
        pose_noise_deg=noise * declared.pose_noise_deg,
    )


def turn_about(
    stepper: Stepper, kind: RobotKind, seconds: float, rng: np.random.Generator, until_named: bool
) -> list[tuple[float, str]]:
    """Drive an object about; return when and what of its robot was said.

    A declared hold happens once, at some time. Half of the robots report their twist as well, and a
    third of them has its whole noise along all axes.
    """
    problem, dt = stepper.problem, stepper.dt
    mover = (Cornered if rng.random() < 1 / 3 else SimulatedRobot)(kind, np.eye(4), rng)
    reports, named, q, time = rng.random() < 0.5, [], np.zeros(len(JOINTS)), 0.0
    late, hold = float(rng.uniform(0.3, 0.9)) * seconds, problem.robot.longest_hold
    steps, between, in_cone = round(seconds / dt), round(TURN / dt), CONE in problem.limits
    stepper.reset()
    for number in range(steps):
        if number == 0 or (rng.random() < 1 / between if in_cone else number % between == 0):
            way = rng.normal(size=6)
            speed = float(rng.choice([0.03, 0.3, 3.0])) if in_cone else 3.0
            q[:6] = -speed * way / np.abs(way).max()
        told = mover.reported_twist() if reports else None
        step = stepper.step(q, mover.measured_pose(), told)
        if "robot:" in step.reason:
            named.append((time, step.reason))
            if until_named:
                break
        lasts = dt
        if hold and time >= late:
            lasts, hold = dt + float(rng.choice([0.0, 0.5, 1.0])) * (hold - dt), 0.0
        for _ in mover.execute(step.twist, lasts):
            pass
        time += lasts
    return named


def honest(declared: DeclaredRobot, names: list[str], runs: int, seconds: float, seed: int) -> list:
    """Return (declared, true robot, when and what was said) of each run of robots as declared."""
    stepper = Stepper(driven_problem(declared, (FAR, CONE) if seed % 2 else (FAR,)))
    found = []
    for run in range(runs):
        rng = np.random.default_rng([seed, run, 41])
        kind = true_robot(declared, rng)
        found.append((names, declared, kind, turn_about(stepper, kind, seconds, rng, False)))
    return found


def near(number: int, seed: int) -> list:
    """Return the same of robots that are a little beyond what is declared."""
    rng, found = np.random.default_rng([seed, number, 51]), []
    noise = {"pose_noise": 1e-3, "pose_noise_deg": float(rng.choice([0.1, 0.2]))}
    for beyond in ("gain", "lag"):
        declared = DeclaredRobot(
            **noise,
            gain_error=float(rng.choice([0.0, 0.02, 0.05])) if beyond == "gain" else 0.0,
            lag=float(rng.choice([0.1, 0.15, 0.2])) if beyond == "lag" else 0.0,
        )
        kind = RobotKind.of(declared, rng)
        sign = float(rng.choice([-1.0, 1.0]))
        kind = (
            replace(kind, gain=1 + sign * (declared.gain_error + 0.03))
            if beyond == "gain"
            else replace(kind, lag=1.3 * declared.lag)
        )
        stepper = Stepper(driven_problem(declared))
        said = turn_about(stepper, kind, NAMED_WITHIN, rng, True)
        found.append(([beyond], declared, kind, said))
    return found
