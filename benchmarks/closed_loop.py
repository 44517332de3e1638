"""Whole closed loops: problems x people x starts, each with a person who is not the controller's model.

Run ``python -m benchmarks.closed_loop [--quick | --full] [--json FILE]``. ``--quick`` (the default) takes one person with four
starts per problem; ``--full`` ten people with twenty starts each. Per problem it prints

- ``runs``: loops that were run. A start is a random reachable place at rest, at least 2 points above the person's best.
- ``share_at_best``: share whose noise-free rest posture, where the object came to rest, has the lowest exact score that
  brute force finds for that person anywhere in the workspace (or lower).
- ``worse_than_start``: share that ends above its start. ``mean_start``, ``mean_best``, ``mean_end``: exact scores.
- ``idle_share_at_best``: the same share for a robot that stands still.
- ``violations``: steps that broke a limit, by the independent checker. ``exceptions``: loops that raised.
- ``braking_share``: share of steps with status braking or invalid.
- ``settle_s``: 95th percentile of the time after which the object did not move any more (never: inf).
- ``power_above_3hz``: mean share of the twist's power above 3 Hz.
- ``plain_...``: the plain way on the same starts: the same cost, the same S, twist = -eps S' dV/dq and nothing else
  (equation 3.3 of the EPFL report), stopped at the end of the same time.
"""

from __future__ import annotations

import os
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from benchmarks.report import Report, run
from ergoqp.problem import Problem
from ergoqp.problem_file import TASKS, load_problem
from ergoqp.simulation.best import draw_starts, workspace_map
from ergoqp.simulation.check import Checker
from ergoqp.simulation.loop import Start, moved, power_above, run_loop, settle_time
from ergoqp.simulation.people import Senses, frames, sample_person
from ergoqp.simulation.person import Follower

DURATION = 30.0
"""Longest time of a loop [s]; it ends earlier after `STILL` seconds at rest."""
STILL = 3.0
ABOVE = 2
"""Starts count from this many points above the best."""
EPS = 0.02
"""Gain of the plain way: a slope of 10 points per metre gives 0.2 m/s."""


@dataclass
class Loops:
    """Numbers of the loops of one problem, one entry per loop."""

    start: list[int] = field(default_factory=list)
    best: list[int] = field(default_factory=list)
    end: list[int] = field(default_factory=list)
    settle: list[float] = field(default_factory=list)
    violations: list[int] = field(default_factory=list)
    braking: list[float] = field(default_factory=list)
    power: list[float] = field(default_factory=list)
    plain_end: list[int] = field(default_factory=list)
    plain_violations: list[float] = field(default_factory=list)
    exceptions: int = 0

    def add(self, other: Loops) -> None:
        """Append another's entries."""
        for name, value in vars(other).items():
            setattr(self, name, getattr(self, name) + value)


def loops_of_person(name: str, person_seed: int, count: int) -> tuple[str, Loops]:
    """Run all loops of one person in one problem."""
    problem = load_problem(name)
    person = sample_person(problem, person_seed)
    best = workspace_map(problem, person).best
    stepper, plain = problem.stepper(), _plain_way(problem)
    loops = Loops()
    for number, start in enumerate(draw_starts(problem, person, count, person_seed, best + ABOVE)):
        seed = 1000 * person_seed + number
        checker = Checker(problem)
        try:
            trace = run_loop(
                problem, person, start, duration=DURATION, seed=seed, stepper=stepper, checker=checker, stop_when_still=STILL
            )
        except Exception as error:
            print(f"{name} person {person_seed} start {number}: {type(error).__name__}: {error}", flush=True)
            loops.exceptions += 1
            continue
        loops.start.append(int(problem.assess(start.posture).final[0]))
        loops.best.append(best)
        loops.end.append(end_score(problem, person, start, trace.postures[-1], trace.poses[-1]))
        loops.settle.append(settle_time(trace))
        loops.violations.append(sum(checker.violations.values()))
        loops.braking.append(float(np.mean([step.status in ("braking", "invalid") for step in trace.steps])))
        loops.power.append(power_above(np.array(trace.twists), problem.dt, problem.twist_limit.speed))
        end, broken = plain(person, start, len(trace.steps), seed)
        loops.plain_end.append(end)
        loops.plain_violations.append(broken)
    return name, loops


def end_score(problem: Problem, person: Follower, start: Start, posture: np.ndarray, pose: np.ndarray) -> int:
    """Exact score of the rest posture where the object is now; of the posture itself where it is out of reach."""
    rest, reached = person.settle(posture, pose, start.grasp, start.soles)
    return int(problem.assess(rest if reached else posture).final[0])


def _plain_way(problem: Problem):
    """Return the plain controller's loop: (person, start, steps, seed) -> (end score, share of steps that broke a limit)."""
    q = ca.MX.sym("q", 32)
    slope = problem.response.expression(q).T @ ca.gradient(problem.cost.expression(q), q)
    descend = ca.Function("plain", [q], [-EPS * slope])
    senses = Senses()
    follow = 1.0 - float(np.exp(-problem.dt / senses.hand_time))

    def loop(person: Follower, start: Start, steps: int, seed: int) -> tuple[int, float]:
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
                posture, np.hstack([held @ grip for grip in start.grasp]), start.soles, follow, problem.dt
            )
        return end_score(problem, person, start, posture, pose), broken / steps

    return loop


def measure(report: Report) -> None:
    """Run everything in two processes and print the figures of every problem."""
    people, starts = report.pick(quick=(1, 4), full=(10, 20))
    names = TASKS
    jobs = [(name, seed, starts) for seed in range(people) for name in names]
    found = {name: Loops() for name in names}
    with ProcessPoolExecutor(min(2, os.cpu_count() or 1)) as pool:
        futures = [pool.submit(loops_of_person, *job) for job in jobs]
        for done, future in enumerate(as_completed(futures), start=1):
            name, loops = future.result()
            found[name].add(loops)
            report.say(f"{done}/{len(jobs)} {name}: {len(loops.start)} loops")
    for name in names:
        _figures(report, name, found[name])


def _figures(report: Report, name: str, loops: Loops) -> None:
    start, best, end = np.array(loops.start), np.array(loops.best), np.array(loops.end)
    plain = np.array(loops.plain_end)
    figures = {"runs": len(start), "exceptions": loops.exceptions, "violations": sum(loops.violations)}
    if len(start):
        figures |= {
            "share_at_best": np.mean(end <= best),
            "worse_than_start": np.mean(end > start),
            "mean_start": start.mean(),
            "mean_best": best.mean(),
            "mean_end": end.mean(),
            "idle_share_at_best": np.mean(start <= best),
            "braking_share": np.mean(loops.braking),
            "settle_s": np.percentile(loops.settle, 95, method="higher"),
            "power_above_3hz": np.mean(loops.power),
            "plain_share_at_best": np.mean(plain <= best),
            "plain_worse_than_start": np.mean(plain > start),
            "plain_mean_end": plain.mean(),
            "plain_violation_share": np.mean(loops.plain_violations),
        }
    for figure, value in figures.items():
        report.figure(f"{name}.{figure}", float(value))


if __name__ == "__main__":
    run(measure, __doc__ or "")
