"""Rest postures with exact scores per second, compiled, beside the interpreter.

Run ``python -m benchmarks.rests [--quick | --full] [--json FILE]``. Places are drawn over the
workspace of every bundled problem, and the person comes to each from comfort. Times are minima of
CPU time. Per problem it prints

- ``rests_per_s``: compiled rests with exact scores per second and core; ``one_lane_per_s``: without
  lanes; ``interpreted_per_s``: by `ModelPerson.settle`.
- ``apart_rad``: largest difference of compiled and interpreted rests; ``reach_differs``: places of
  which only one says that they are reached.
- ``worst_rad``: largest distance of a rest from where the steps converge (1e-11 rad);
  ``plain_worst_rad``: the same after 150 plain steps, of the places that the interpreter settles.
"""

from __future__ import annotations

import time

import numpy as np

from benchmarks.report import Report, run
from ergoqp.problem.load import TASKS, load_problem
from ergoqp.rest.batch import LANES, BatchedRests
from ergoqp.rest.best_place import workspace_poses
from ergoqp.rest.model_person import ModelPerson, person_of

SPACING = 0.1
PLAIN = 150


def measure(report: Report) -> None:
    """Print the figures of every problem."""
    count, alone, rounds = report.pick(quick=(400, 20, 3), full=(4000, 400, 7))
    for name in TASKS:
        problem = load_problem(name)
        person = ModelPerson(person_of(problem))
        comfort = person.comfort
        grasp, soles = person.grasp(comfort), person.stand(comfort)
        poses = workspace_poses(problem, SPACING)
        poses = poses[np.random.default_rng(0).integers(len(poses), size=count)]
        postures, reached = np.empty((0, 32)), np.empty(0, dtype=bool)
        for figure, lanes in (("one_lane_per_s", 1), ("rests_per_s", LANES)):
            batch = BatchedRests(person, lanes)
            shortest = np.inf
            for _ in range(rounds):
                begin = time.process_time()
                postures, reached = batch.settle(comfort, poses, grasp, soles)
                np.where(reached, problem.assess(postures).final, 0)
                shortest = min(shortest, time.process_time() - begin)
            report.figure(f"{name}.{figure}", count / shortest)
        begin = time.process_time()
        told = [person.settle(comfort, pose, grasp, soles) for pose in poses[:alone]]
        report.figure(f"{name}.interpreted_per_s", alone / (time.process_time() - begin))
        rests, there = np.array([q for q, _ in told]), np.array([yes for _, yes in told])
        apart = np.abs(rests - postures[:alone])[there]
        report.figure(f"{name}.apart_rad", float(apart.max(initial=0.0)))
        report.figure(f"{name}.reach_differs", int((there != reached[:alone]).sum()))
        ends, _ = batch.settle(postures, poses, grasp, soles, steps=5000, tolerance=1e-11)
        worst = np.abs(ends - postures)[reached].max(initial=0.0)
        report.figure(f"{name}.worst_rad", float(worst))
        plain = np.array([_plain(person, pose, grasp, soles) for pose in poses[:alone]])
        worst = np.abs(ends[:alone] - plain)[reached[:alone]].max(initial=0.0)
        report.figure(f"{name}.plain_worst_rad", float(worst))


def _plain(
    person: ModelPerson, pose: np.ndarray, grasp: np.ndarray, soles: np.ndarray
) -> np.ndarray:
    """Return the posture after plain steps."""
    targets, relax = (
        np.hstack([pose @ grip for grip in grasp]),
        0.5 * person.response.relaxation_time,
    )
    posture = person.comfort
    for _ in range(PLAIN):
        posture, _, _ = person.move(posture, targets, soles, 1.0, relax)
    return posture


if __name__ == "__main__":
    run(measure, __doc__ or "")
