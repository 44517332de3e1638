"""The offline optimum against brute force and the closed loop, for people not the problem's own.

Run ``python -m benchmarks.optimise [--quick | --full] [--json FILE]``. A case is a person (seeds
from 100 on: none was looked at while the method was made) and a place at rest at least 2 points
above that person's best; `problem.optimise` gets the person, the posture and 32 starts. ``--quick``
(the default) takes one case per problem, ``--full`` ten people with ten cases each. Per problem it
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
- In ``--full`` the same of whole commands, ``ergoqp optimise screwing``, from the start of the
  program to its end: ``command.seconds_32`` and ``command.speedup_32`` (two processes against one)
  with the 32 starts that the command takes by default, ``..._96`` with 96, and
  ``command.cpu_ms_per_start_...`` of one process.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from multiprocessing import get_context

import numpy as np

from benchmarks.loops import ABOVE, DURATION, STILL, draw_starts, end_score
from benchmarks.report import Report, run
from ergoqp.placing.optimise import RESIDUAL, optimise
from ergoqp.problem.load import TASKS, load_problem
from ergoqp.rest.best_place import awkward_start, workspace_map
from ergoqp.rest.model_person import sample_person
from ergoqp.simulation.loop import run_loop
from ergoqp.step.stepper import Stepper

FIRST_PERSON = 100
STARTS = 32


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
        options = {"starts": STARTS, "seed": seed, "pose": start.pose, "person": person}
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
    for name in TASKS:
        figures(report, name, found[name])
        timing(report, name)
    for starts in report.pick(quick=(), full=(STARTS, 3 * STARTS)):
        commands(report, starts)


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


def commands(report: Report, starts: int) -> None:
    """Time whole commands with one process and with two.

    The time includes starting them and what they load and build.
    """
    seconds, cpu = {}, {}
    for jobs in (1, 2):
        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, "-m", "ergoqp", "optimise", "screwing", "--out", folder]
            before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
            options = ["--starts", str(starts), "--jobs", str(jobs)]
            subprocess.run(
                [*command, *options],
                check=True,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            after, seconds[jobs] = (
                resource.getrusage(resource.RUSAGE_CHILDREN),
                time.perf_counter() - begin,
            )
            cpu[jobs] = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    report.figure(f"command.seconds_{starts}", seconds[1], "s, one process")
    report.figure(f"command.speedup_{starts}", seconds[1] / seconds[2])
    report.figure(f"command.cpu_ms_per_start_{starts}", 1e3 * cpu[1] / starts)


if __name__ == "__main__":
    run(measure, __doc__ or "")
