"""Person, robot and object in one model.

It shows whether the twist is that of the fast step, and whether distance and joint limits are kept.

Run ``python -m benchmarks.whole_body [--quick | --full] [--json FILE]``. Every problem is run with
the Panda of ``models/panda.xml``, its base where `ergoqp.whole_body.grasp.default_base` puts it,
from awkward starts (each the worst of ten random places) of simulated people whose joint weights
are not the controller's, whose body is; they follow with a delay of 150 ms. Starts at which the arm
cannot hold the object, with the distance kept, are counted as ``unreachable`` and left out.

- ``max_twist_difference``: with the robot's limits and distances inactive, noisy angles: largest
  difference of any entry of the object's twist from `Stepper.step` on the same inputs, over the
  steps whose twist is the QP's answer (status optimal, relaxed or recovering, accepted whole).
  ``compared`` says how many. [m/s, rad/s]
- ``min_distance``: with the Panda's limits and a stated distance of 0.05 m: smallest distance over
  the loops of robot and object from the true person, and of the object from the arm, of the pairs
  that `ergoqp.whole_body.Scene.pairs` lists; angles without noise. ``noisy.min_distance`` the same
  with noise of 0.5 deg, drift of 1 deg and lost frames: what the robot sees is then not where the
  person is; ``noisy.over_speed``: by which share of its limit the object was faster then, at most.
  ``careless.min_distance``: the same starts and joints without distances in the QP; the quick
  sample begins at seed 1, at which the dentist's object would go through the thigh. [m]
- ``robot_violations``: samples that break a range, rate or acceleration of the arm.
  ``object_violations``: loops in which a limit of the object is broken by more than 1e-6 of its
  unit, by the independent checker; ``max_object_violation``: the worst, in its unit: the object's
  way is made of arcs of the arm. ``braking_share``: share of steps that have no answer with all
  limits of robot and object, though the fast step has one.
- ``slower_share``: share of steps in which limits of the robot or the distance hold the object
  back.
- ``mean_start``, ``mean_end``: exact score of the posture at the begin and at the end of the loops
  with distances. Beside it ``mean_still``, where the person comes to rest if the object stays where
  it is, and ``careless.mean_end`` without distances.
- ``step_us``, ``step_p99_us``: the whole call in a loop of screwing, distances and fast step
  included, one process.
- ``mink_us``: the formulation alone on steps of screwing, see `benchmarks.mink_peer`;
  ``mink_arm_us`` with the arm's joints as the only unknowns, ``pink_arm_us`` the same through pink;
  ``fast_us`` the fast step on the same trajectory.
"""

from __future__ import annotations

import os
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field, replace

import numpy as np

from benchmarks.mink_peer import mink_steps
from benchmarks.report import Report, run
from benchmarks.step import time_calls, trajectory
from ergoqp.errors import InputError
from ergoqp.problem.load import TASKS, load_problem
from ergoqp.problem.problem import Problem
from ergoqp.rest.best_place import awkward_start
from ergoqp.rest.model_person import ModelPerson, sample_person
from ergoqp.rest.person_protocol import SensorModel
from ergoqp.simulation.check import Checker
from ergoqp.step.stepper import Stepper
from ergoqp.whole_body import Robot, WholeBody, load_robot
from ergoqp.whole_body.loop import EXACT, WholeBodyTrace, run_whole_body

DISTANCE = 0.05
"""Stated distance [m]."""
ROUNDING = 1e-6
"""Of a limit of the object that counts as kept, in its unit."""
PLACES = 10
"""Every start is the worst of so many places."""


@dataclass
class Found:
    """Numbers of the loops of one problem."""

    unreachable: int = 0
    loops: int = 0
    differences: list[float] = field(default_factory=list)
    kept: list[float] = field(default_factory=list)
    noisy: list[float] = field(default_factory=list)
    over_speed: list[float] = field(default_factory=list)
    careless: list[float] = field(default_factory=list)
    robot_violations: int = 0
    object_violations: int = 0
    slower: list[float] = field(default_factory=list)
    max_object_violation: float = 0.0
    braking: list[float] = field(default_factory=list)
    start: list[int] = field(default_factory=list)
    end: list[int] = field(default_factory=list)
    still: list[int] = field(default_factory=list)
    careless_end: list[int] = field(default_factory=list)

    def add(self, other: Found) -> None:
        """Append another's numbers."""
        for name, value in vars(other).items():
            merged = max if name == "max_object_violation" else lambda a, b: a + b
            setattr(self, name, merged(getattr(self, name), value))


def unlimited() -> Robot:
    """The Panda's tree without ranges, rates and accelerations to speak of."""
    robot = load_robot("panda")
    k = np.ones(len(robot.joints))
    return replace(
        robot,
        lower=robot.lower - 50,
        upper=robot.upper + 50,
        velocity=1e3 * k,
        acceleration=1e6 * k,
    )


def loops_of_person(name: str, seed: int, count: int, duration: float) -> tuple[str, Found]:
    """Run all loops of one person in one problem."""
    problem, found = load_problem(name), Found()
    # IkResponse.
    person = sample_person(problem, seed, body=problem.response.body)  # pyright: ignore
    for number in range(count):
        posture = awkward_start(problem, person, 1000 * seed + number + 1, PLACES)
        try:
            whole = WholeBody(problem, posture=posture, distance=DISTANCE)
        except InputError:
            found.unreachable += 1
            continue
        found.loops += 1
        _with_distance(found, problem, whole, person, posture, duration, 1000 * seed + number)
        free = WholeBody(problem, unlimited(), posture=posture, distance=None)
        trace = run_whole_body(
            free,
            person,
            posture,
            duration=duration / 2,
            seed=1000 * seed + number,
            senses=SensorModel(),
        )
        found.differences += differences(trace)
    return name, found


def differences(trace: WholeBodyTrace) -> list[float]:
    """Return the largest difference of every compared step's twist from the fast step's."""
    steps = [
        step
        for step in trace.steps
        if step.object_step.status in ("optimal", "relaxed", "recovering")
    ]
    whole = [step for step in steps if step.object_step.residuals["accepted"] == 1]
    return [float(np.abs(step.twist - step.object_step.twist).max()) for step in whole]


def _with_distance(
    found: Found,
    problem: Problem,
    whole: WholeBody,
    person: ModelPerson,
    posture: np.ndarray,
    duration: float,
    seed: int,
) -> None:
    checker = Checker(whole.problem)
    trace = run_whole_body(
        whole, person, posture, duration=duration, seed=seed, senses=EXACT, checker=checker
    )
    found.kept.append(min(trace.distances))
    found.robot_violations += trace.broken_limits(whole)
    worst = max(checker.max_violation.values())
    found.object_violations += worst > ROUNDING
    found.max_object_violation = max(found.max_object_violation, worst)
    # A step that the fast step itself brakes is not the robot's doing.
    lost = [
        step.status == "braking" and step.object_step.status != "braking" for step in trace.steps
    ]
    found.braking.append(float(np.mean(lost)))
    scores = problem.assess(np.array([trace.postures[0], trace.postures[-1]])).final
    found.start.append(int(scores[0]))
    found.end.append(int(scores[1]))
    alone, reached = person.settle(
        posture, person.contact(posture)[0], person.grasp(posture), person.stand(posture)
    )
    found.still.append(int(problem.assess(alone if reached else posture).final[0]))
    found.slower.append(float(np.mean([step.status == "slower" for step in trace.steps])))
    noisy = run_whole_body(
        whole, person, posture, duration=duration, seed=seed, senses=SensorModel()
    )
    found.noisy.append(min(noisy.distances))
    speed = problem.twist_limit.speed
    twists = np.abs([step.twist for step in noisy.steps])[:, speed > 0]
    found.over_speed.append(float(np.max(twists / speed[speed > 0])) - 1)
    found.robot_violations += noisy.broken_limits(whole)
    # The same joints at the begin, and the same way of holding the object.
    blind = WholeBody(
        problem,
        posture=posture,
        distance=None,
        base=whole.scene.base,
        tool_frame=whole.scene.load.tool_frame,
        start=whole.start,
    )
    unkept = run_whole_body(blind, person, posture, duration=duration, seed=seed, senses=EXACT)
    found.careless.append(min(unkept.distances))
    found.careless_end.append(int(problem.assess(unkept.postures[-1]).final[0]))


def measure(report: Report) -> None:
    """Run everything in two processes; print the figures of all problems together, then of each."""
    people, starts, duration = report.pick(quick=(1, 1, 5.0), full=(2, 2, 8.0))
    jobs = [(name, seed, starts, duration) for seed in range(people) for name in TASKS]
    found = {name: Found() for name in TASKS}
    with ProcessPoolExecutor(min(2, os.cpu_count() or 1)) as pool:
        futures = [pool.submit(loops_of_person, *job) for job in jobs]
        for done, future in enumerate(as_completed(futures), start=1):
            name, part = future.result()
            found[name].add(part)
            report.say(
                f"{done}/{len(jobs)} {name}: {part.loops} loops, {part.unreachable} out of reach"
            )
    together = Found()
    for part in found.values():
        together.add(part)
    _figures(report, "", together)
    _times(report, report.pick(10.0, 40.0))
    for name, part in found.items():
        if part.loops:
            _figures(report, f"{name}.", part)


def _figures(report: Report, prefix: str, found: Found) -> None:
    figures = {
        "loops": found.loops,
        "unreachable": found.unreachable,
        "compared": len(found.differences),
        "max_twist_difference": max(found.differences),
        "min_distance": min(found.kept),
        "noisy.min_distance": min(found.noisy),
        "noisy.over_speed": max(found.over_speed),
        "careless.min_distance": min(found.careless),
        "robot_violations": found.robot_violations,
        "object_violations": found.object_violations,
        "max_object_violation": found.max_object_violation,
        "braking_share": np.mean(found.braking),
        "slower_share": np.mean(found.slower),
        "mean_start": np.mean(found.start),
        "mean_still": np.mean(found.still),
        "mean_end": np.mean(found.end),
        "careless.mean_end": np.mean(found.careless_end),
    }
    for name, value in figures.items():
        report.figure(f"{prefix}{name}", float(value))


def _times(report: Report, duration: float) -> None:
    problem = load_problem("screwing")
    whole, person, posture = _first_loop(problem)
    taken = [
        step.solve_time
        for step in run_whole_body(
            whole, person, posture, duration=duration, senses=SensorModel()
        ).steps
    ]
    report.figure("step_us", 1e6 * float(np.median(taken)), "the whole body's step, median")
    report.figure("step_p99_us", 1e6 * float(np.percentile(taken, 99)))
    stepper = Stepper(problem)
    calls = trajectory(problem, stepper, duration).calls
    report.figure(
        "fast_us", float(np.median(time_calls(stepper, calls)[0])), "the fast step, median"
    )
    peers = {
        "mink_us": mink_steps(problem, calls, "whole"),
        "mink_arm_us": mink_steps(problem, calls, "arm"),
    }
    try:
        from benchmarks.pink_peer import pink_steps
    except ImportError:
        report.say("pink or Pinocchio (packages 'pin-pink' and 'pin') is absent: no comparison")
    else:
        peers["pink_arm_us"] = pink_steps(problem, calls)
    for name, times in peers.items():
        meaning = (
            f"median of {len(times.whole_us)} steps, {np.median(times.own_us):.0f} us of it"
            " building and solving"
        )
        report.figure(name, float(np.median(times.whole_us)), meaning)


def _first_loop(problem: Problem) -> tuple[WholeBody, ModelPerson, np.ndarray]:
    # IkResponse.
    person = sample_person(problem, 0, body=problem.response.body)  # pyright: ignore
    posture = awkward_start(problem, person, 0, PLACES)
    return WholeBody(problem, posture=posture, distance=DISTANCE), person, posture


if __name__ == "__main__":
    run(measure, "Person, robot and object in one model: twists, distances, limits, times.")
