"""The offline optimum against brute force and the closed loop, for people not the problem's own.

Run ``python -m benchmarks.optimise [--quick | --full] [--json FILE]``. A case is a person (seeds
from 100 on: none was looked at while the method was made) and a place at rest at least 2 points
above that person's best; `problem.optimise` gets the person and the posture. ``--quick`` (the
default) takes one case per problem, ``--full`` ten people with ten cases each. Per problem it
prints

- ``cases``; ``share_at_best``: share whose true score, where the person comes to rest, equals the
  lowest that brute force finds for that person anywhere in the workspace (or lower).
  ``lower_than_best``: share below it, between brute force's places.
- ``worse_than_loop``: cases in which a closed loop from the same place (30 s, noise and delay) ends
  at a lower score.
- ``max_kkt``: largest violation of the optimality conditions of a chosen optimum;
  ``starts_optimal``: share of all starts that end below 1e-6; ``starts_at_best``: share of all
  starts that end at brute force's best.
- ``max_apart_deg``: largest difference between the program's posture and the settled one, of a
  joint, of chosen optima.
- ``mean_start``, ``mean_best``, ``mean_loop``, ``mean_equilibrium``: exact scores before, of brute
  force, of the closed loop and of the optimum. ``mean_cooperative``: of the bound in which the
  posture is chosen too, for one case of every person, and ``mean_equilibrium_beside``: of the
  optimum in the same cases.
- ``ms_per_start``: of a whole call in one process, program and verdict included, and
  ``cpu_ms_per_start``, which other work on the machine does not lengthen; ``speedup_2``: how much
  sooner two processes that have done work for the same task before are done with the same starts
  (``speedup_starts``).
- ``worse_optima``: of ``optima`` cases (people from seed 400 on at an awkward place, both modes),
  those in which 32 starts of the former kind end at a lower score, or at the same score with a
  smooth cost that is lower by more than 0.01 points; ``worse_scores``: those of them with a lower
  score; ``better_optima``: the other way round. Of the former kind are starts at random places of
  which none is screened, half of them narrow and half from a scale of 12 over one of 1.5 deg.
  ``cpu_share``: CPU time of the search over theirs. Control: ``worse_optima.control``, the same
  number of the former starts as the search takes.
"""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from multiprocessing import get_context
from typing import ClassVar, TypeAlias

import numpy as np

from benchmarks.loops import ABOVE, DURATION, STILL, draw_starts, end_score
from benchmarks.report import Report, run
from ergoqp.placing.optimise import (
    FINAL_TAU_DEG,
    NARROW,
    RESIDUAL,
    STARTS,
    StartSolver,
    begin_from,
    best_of,
    optimise,
)
from ergoqp.placing.optimum import StartResult
from ergoqp.placing.program import MODES
from ergoqp.problem.load import TASKS, load_problem
from ergoqp.problem.problem import Problem
from ergoqp.rest.best_place import awkward_start, workspace_map
from ergoqp.rest.model_person import sample_person
from ergoqp.simulation.loop import run_loop
from ergoqp.step.stepper import Stepper

FIRST_PERSON = 100
FIRST_OPTIMUM = 400
FORMER_STARTS = 32
CLOSE = 0.01
"""Smooth costs that differ by less are equal [points]."""


class FormerSolver(StartSolver):
    """Solves starts of the former kind."""

    stages: ClassVar = (((12.0, 1e-2), (1.5, 1e-3)), NARROW)
    screened: ClassVar = 1


Ends: TypeAlias = tuple[tuple[int, float], tuple[int, float], tuple[int, float]]
"""Score and smooth cost of the search, of the former starts, and of as few as the search takes."""


@dataclass
class Cases:
    """Numbers of the cases of one problem, one entry per case."""

    start: list[int] = field(default_factory=list)
    best: list[int] = field(default_factory=list)
    loop: list[int] = field(default_factory=list)
    found: list[int] = field(default_factory=list)
    cooperative: list[int] = field(default_factory=list)
    beside: list[int] = field(default_factory=list)
    kkt: list[float] = field(default_factory=list)
    apart: list[float] = field(default_factory=list)
    starts_optimal: list[float] = field(default_factory=list)
    starts_at_best: list[float] = field(default_factory=list)

    def add(self, other: Cases) -> None:
        """Append another's entries."""
        for name, value in vars(other).items():
            setattr(self, name, getattr(self, name) + value)


def cases_of_person(name: str, person_seed: int, count: int) -> tuple[str, Cases]:
    """Solve all cases of one person in one problem."""
    problem = load_problem(name)
    person = sample_person(problem, person_seed)
    best = workspace_map(problem, person).best
    stepper = Stepper(problem)
    cases = Cases()
    for number, start in enumerate(draw_starts(problem, person, count, person_seed, best + ABOVE)):
        seed = 1000 * person_seed + number
        options = {"seed": seed, "pose": start.pose, "person": person}
        optimum = optimise(problem, start.posture, **options)
        trace = run_loop(
            problem,
            person.holding(start),
            duration=DURATION,
            seed=seed,
            controller=stepper,
            stop_when_still=STILL,
        )
        chosen = next(trial for trial in optimum.trials if trial.pose is optimum.pose)
        cases.start.append(optimum.reba_before)
        cases.best.append(best)
        cases.loop.append(end_score(problem, person, start, trace.postures[-1], trace.poses[-1]))
        cases.found.append(optimum.reba_after)
        if number == 0:
            bound = optimise(problem, start.posture, mode="cooperative", **options)
            cases.cooperative.append(bound.reba_after)
            cases.beside.append(optimum.reba_after)
        cases.kkt.append(optimum.kkt_residual)
        cases.apart.append(chosen.apart)
        cases.starts_optimal.append(
            float(np.mean([trial.kkt_residual <= RESIDUAL for trial in optimum.trials]))
        )
        cases.starts_at_best.append(
            float(np.mean([0 < trial.reba <= best for trial in optimum.trials]))
        )
    return name, cases


def measure(report: Report) -> None:
    """Solve the cases in two processes, then time starts with nothing else running."""
    people, count = report.pick(quick=(1, 1), full=(10, 10))
    jobs = [(name, FIRST_PERSON + person, count) for person in range(people) for name in TASKS]
    found = {name: Cases() for name in TASKS}
    with ProcessPoolExecutor(min(2, os.cpu_count() or 1), mp_context=get_context("spawn")) as pool:
        futures = [pool.submit(cases_of_person, *job) for job in jobs]
        for done, future in enumerate(as_completed(futures), start=1):
            name, cases = future.result()
            found[name].add(cases)
            report.say(f"{done}/{len(jobs)} {name}: {len(cases.found)} cases")
        compared(report, pool)
    for name in TASKS:
        figures(report, name, found[name])
        timing(report, name)


def figures(report: Report, name: str, cases: Cases) -> None:
    """Print what the cases of a problem come down to."""
    best, end = np.array(cases.best), np.array(cases.found)
    values = {"cases": len(end)}
    if len(end):
        values |= {
            "share_at_best": np.mean(end <= best),
            "lower_than_best": np.mean(end < best),
            "worse_than_loop": np.sum(end > np.array(cases.loop)),
            "max_kkt": np.max(cases.kkt),
            "max_apart_deg": np.degrees(np.max(cases.apart)),
            "starts_optimal": np.mean(cases.starts_optimal),
            "starts_at_best": np.mean(cases.starts_at_best),
            "mean_start": np.mean(cases.start),
            "mean_best": best.mean(),
            "mean_loop": np.mean(cases.loop),
            "mean_equilibrium": end.mean(),
            "mean_cooperative": np.mean(cases.cooperative),
            "mean_equilibrium_beside": np.mean(cases.beside),
        }
    for figure, value in values.items():
        report.figure(f"{name}.{figure}", float(value))


def timing(report: Report, name: str) -> None:
    """Time the same starts in one process and in two that are warm."""
    problem = load_problem(name)
    person = sample_person(problem, FIRST_PERSON)
    starts = report.pick(quick=16, full=192)
    posture = awkward_start(problem, person, FIRST_PERSON)
    optimise(problem, posture, starts=4, jobs=2, person=person)
    seconds, cpu = {}, 0.0
    for jobs in (2, 1):
        begin, cpu = time.perf_counter(), time.process_time()
        optimise(problem, posture, starts=starts, jobs=jobs, person=person)
        seconds[jobs], cpu = time.perf_counter() - begin, time.process_time() - cpu
    report.figure(f"{name}.cpu_ms_per_start", 1e3 * cpu / starts)
    report.figure(f"{name}.ms_per_start", 1e3 * seconds[1] / starts, f"ms, of {starts} starts")
    report.figure(f"{name}.speedup_2", seconds[1] / seconds[2])
    report.figure(f"{name}.speedup_starts", starts)


def optima(name: str, person_seed: int) -> list[tuple[Ends, float]]:
    """Return what the search and the former starts end at, and the search's share of CPU time."""
    problem = load_problem(name)
    person = sample_person(problem, person_seed)
    posture = awkward_start(problem, person, person_seed)
    begin = begin_from(person, posture, None)
    found = []
    for mode in MODES:
        times, ends = [time.process_time()], []
        for kind, starts in ((StartSolver, STARTS), (FormerSolver, FORMER_STARTS)):
            solver = kind(problem, person, begin, mode, "ipopt", person_seed, FINAL_TAU_DEG)
            trials = [solver.start(number) for number in range(starts)]
            times.append(time.process_time())
            ends += [best_end(problem, trials), best_end(problem, trials[:STARTS])]
        new, _, former, few = ends
        found.append(((new, former, few), (times[1] - times[0]) / (times[2] - times[1])))
    return found


def best_end(problem: Problem, trials: Sequence[StartResult]) -> tuple[int, float]:
    """Return exact score and smooth cost of the best of trials."""
    best = best_of(problem, trials)
    return best.reba, best.cost


def is_worse(one: tuple[int, float], other: tuple[int, float]) -> bool:
    """Return whether an end is worse than another."""
    return one[0] > other[0] or (one[0] == other[0] and one[1] > other[1] + CLOSE)


def compared(report: Report, pool: ProcessPoolExecutor) -> None:
    """Print how the search compares with starts of the former kind."""
    people = range(FIRST_OPTIMUM, FIRST_OPTIMUM + report.pick(quick=1, full=50))
    jobs = [pool.submit(optima, name, person) for person in people for name in TASKS]
    found = []
    for done, job in enumerate(as_completed(jobs), start=1):
        found += job.result()
        report.say(f"{done}/{len(jobs)} people and problems")
    ends = [each for each, _ in found]
    report.figure("optima", len(found))
    report.figure("worse_optima", sum(is_worse(new, former) for new, former, _ in ends))
    report.figure("worse_scores", sum(new[0] > former[0] for new, former, _ in ends))
    report.figure("better_optima", sum(is_worse(former, new) for new, former, _ in ends))
    report.figure("worse_optima.control", sum(is_worse(few, former) for _, former, few in ends))
    report.figure("cpu_share", float(np.median([share for _, share in found])))


if __name__ == "__main__":
    run(measure, __doc__ or "")
