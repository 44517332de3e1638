"""Closed loop: a stepper, a robot that moves the object as well as it can, a person who follows."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from ergoqp.joints import JOINTS, LOWER, UPPER
from ergoqp.problem.problem import Problem
from ergoqp.simulation.check import Checker
from ergoqp.simulation.people import Senses, frames
from ergoqp.simulation.person import Follower
from ergoqp.simulation.robot import RobotKind, SimulatedRobot
from ergoqp.step.stepper import Step, Stepper

LONGEST = 3600.0
"""Longest run [s]."""

LET_GO = 0.12
"""A grip this far behind has let go [m]: more than the delay explains at any allowed speed."""


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
    let_go: float | None = None


@dataclass(frozen=True)
class Start:
    """A loop's start: a posture, how it holds the object, where that is, where the soles stand."""

    posture: np.ndarray
    pose: np.ndarray
    grasp: np.ndarray
    soles: np.ndarray


def start_at(person: Follower, posture: np.ndarray) -> Start:
    """Return the start in which the person holds the object in a given posture (32,) [rad]."""
    return Start(posture, person.contact(posture)[0], person.grasp(posture), person.stand(posture))


def run_loop(
    problem: Problem,
    person: Follower,
    start: Start,
    *,
    duration: float,
    seed: int,
    stepper: Stepper | None = None,
    senses: Senses | None = None,
    observed: np.ndarray | None = None,
    checker: Checker | None = None,
    stop_when_still: float | None = None,
    robot: RobotKind | None = None,
) -> Trace:
    """Run the loop and return its trace.

    Args:
        problem: the task; its model of the person is not the person's.
        person: who follows.
        start: where everything is at time 0.
        duration: [s].
        seed: of noise and lost frames.
        stepper: of this problem, reset here; None: a new one.
        senses: what lies between person and controller.
        observed: (32,) bool, joints that the sensors see; None: all.
        checker: judges every step; None: nobody does.
        stop_when_still: end early after resting for this long [s].
        robot: who moves the object; None: one as bad as the problem declares it, with a gain drawn
            by the seed.
    """
    senses = senses or Senses()
    stepper = stepper or Stepper(problem)
    stepper.reset()
    dt, posture, pose = stepper.dt, start.posture.copy(), start.pose.copy()
    rng = np.random.default_rng([seed, 7])
    arm = SimulatedRobot(robot or RobotKind.of(problem.robot, rng), pose, rng)
    late = deque([pose] * (1 + round(senses.delay / dt)))
    follow = 1.0 - float(np.exp(-dt / senses.hand_time))
    errors = frames(senses, dt, np.random.default_rng([seed, 2]))
    trace, previous, age, still = Trace(), np.zeros(6), 0.0, 0.0
    measured = posture.copy()
    for number in range(round(duration / dt)):
        error, arrives = next(errors)
        age = 0.0 if arrives or number == 0 else age + dt
        if age == 0.0:
            measured = posture + error
        begin = time.perf_counter()
        step = stepper.step(measured, arm.measured_pose(), age=age, observed=observed)
        trace.step_time.append(time.perf_counter() - begin)
        trace.time.append(number * dt)
        trace.postures.append(posture)
        trace.base_poses.append(person.contact(posture)[1])
        trace.poses.append(pose)
        trace.twists.append(step.twist)
        trace.steps.append(step)
        for after in arm.execute(step.twist, dt):
            pose = after
        if checker is not None:
            stops = step.status in ("braking", "invalid")
            checker.check(
                step.twist,
                previous,
                trace.poses[-1],
                measured,
                step.posture_rate,
                dt,
                observed,
                step.slack,
                pose,
                stops,
            )
        previous = step.twist
        late.append(pose)
        followed = late.popleft()
        held = np.hstack([followed @ grip for grip in start.grasp])
        posture, distance, _ = person.move(posture, held, start.soles, follow, dt)
        if distance > LET_GO and trace.let_go is None and number * dt > 1.0:
            trace.let_go = number * dt
        still = still + dt if step.status == "settled" and not step.twist.any() else 0.0
        if stop_when_still is not None and still >= stop_when_still:
            break
    return trace


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
