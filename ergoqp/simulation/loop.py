"""Closed loop: a stepper, a robot that moves the object as well as it can, a person who follows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from ergoqp.joints import JOINTS, LOWER, UPPER
from ergoqp.problem.problem import Problem
from ergoqp.simulation.check import Checker
from ergoqp.simulation.people.person import LET_GO, Holding, Person
from ergoqp.simulation.people.senses import frames
from ergoqp.simulation.robot import RobotKind, SimulatedRobot
from ergoqp.step.stepper import Step, Stepper

LONGEST = 3600.0
"""Longest run [s]."""


@dataclass
class Trace:
    """What one loop left behind, sample by sample.

    See `ergoqp.simulation.run.Run` for the meaning of the fields.
    """

    time: list[float] = field(default_factory=list)
    postures: list[np.ndarray] = field(default_factory=list)
    base_poses: list[np.ndarray] = field(default_factory=list)
    poses: list[np.ndarray] = field(default_factory=list)
    twists: list[np.ndarray] = field(default_factory=list)
    steps: list[Step] = field(default_factory=list)
    step_time: list[float] = field(default_factory=list)
    forces: list[np.ndarray] = field(default_factory=list)
    slips: list[int] = field(default_factory=list)
    unbalanced: list[bool] = field(default_factory=list)
    let_go: float | None = None
    fell: float | None = None

    def add(self, now: float, person: Holding, step: Step) -> None:
        """Append a sample."""
        self.time.append(now)
        self.postures.append(person.posture)
        self.base_poses.append(person.base)
        self.poses.append(person.pose)
        self.twists.append(step.twist)
        self.steps.append(step)
        self.forces.append(person.force)
        self.slips.append(person.slipped)
        self.unbalanced.append(person.unbalanced)
        if person.fallen and self.fell is None:
            self.fell = now


Beside = Callable[[float, Holding], bool]
"""Told the time [s] and the person after every period; says whether the loop ends there."""


class Controller(Protocol):
    """What says how the object moves: a `Stepper`, or who is compared with it."""

    @property
    def dt(self) -> float:
        """Control period [s]."""
        ...

    def reset(self) -> None:
        """Begin a loop."""
        ...

    def step(
        self,
        posture: np.ndarray,
        pose: np.ndarray,
        *,
        age: float,
        observed: np.ndarray | None,
    ) -> Step:
        """Return the twist for what is measured now; see `Stepper.step`."""
        ...


def run_loop(
    problem: Problem,
    person: Holding,
    *,
    duration: float,
    seed: int,
    controller: Controller | None = None,
    observed: np.ndarray | None = None,
    checker: Checker | None = None,
    stop_when_still: float | None = None,
    robot: RobotKind | None = None,
    beside: Beside | None = None,
) -> Trace:
    """Run the loop and return its trace.

    Args:
        problem: the task; its model of the person is not the person's.
        person: who follows, as they hold the object at time 0; goes on from there.
        duration: [s].
        seed: of noise and lost frames.
        controller: of this problem, reset here; None: a new `Stepper`.
        observed: (32,) bool, joints that the sensors see; None: all.
        checker: judges every step; None: nobody does.
        stop_when_still: end early after resting for this long [s].
        robot: who moves the object; None: one as bad as the problem declares it, with a gain drawn
            by the seed.
        beside: called after every period.
    """
    controller = controller or Stepper(problem)
    controller.reset()
    dt = controller.dt
    rng = np.random.default_rng([seed, 7])
    arm = SimulatedRobot(robot or RobotKind.of(problem.robot, rng), person.pose, rng)
    errors = frames(person.senses, dt, np.random.default_rng([seed, 2]))
    trace, previous, age, still = Trace(), np.zeros(6), 0.0, 0.0
    measured = person.posture.copy()
    for number in range(round(duration / dt)):
        error, arrives = next(errors)
        age = 0.0 if arrives or number == 0 else age + dt
        if age == 0.0:
            measured = person.posture + error
        step = controller.step(measured, arm.measured_pose(), age=age, observed=observed)
        trace.step_time.append(step.solve_time)
        trace.add(number * dt, person, step)
        before = arm.pose
        for _ in arm.execute(step.twist, dt):
            pass
        if checker is not None:
            stops = step.status in ("braking", "invalid")
            checker.check(
                step.twist,
                previous,
                before,
                measured,
                step.posture_rate,
                dt,
                observed,
                step.slack,
                arm.pose,
                stops,
            )
        previous = step.twist
        person.follow(arm.pose, dt)
        arm.see(person.pose)
        if beside is not None and beside((number + 1) * dt, person):
            break
        if person.gap > LET_GO and trace.let_go is None and number * dt > 1.0:
            trace.let_go = number * dt
        still = still + dt if step.status == "settled" and not step.twist.any() else 0.0
        if stop_when_still is not None and still >= stop_when_still:
            break
    return trace


def with_own_robot(
    problem: Problem, person: Person, robot: RobotKind | None, seed: int
) -> tuple[Problem, RobotKind | None]:
    """Return problem and robot of a loop with a person whose simulation has a robot of its own.

    What the problem declares stands before it: the controller is told of both, one after the other.

    Args:
        problem: the task.
        person: who follows.
        robot: as for `run_loop`.
        seed: as for `run_loop`.
    """
    own, declared = person.robot, problem.robot
    if own is None:
        return problem, robot
    both = {
        name: getattr(own, name) + getattr(declared, name)
        for name in ("lag", "pose_noise", "pose_noise_deg")
    }
    robot = robot or RobotKind.of(declared, np.random.default_rng([seed, 7]))
    return problem.replace(robot=replace(declared, **both)), robot


def outside_of_range(postures: np.ndarray) -> dict[str, int]:
    """Return how many samples of each joint are beyond its range, for the joints that ever are.

    The postures are (n, 32) [rad].
    """
    count = ((postures < LOWER - 1e-6) | (postures > UPPER + 1e-6)).sum(axis=0)
    return {joint: int(n) for joint, n in zip(JOINTS, count, strict=True) if n}


def settle_time(trace: Trace, still: float = 1.0) -> float:
    """Return when the object came to rest for good [s].

    It is inf if the object was not at rest for the last `still` seconds.
    """
    moving = np.flatnonzero(np.abs(trace.twists).max(axis=1) > 1e-9)
    end = trace.time[-1]
    came = trace.time[moving[-1]] if moving.size else 0.0
    return came if end - came >= still else float("inf")


def power_above(twists: np.ndarray, dt: float, speed: np.ndarray, frequency: float = 3.0) -> float:
    """Return the share of the twist's power above a frequency [Hz].

    Each axis is relative to its speed limit; at standstill the share is 0.
    """
    moving = speed > 0
    spectrum = np.abs(np.fft.rfft(twists[:, moving] / speed[moving], axis=0)) ** 2
    total = spectrum.sum()
    high = np.fft.rfftfreq(len(twists), dt) > frequency
    return float(spectrum[high].sum() / total) if total > 0 else 0.0
