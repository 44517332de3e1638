"""What one fixed place for several people is worth.

It is set against a finer grid and against a place for the average person.

Run ``python -m benchmarks.group [--quick | --full] [--json FILE]``. ``--quick`` (the default) takes
``desk`` with five people and ``overhead`` with three on a grid of 30 cm; ``--full`` all five
problems, five people, 15 cm. People are given by stature, with the weights and the comfort of the
problem. Nothing comes from the cache. Per problem it prints

- ``minimax_highest``, ``minimax_mean``: highest and mean exact score of the group at the place for
  ``minimax``; ``mean_highest``, ``mean_mean``: at the place for ``mean``. A score is the worse of
  two ways of coming to rest there.
- ``half_grid_highest``, ``half_grid_mean``: the lowest highest and the lowest mean on a shared grid
  of half the spacing: eight times the places, by brute force. Its scores are of one way of coming
  to rest only, which flatters it.
- ``average_highest``, ``average_mean``, ``average_unreached``: the group at the best place of a
  person of the median stature alone, as if the workplace were designed for the average; how many do
  not reach it (left out of the two scores).
- ``own_mean``: mean score if everybody had their own best place. ``pays_mean``, ``pays_most``:
  points above that at the place for ``mean``, of everybody and of who pays most.
- ``own_above_optimise``, ``own_below_optimise``: people whose own best score is above, and below,
  the one that ``problem.optimise`` finds for them, by another method, from 16 starts (quick: 6).
- ``free_z_highest``, ``free_z_mean``: the scores, for ``minimax``, if everybody could set the
  height themselves.
- ``seconds``: whole search for ``minimax`` with two processes. ``half_grid_seconds``: the finer
  grid, likewise.
"""

from __future__ import annotations

import os
import time

import numpy as np

from benchmarks.report import Report, run
from ergoqp.lab.group import best_for_group
from ergoqp.lab.group_search import PlaceSearch, read_people, shared_grid
from ergoqp.placing.optimise import optimise
from ergoqp.problem.load import TASKS, load_problem

STATURES = (1.55, 1.65, 1.75, 1.85, 1.95)
"""Of the people [m]: about from the 5th percentile of women to the 95th of men."""

JOBS = min(2, os.cpu_count() or 1)


def group_of(report: Report, name: str, statures: tuple[float, ...], spacing: float) -> None:
    """Measure one problem and give its figures."""
    problem = load_problem(name)
    people = read_people(problem, statures)
    begin = time.perf_counter()
    minimax = best_for_group(problem, people, "minimax", spacing=spacing, jobs=JOBS, cache=False)
    seconds = time.perf_counter() - begin
    mean = best_for_group(problem, people, "mean", spacing=spacing, jobs=JOBS, cache=False)
    begin = time.perf_counter()
    fine = shared_grid(problem, people, spacing / 2, jobs=JOBS, cache=False)
    half_seconds = time.perf_counter() - begin
    reached = fine.scores[:, fine.reached_by_all]
    average = best_for_group(
        problem, (float(np.median(statures)),), "mean", spacing=spacing, cache=False
    )
    search = PlaceSearch(problem, people, mean.grid, "mean")
    there = search.resettled_from_comfort(search.at(search.placing.point(average.pose)))
    scores = there.scores[there.scores > 0]
    alone = [
        optimise(problem, starts=report.pick(6, 16), person=person.follower).reba_after
        for person in people
    ]
    own = np.array([member.own_reba for member in mean.members])
    pays = [member.pays for member in mean.members]
    figures = {
        "minimax_highest": minimax.maximum,
        "minimax_mean": minimax.mean,
        "mean_highest": mean.maximum,
        "mean_mean": mean.mean,
        "half_grid_highest": reached.max(axis=0).min(),
        "half_grid_mean": reached.mean(axis=0).min(),
        "average_highest": scores.max(),
        "average_mean": scores.mean(),
        "average_unreached": np.sum(there.scores == 0),
        "own_mean": mean.own_mean,
        "own_above_optimise": np.sum(own > alone),
        "own_below_optimise": np.sum(own < alone),
        "pays_mean": np.mean(pays),
        "pays_most": max(pays),
        "seconds": seconds,
        "half_grid_seconds": half_seconds,
    }
    if "z" in minimax.free:
        figures["free_z_highest"], figures["free_z_mean"] = minimax.free["z"]
    for figure, value in figures.items():
        report.figure(f"{name}.{figure}", float(value))


def measure(report: Report) -> None:
    """Measure every problem."""
    if report.full:
        for name in TASKS:
            group_of(report, name, STATURES, 0.15)
    else:
        group_of(report, "desk", STATURES, 0.15)
        group_of(report, "overhead", STATURES[::2], 0.30)


if __name__ == "__main__":
    run(measure, __doc__ or "")
