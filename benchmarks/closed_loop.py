"""Whole closed loops: problems x people x starts, with people who are not the controller's model.

Run ``python -m benchmarks.closed_loop [--quick | --full] [--json FILE]``. ``--quick`` (the default)
takes one person with four starts per problem; ``--full`` ten people with twenty starts each. Per
problem it prints

- ``runs``: loops that were run. A start is a random reachable place at rest, at least 2 points
  above the person's best.
- ``share_at_best``: share whose noise-free rest posture, where the object came to rest, has the
  lowest exact score that brute force on a grid of places or the offline optimiser finds for that
  person (or lower). ``share_at_grid_best``: by the grid alone. A robot that stands still has none
  of either: starts are chosen so.
- ``worse_than_start``: share that ends above its start. ``mean_start``, ``mean_best``,
  ``mean_end``: exact scores.
- ``violations``: steps that broke a limit, by the independent checker. ``exceptions``: loops that
  raised.
- ``braking_share``: share of steps with status braking or invalid.
- ``settle_s``: 95th percentile of the time after which the object did not move any more (never:
  inf).
- ``power_above_3hz``: mean share of the twist's power above 3 Hz.
- ``plain_...``: the plain way on the same starts: the same cost, the same S, twist = -eps S' dV/dq
  and nothing else (equation 3.3 of the EPFL report), stopped at the end of the same time.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from benchmarks.loops import Loops, end_score, figures_of, gather, optimum_of, run_loops
from benchmarks.report import Report, run
from ergoqp.problem.load import TASKS, load_problem
from ergoqp.problem.problem import Problem
from ergoqp.rest.model_person import ModelPerson, Start, sample_person
from ergoqp.rest.person_protocol import SensorModel, frames
from ergoqp.simulation.check import Checker
from ergoqp.simulation.loop import Trace
from ergoqp.simulation.robot import moved
from ergoqp.step.stepper import Stepper

EPS = 0.02
"""Gain of the plain way: a slope of 10 points per metre gives 0.2 m/s."""


@dataclass
class BothLoops(Loops):
    """Numbers of the loops of one problem, and of the plain way's beside them."""

    plain_end: list[int] = field(default_factory=list)
    plain_violations: list[float] = field(default_factory=list)


def loops_of_person(name: str, person_seed: int, count: int) -> tuple[str, BothLoops]:
    """Run all loops of one person in one problem."""
    problem = load_problem(name)
    person, plain, loops = sample_person(problem, person_seed), _plain_way(problem), BothLoops()

    def beside(start: Start, seed: int, trace: Trace) -> None:
        end, broken = plain(person, start, len(trace.steps), seed)
        loops.plain_end.append(end)
        loops.plain_violations.append(broken)

    run_loops(
        loops,
        problem,
        person,
        person_seed,
        count,
        Stepper(problem),
        beside,
        optimum_of(problem, person),
    )
    return name, loops


def _plain_way(problem: Problem):
    """Return the plain controller's loop.

    It maps (person, start, steps, seed) to (end score, share of steps that broke a limit).
    """
    q = ca.MX.sym("q", 32)
    slope = problem.response.expression(q).T @ ca.gradient(problem.cost.expression(q), q)
    descend = ca.Function("plain", [q], [-EPS * slope])
    senses = SensorModel()
    follow = 1.0 - float(np.exp(-problem.dt / senses.hand_time))

    def loop(person: ModelPerson, start: Start, steps: int, seed: int) -> tuple[int, float]:
        checker = Checker(problem)
        errors = frames(senses, problem.dt, np.random.default_rng([seed, 2]))
        posture, pose, twist = start.posture, start.pose, np.zeros(6)
        late = [pose] * (1 + round(senses.delay / problem.dt))
        broken = 0
        for _ in range(steps):
            error, arrives = next(errors)
            previous = twist
            if arrives:
                twist = np.array(descend(posture + error)).ravel()
            broken += bool(checker.check(twist, previous, pose, None, np.zeros(32), problem.dt))
            pose = moved(pose, twist * problem.dt)
            late.append(pose)
            held = late.pop(0)
            posture, _, _ = person.move(
                posture,
                np.hstack([held @ grip for grip in start.grasp]),
                start.soles,
                follow,
                problem.dt,
            )
        return end_score(problem, person, start, posture, pose), broken / steps

    return loop


def measure(report: Report) -> None:
    """Run everything in two processes and print the figures of every problem."""
    people, starts = report.pick(quick=(1, 4), full=(10, 20))
    found = {name: BothLoops() for name in TASKS}

    def take(name: str, loops: BothLoops) -> int:
        found[name].add(loops)
        return len(loops.start)

    gather(
        report,
        loops_of_person,
        [(name, seed, starts) for seed in range(people) for name in TASKS],
        take,
    )
    for name, loops in found.items():
        for figure, value in (figures_of(loops) | _plain_figures(loops)).items():
            report.figure(f"{name}.{figure}", value)


def _plain_figures(loops: BothLoops) -> dict[str, float]:
    if not loops.plain_end:
        return {}
    start, best, plain = np.array(loops.start), np.array(loops.best), np.array(loops.plain_end)
    return {
        "plain_share_at_best": float(np.mean(plain <= best)),
        "plain_worse_than_start": float(np.mean(plain > start)),
        "plain_mean_end": float(plain.mean()),
        "plain_violation_share": float(np.mean(loops.plain_violations)),
    }


if __name__ == "__main__":
    run(measure, __doc__ or "")
