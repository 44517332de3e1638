"""The closed loop of a stepper, a simulated robot that moves the object, and a simulated person."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from ergoqp.arguments import check_number, check_whole
from ergoqp.joints import JOINTS, LOWER, UPPER
from ergoqp.problem.problem import Problem
from ergoqp.problem.settings import Frames
from ergoqp.rest.person_protocol import LET_GO, Holding, Person, frames
from ergoqp.simulation.check import Checker
from ergoqp.simulation.robot import RobotKind, SimulatedRobot
from ergoqp.step.stepper import Step, Stepper


def check_numbers(problem: Problem, duration: float, seed: int) -> None:
    """Check the numbers of a run before anything is computed.

    Raises:
        InputError: if the duration or the seed is out of range.
    """
    check_number("duration", duration, problem.dt, LONGEST, "s")
    check_whole("seed", seed, 0)


LONGEST = 3600.0
"""Longest run [s]."""


@dataclass
class Trace:
    """Samples of one loop.

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
"""Called with the time [s] and the person after every period; returns whether the loop ends."""


class Controller(Protocol):
    """Computes the twist of the object: a `Stepper`, or a controller that is compared with it."""

    @property
    def dt(self) -> float:
        """Control period [s]."""
        ...

    def reset(self) -> None:
        """Reset the state for a new loop."""
        ...

    def step(
        self,
        posture: np.ndarray,
        pose: np.ndarray,
        *,
        age: float,
        observed: np.ndarray | None,
    ) -> Step:
        """Return the twist for the present measurements, see `Stepper.step`."""
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
        problem: the task; its model of the person differs from the person.
        person: the person who follows and holds the object at time 0; their state is changed.
        duration: duration [s].
        seed: seed of noise and lost frames.
        controller: a controller of this problem, which is reset; None: a new `Stepper`.
        observed: (32,) bool, joints that the sensors see; None: all.
        checker: checks every step; None: no check.
        stop_when_still: end early after a rest of this length [s].
        robot: the robot that moves the object; None: one with the errors that the problem
            declares, with a gain drawn with the seed.
        beside: called after every period.
    """
    controller = controller or Stepper(in_world(problem), compiled=False)
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


def in_world(problem: Problem) -> Problem:
    """Return the problem without its frames: a simulation reports contact frames in the world."""
    return problem if problem.frames == Frames() else problem.replace(frames=Frames())


def with_own_robot(
    problem: Problem, person: Person, robot: RobotKind | None, seed: int
) -> tuple[Problem, RobotKind | None]:
    """Return problem and robot of a loop with a person whose simulation includes its own robot.

    The declared robot of the problem comes before it. The controller is told of both, one
    after the other.

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
    """Return the number of samples beyond the range, for each joint that ever is beyond.

    The postures are (n, 32) [rad].
    """
    count = ((postures < LOWER - 1e-6) | (postures > UPPER + 1e-6)).sum(axis=0)
    return {joint: int(n) for joint, n in zip(JOINTS, count, strict=True) if n}


def settle_time(trace: Trace, still: float = 1.0) -> float:
    """Return the time at which the object came to rest for good [s].

    It is inf if the object was not at rest for the last `still` seconds.
    """
    moving = np.flatnonzero(np.abs(trace.twists).max(axis=1) > 1e-9)
    end = trace.time[-1]
    came = trace.time[moving[-1]] if moving.size else 0.0
    return came if end - came >= still else float("inf")
