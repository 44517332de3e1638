"""Closed loops with people who are not the controller's model.

The module runs them, says what is kept of each, and gives the figures of many.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field, replace

import numpy as np

from benchmarks.report import Report
from ergoqp.limits import WorkspaceBox
from ergoqp.placing.optimise import optimise
from ergoqp.placing.optimum import Optimum
from ergoqp.problem.problem import Problem
from ergoqp.rest.best_place import SPACING, workspace_map
from ergoqp.rest.model_person import ModelPerson, Start, person_of
from ergoqp.seeking import Seeker
from ergoqp.simulation.check import Checker
from ergoqp.simulation.loop import Trace, run_loop, settle_time
from ergoqp.step.stepper import Stepper

DURATION = 30.0
"""Longest time of a loop [s]; it ends earlier after `STILL` seconds at rest."""
STILL = 3.0
ABOVE = 2
"""Starts count from this many points above the best."""


@dataclass
class Loops:
    """Numbers of loops, one entry per loop."""

    start: list[int] = field(default_factory=list)
    grid: list[int] = field(default_factory=list)
    best: list[int] = field(default_factory=list)
    end: list[int] = field(default_factory=list)
    settle: list[float] = field(default_factory=list)
    violations: list[int] = field(default_factory=list)
    braking: list[float] = field(default_factory=list)
    power: list[float] = field(default_factory=list)
    exceptions: int = 0

    def add(self, other: Loops) -> None:
        """Append another's entries."""
        for name, value in vars(other).items():
            setattr(self, name, getattr(self, name) + value)


Beside = Callable[[Start, int, Trace], None]
"""Told of every loop: its start, its seed and its trace."""


def optimum_of(problem: Problem, person: ModelPerson | None) -> Optimum:
    """Return the best place for a person at ease (None: the model), as by ``ergoqp optimise``."""
    response = person_of(problem) if person is None else person.response
    return optimise(problem, response.comfort, person=person)


def draw_starts(
    problem: Problem, person: ModelPerson, count: int, seed: int, at_least: int, tries: int = 2000
) -> list[Start]:
    """Return starts at rest in random reachable workspace places that score at least `at_least`.

    Places are drawn from the map of the person and shifted by up to half its spacing. There
    are fewer than `count` starts if `tries` places do not give that many.
    """
    found = workspace_map(problem, person)
    candidates = np.flatnonzero(found.scores >= at_least)
    rng = np.random.default_rng([seed, 3])
    box = problem.limit_of(WorkspaceBox)
    comfort = person.response.comfort
    soles, grasp = person.stand(comfort), person.grasp(comfort)
    starts: list[Start] = []
    for _ in range(tries if candidates.size else 0):
        chosen = rng.choice(candidates)
        pose = found.poses[chosen].copy()
        beside = pose[:3, 3] + rng.uniform(-0.5, 0.5, 3) * SPACING
        pose[:3, 3] = np.clip(beside, box.lower, box.upper)
        posture, reached = person.settle(found.postures[chosen], pose, grasp, soles)
        if (
            reached
            and not problem.own_limits.broken(pose, posture)
            and problem.assess(posture).final[0] >= at_least
        ):
            # The hand may have turned about a free tool, so the grasp is that of the new
            # posture.
            starts.append(replace(person.start_at(posture, pose), soles=soles))
            if len(starts) == count:
                break
    return starts


def run_loops(
    loops: Loops,
    problem: Problem,
    person: ModelPerson,
    person_seed: int,
    count: int,
    controller: Stepper | Seeker,
    beside: Beside,
    optimum: Optimum,
    duration: float = DURATION,
    still: float = STILL,
) -> None:
    """Run the loops of one person in one problem and append what became of them.

    The best that there is for this person is the better one of what brute force finds on a grid of
    places and what the optimiser finds: each is beaten by the other somewhere. Starts are chosen by
    the grid alone.

    Args:
        loops: what is appended to.
        problem: the task.
        person: who follows.
        person_seed: of the starts, the noise and the lost frames.
        count: of starts.
        controller: of the problem.
        beside: called after every loop.
        optimum: of this person.
        duration: longest time of a loop [s].
        still: a loop ends after so long at rest [s].
    """
    grid = workspace_map(problem, person).best
    for number, start in enumerate(draw_starts(problem, person, count, person_seed, grid + ABOVE)):
        seed, checker = 1000 * person_seed + number, Checker(problem)
        try:
            trace = run_loop(
                problem,
                person.holding(start),
                duration=duration,
                seed=seed,
                controller=controller,
                checker=checker,
                stop_when_still=still,
            )
        except Exception as error:
            print(
                f"{problem.name} person {person_seed} start {number}: {type(error).__name__}:"
                f" {error}",
                flush=True,
            )
            loops.exceptions += 1
            continue
        loops.start.append(int(problem.assess(start.posture).final[0]))
        loops.grid.append(grid)
        loops.best.append(min(grid, optimum.reba_after))
        loops.end.append(end_score(problem, person, start, trace.postures[-1], trace.poses[-1]))
        loops.settle.append(settle_time(trace))
        loops.violations.append(sum(checker.violations.values()))
        loops.braking.append(
            float(np.mean([step.status in ("braking", "invalid") for step in trace.steps]))
        )
        loops.power.append(
            power_above(np.array(trace.twists), problem.dt, problem.twist_limit.speed)
        )
        beside(start, seed, trace)


def power_above(twists: np.ndarray, dt: float, speed: np.ndarray, frequency: float = 3.0) -> float:
    """Return the share of the power of the twist above a frequency [Hz].

    Each axis is relative to its speed limit. At standstill the share is 0.
    """
    moving = speed > 0
    spectrum = np.abs(np.fft.rfft(twists[:, moving] / speed[moving], axis=0)) ** 2
    total = spectrum.sum()
    high = np.fft.rfftfreq(len(twists), dt) > frequency
    return float(spectrum[high].sum() / total) if total > 0 else 0.0


def end_score(
    problem: Problem, person: ModelPerson, start: Start, posture: np.ndarray, pose: np.ndarray
) -> int:
    """Return the exact score of the rest posture where the object is now.

    Where the object is out of reach, it is the score of the posture itself.
    """
    rest, reached = person.settle(posture, pose, start.grasp, start.soles)
    return int(problem.assess(rest if reached else posture).final[0])


def placed_score(problem: Problem, person: ModelPerson, start: Start, pose: np.ndarray) -> int:
    """Exact score of the rest posture where the object is carried straight to a pose.

    Nothing but the person's reach limits the carrying.

    Where it is out of reach the object stays at the last place on the way that was not.
    """
    held = person.holding(start)
    held.carry(pose)
    return int(problem.assess(held.posture).final[0])


def gather(
    report: Report, worker: Callable, jobs: Sequence[tuple], take: Callable[..., int]
) -> None:
    """Run `worker` on every job, two at a time.

    Args:
        report: is told how far it is.
        worker: called with the parts of a job; its result is a tuple that begins with the name of
            the problem.
        jobs: arguments of the worker.
        take: called with the parts of each result; returns how many loops it holds.
    """
    with ProcessPoolExecutor(min(2, os.cpu_count() or 1)) as pool:
        futures = [pool.submit(worker, *job) for job in jobs]
        for done, future in enumerate(as_completed(futures), start=1):
            result = future.result()
            report.say(f"{done}/{len(jobs)} {result[0]}: {take(*result)} loops")


def figures_of(loops: Loops) -> dict[str, float]:
    """Return the figures of loops by name; only the counts if there were none."""
    start, grid, best, end = (
        np.array(scores) for scores in (loops.start, loops.grid, loops.best, loops.end)
    )
    figures: dict[str, float] = {
        "runs": len(start),
        "exceptions": loops.exceptions,
        "violations": sum(loops.violations),
    }
    if not len(start):
        return figures
    return figures | {
        "share_at_best": float(np.mean(end <= best)),
        "share_at_grid_best": float(np.mean(end <= grid)),
        "worse_than_start": float(np.mean(end > start)),
        "mean_start": float(start.mean()),
        "mean_best": float(best.mean()),
        "mean_end": float(end.mean()),
        "braking_share": float(np.mean(loops.braking)),
        "settle_s": float(np.percentile(loops.settle, 95, method="higher")),
        "power_above_3hz": float(np.mean(loops.power)),
    }
