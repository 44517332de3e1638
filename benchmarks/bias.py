"""Sensors that read wrong by a constant angle.

The object stays where it would, and nobody is led to a worse posture by them.

Run ``python -m benchmarks.bias [--quick | --full] [--json FILE]``. Every joint reads 2, 5 and 10
degrees too much and too little, one at a time (``single``) and all at once with random signs and
sizes up to that (``random``). Beside every figure stands the same loop without rows of the posture
(``without``: no joint limits), which knows no ranges that a wrong angle could break.

Held: the person does not follow, and is at ease.

- ``travel_m.single``, ``travel_m.random``: longest way of the object, over all joints, sizes and
  problems [m]; ``....without``: the same without rows.
- ``travel_over_m``: by how much the way with rows is longer than that without, at most, loop by
  loop.

Following: people who are not the model (`ergoqp.simulation.people`), with these sensors.

- ``worse_than_start_measured``: share of the loops that end worse than they began by what the
  sensors say, rest posture to rest posture; ``worse_than_start``: by the truth, the control, and
  ``worse_than_start.without`` without rows.
- ``worse_by_rows``: share of the loops that end worse by the sensors with rows, and not without.
- ``never_rests``: share in which the object is still moving at the end.
- ``moves``: share in which the object goes anywhere, over the same share without rows.

Narrow ranges: sixteen joints have ranges of a few degrees that the start is outside of, with noise.

- ``stands_still``: share of the starts from which the object does not move, less those from which
  it does not move without rows; ``stands_still.needless``: of these, the share for which some twist
  of the problem's axes would take no joint further beyond its range (a linear program on the
  response at the start). Where none would, only standing still keeps the ranges.
"""

from __future__ import annotations

import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

from benchmarks.report import Report, run
from ergoqp.joints import INDEX, JOINTS, LOWER, UPPER
from ergoqp.limits import AXES, JointLimit
from ergoqp.problem.load import TASKS, load_problem
from ergoqp.problem.problem import Problem
from ergoqp.rest.best_place import awkward_start
from ergoqp.rest.model_person import ModelPerson, Start, sample_person
from ergoqp.rest.person_protocol import SensorModel
from ergoqp.simulation.loop import Trace, run_loop
from ergoqp.step.stepper import Stepper

SIZES_DEG = (2.0, 5.0, 10.0)
MOVED = 0.01
"""The object has gone somewhere [m], turning counted at `ARM` from the axis."""

ARM = 0.3
"""Where turning is counted [m]."""

HELD = 12.0
"""How long the posture is held [s]."""


def without_rows(problem: Problem) -> Problem:
    """Return a problem without rows of the posture."""
    return problem.replace(
        limits=[limit for limit in problem.limits if not isinstance(limit, JointLimit)]
    )


def held(problem: Problem, stepper: Stepper, posture: np.ndarray) -> float:
    """Return how far the object goes [m] while the posture (32,) stays, turns counted at `ARM`."""
    stepper.reset()
    way = np.zeros(6)
    longest = 0.0
    for _ in range(round(HELD / problem.dt)):
        step = stepper.step(posture)
        way += step.twist * problem.dt
        longest = max(longest, float(np.linalg.norm(way[:3])), ARM * float(np.linalg.norm(way[3:])))
        if step.status == "settled" and not step.twist.any():
            break
    return longest


def biases(rng: np.random.Generator, count: int) -> list[tuple[str, np.ndarray]]:
    """Return (``single`` or ``random``, bias (32,) [rad])."""
    found = []
    for size in np.radians(SIZES_DEG):
        for joint in range(len(JOINTS)):
            for sign in (1.0, -1.0):
                one = np.zeros(len(JOINTS))
                one[joint] = sign * size
                found.append(("single", one))
        found += [("random", rng.uniform(-size, size, len(JOINTS))) for _ in range(count)]
    return found


def held_of(name: str, every: int, count: int) -> list[tuple[str, float, float]]:
    """Return (kind of bias, way with rows, way without) of every bias on one problem."""
    problem = load_problem(name)
    bare = without_rows(problem)
    with_rows, without = Stepper(problem), Stepper(bare)
    comfort = np.asarray(problem.response.comfort)  # type: ignore[attr-defined]
    found = []
    for kind, bias in biases(np.random.default_rng(5), count)[::every]:
        posture = comfort + bias
        found.append((kind, held(problem, with_rows, posture), held(bare, without, posture)))
    return found


class Biased(Stepper):
    """Stands between the loop and its stepper: every posture is read with the same error."""

    def __init__(self, stepper: Stepper, bias: np.ndarray) -> None:
        """Keep the error (32,) [rad]."""
        self._stepper, self._bias, self.dt = (
            stepper,
            bias,
            stepper.dt,
        )  # what a loop asks of a stepper is passed on

    def reset(self, twist: Any = None) -> None:
        """Start again."""
        self._stepper.reset(twist)

    def step(self, posture: Any, *given: Any, **named: Any) -> Any:
        """Read wrong, and answer."""
        return self._stepper.step(np.clip(posture + self._bias, -np.pi, np.pi), *given, **named)


def follows(
    problem: Problem,
    stepper: Stepper,
    person: ModelPerson,
    start: Start,
    bias: np.ndarray,
    seed: int,
) -> tuple[bool, bool, bool, bool]:
    """Return (ends worse by the sensors, ends worse in truth, never rests, moves) for a loop."""
    trace = run_loop(
        problem,
        person.holding(start, SensorModel(drift_deg=0.0)),
        duration=20.0,
        seed=seed,
        controller=Biased(stepper, bias),
        stop_when_still=2.0,
    )
    ends = [person.settle(start.posture, start.pose, start.grasp, start.soles)[0]]
    rest, reached = person.settle(trace.postures[-1], trace.poses[-1], start.grasp, start.soles)
    ends.append(rest if reached else trace.postures[-1])
    true = problem.assess(np.array(ends)).final
    read = problem.assess(np.clip(np.array(ends) + bias, LOWER, UPPER)).final
    still = trace.steps[-1].status == "settled" and not trace.steps[-1].twist.any()
    return bool(read[1] > read[0]), bool(true[1] > true[0]), not still, has_gone(trace)


def has_gone(trace: Trace) -> bool:
    """Return whether the object is elsewhere at the end of a loop."""
    first, last = trace.poses[0], trace.poses[-1]
    turned = ARM * Rotation.from_matrix(last[:3, :3] @ first[:3, :3].T).magnitude()
    return max(float(np.linalg.norm(last[:3, 3] - first[:3, 3])), turned) > MOVED


def could_go(problem: Problem, posture: np.ndarray, ranges: dict[str, tuple[float, float]]) -> bool:
    """Return whether a twist of the problem's axes takes no joint further beyond its range."""
    S = np.array(problem.response.sensitivity()(posture, np.zeros(len(JOINTS)))[0])
    axes = [AXES.index(axis) for axis in problem.twist_limit.axes]
    rows = []
    for joint, (low, high) in ranges.items():
        degrees = np.degrees(posture[INDEX[joint]])
        if not low <= degrees <= high:
            rows.append(S[INDEX[joint], axes] * (1.0 if degrees < low else -1.0))
    wishes = (*np.eye(len(axes)), *-np.eye(len(axes)))
    found = (
        [
            linprog(wish, A_ub=-np.array(rows), b_ub=np.zeros(len(rows)), bounds=(-1, 1)).fun
            for wish in wishes
        ]
        if rows
        else []
    )
    return not rows or min(found) < -1e-6


def following_of(name: str, people: range, count: int) -> list[tuple[tuple, tuple]]:
    """Return, for every person and bias, the facts of the loop with rows and without."""
    problem = load_problem(name)
    bare = without_rows(problem)
    steppers, found = (Stepper(problem), Stepper(bare)), []
    for seed in people:
        person, rng = sample_person(problem, seed), np.random.default_rng([seed, 9])
        start = person.start_at(awkward_start(problem, person, seed, 10))
        for size in np.radians(SIZES_DEG):
            for number in range(count):
                bias = rng.uniform(-size, size, len(JOINTS))
                if number % 2:
                    bias = np.where(
                        np.arange(len(JOINTS)) == rng.integers(len(JOINTS)),
                        np.copysign(size, bias),
                        0.0,
                    )
                pair = (
                    follows(each, step, person, start, bias, seed)
                    for each, step in zip((problem, bare), steppers, strict=True)
                )
                found.append(tuple(pair))
    return found


def narrow_of(name: str, seeds: range) -> tuple[int, int, int, int]:
    """Return counts of (starts, still starts, those still without rows too, needlessly still).

    From a still start the object does not move; needlessly, where it could.
    """
    problem = load_problem(name)
    count = still = both = needless = 0
    for seed in seeds:
        rng, person = np.random.default_rng([seed, 10]), sample_person(problem, seed)
        start = person.start_at(awkward_start(problem, person, seed, 10))
        chosen = rng.choice(
            [joint for joint in problem.joints], min(16, len(problem.joints)), replace=False
        )
        ranges = {}
        for joint in chosen:
            i = INDEX[joint]
            # From 2 to 6 degrees beyond the posture that the loop begins with, on either side.
            near = start.posture[i] + np.radians(rng.uniform(2, 6)) * rng.choice([-1, 1])
            low, high = np.degrees(
                sorted((near, near + np.sign(near - start.posture[i]) * np.radians(30)))
            )
            low, high = max(low, np.degrees(LOWER[i])), min(high, np.degrees(UPPER[i]))
            if high - low > 1:
                ranges[joint] = (float(low), float(high))
        joints: JointLimit = problem.limit_of(JointLimit)
        limits = [
            replace(joints, ranges_deg=ranges) if limit is joints else limit
            for limit in problem.limits
        ]
        gone = []
        for each in (problem.replace(limits=limits), without_rows(problem)):
            trace = run_loop(
                each, person.holding(start), duration=6.0, seed=seed, controller=Stepper(each)
            )
            gone.append(has_gone(trace))
        count, still, both = count + 1, still + (not gone[0]), both + (not gone[0] and not gone[1])
        needless += not gone[0] and gone[1] and could_go(problem, start.posture, ranges)
    return count, still, both, needless


def measure(report: Report) -> None:
    """Run everything in two processes."""
    names = report.pick(TASKS[-1:], TASKS)
    with ProcessPoolExecutor(min(2, os.cpu_count() or 1)) as pool:
        still = [
            pool.submit(held_of, name, report.pick(7, 1), report.pick(7, 20)) for name in names
        ]
        loops = [
            pool.submit(following_of, name, range(i, i + 1), report.pick(2, 6))
            for name in names
            for i in range(40, report.pick(42, 48))
        ]
        tight = [pool.submit(narrow_of, name, range(50, report.pick(53, 60))) for name in names]
        ways = [way for future in still for way in future.result()]
        facts = [pair for future in loops for pair in future.result()]
        narrow = np.sum([future.result() for future in tight], axis=0)
    for kind in ("single", "random"):
        report.figure(
            f"travel_m.{kind}",
            max(way for found, way, _ in ways if found == kind),
            "held posture, longest way",
        )
        report.figure(
            f"travel_m.{kind}.without",
            max(way for found, _, way in ways if found == kind),
            "without rows of the posture",
        )
    report.figure(
        "travel_over_m",
        max(way - bare for _, way, bare in ways),
        f"loop by loop, {len(ways)} loops",
    )
    pairs = np.array(facts, dtype=float)  # loop, with or without rows, fact
    rows, bare = pairs.mean(axis=0)
    report.figure("loops", len(facts))
    report.figure("worse_than_start_measured", rows[0])
    report.figure("worse_than_start_measured.without", bare[0])
    report.figure("worse_by_rows", np.mean((pairs[:, 0, 0] == 1) & (pairs[:, 1, 0] == 0)))
    report.figure("worse_than_start", rows[1], "in truth")
    report.figure("worse_than_start.without", bare[1])
    report.figure("never_rests", rows[2])
    report.figure("never_rests.without", bare[2])
    report.figure(
        "moves",
        rows[3] / bare[3] if bare[3] else 1.0,
        f"{rows[3]:.2f} against {bare[3]:.2f} without rows",
    )
    report.figure(
        "stands_still",
        (narrow[1] - narrow[2]) / narrow[0],
        f"{narrow[1]} of {narrow[0]} starts, {narrow[2]} without rows too",
    )
    report.figure(
        "stands_still.needless", narrow[3] / narrow[0], "although a twist would keep all ranges"
    )


if __name__ == "__main__":
    run(measure, __doc__ or "")
