"""People with mass: do they hold still, on their soles, without energy from nowhere, in time?

Per problem, over people drawn by seed, each holding the object at an awkward start:

- ``hold_drift_mm``: how far a hand goes at most in 20 s of holding still; ``falls`` in that time;
- ``energy_growth_j``: how much potential and kinetic energy of person and object grow at most in
  the 2 s after it, while nobody moves anything; negative: it falls;
- ``box_force_error_pct``: by how much the hands' force on the box differs at most from its weight
  once the robot has let go of it and the person holds it still;
- ``seconds_per_second``: processor time of one simulated second, the person's own Python included;
- ``unbalanced_pct``: share of the time with the centre of mass outside the soles or the seat while
  the object goes 0.2 m there and back.

Run ``python -m benchmarks.mass``.
"""

from __future__ import annotations

import time

import mujoco
import numpy as np

from benchmarks import report
from ergoqp.lab.mass.body import SOFT_ROBOT
from ergoqp.lab.mass.person import STILL, Mass, MassHolding
from ergoqp.problem.load import load_problem
from ergoqp.rest.best_place import awkward_start
from ergoqp.simulation.people import person_of_kind

PROBLEMS = ("screwing", "overhead", "low_bin", "dentist", "desk")
WEIGHT = SOFT_ROBOT.load * 9.81
FIRST_SEED = 400
"""Of people on whom nothing was tuned."""


def energy(who: MassHolding) -> float:
    """Return potential and kinetic energy of person and object [J]."""
    mujoco.mj_energyPos(who.model, who.data)
    mujoco.mj_energyVel(who.model, who.data)
    return float(who.data.energy.sum())


def growth_at_rest(who: MassHolding) -> float:
    """Return by how much the energy grows at most in two seconds of rest [J]."""
    pose, begin, most = who.pose.copy(), energy(who), -np.inf
    for _ in range(40):
        who.follow(pose, 0.05)
        most = max(most, energy(who) - begin)
    return most


def box_error(who: MassHolding) -> float:
    """Return how far the hands' force is from the box's weight without the robot [%]."""
    who.release()
    for _ in range(120):
        who.follow(who.pose, 0.05)
    return 100 * abs(-who.force[2] / WEIGHT - 1)


def there_and_back(who: MassHolding, axes: tuple[str, ...]) -> list[bool]:
    """Return, moment by moment, whether the person was out of balance on the way."""
    home, unbalanced = who.pose.copy(), []
    direction = np.array([float(axis in axes) for axis in ("x", "y", "z")]) * (-0.5, 0.5, 1.0)
    direction /= np.linalg.norm(direction)
    for moment in np.arange(0.0, 4.0, 0.01):
        pose = home.copy()
        pose[:3, 3] += 0.1 * (1 - np.cos(np.pi * moment / 2)) * direction
        who.follow(pose, 0.01)
        unbalanced.append(who.unbalanced)
    return unbalanced


def measure(out: report.Report) -> None:
    """Hold, rest, carry and move, per problem."""
    people = out.pick(1, 20)
    for name in PROBLEMS:
        problem = load_problem(name)
        drifts, falls, growths, errors, seconds, unbalanced = [], 0, [], [], [], []
        for seed in range(FIRST_SEED, FIRST_SEED + people):
            person = person_of_kind("mass", problem, seed)
            assert isinstance(person, Mass)
            posture = awkward_start(problem, person, seed, places=10)
            begin = time.process_time()
            who = person.hold(posture)
            seconds.append((time.process_time() - begin) / STILL)
            drifts.append(1e3 * who.held_drift)
            falls += who.fallen
            growths.append(growth_at_rest(who))
            errors.append(box_error(who.copy()))
            unbalanced += there_and_back(who, problem.twist_limit.axes)
        out.figure(f"{name}.hold_drift_mm", max(drifts), f"{people} people, at most")
        out.figure(f"{name}.falls", falls, "while holding still")
        out.figure(f"{name}.energy_growth_j", max(growths), "in 2 s of rest, at most")
        out.figure(f"{name}.box_force_error_pct", max(errors), "without the robot, at most")
        out.figure(f"{name}.seconds_per_second", float(np.median(seconds)), "median")
        out.figure(f"{name}.unbalanced_pct", 100 * float(np.mean(unbalanced)), "while moving")


if __name__ == "__main__":
    report.run(measure, "People with mass: still, balanced, with no energy from nowhere, in time.")
