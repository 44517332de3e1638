"""Which gain the EPFL report's gradient does best with: the report leaves it open.

Run ``python -m benchmarks.gradient_gain [--quick | --full] [--json FILE]``. The starts are of the
kinds that loops may be built with, and of seeds for tuning, one kind and problem after another: 3
by default, 30 with ``--full``. Every gain leads every start, on the SVR and on the smooth score.

``COST.mean_end.GAIN``: mean exact score of the rests, no better than the start where there is none.
``COST.best_gain``: the lowest mean; the baseline has `GRADIENT_GAIN`, printed as ``gain``.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.people import KEPT, OTHERS, TUNING, prepared
from benchmarks.people_draw import draw_unit, svr
from benchmarks.people_figures import end_of
from benchmarks.people_unit import DURATION
from benchmarks.people_way import rested
from benchmarks.report import Report, run
from ergoqp.lab.yardstick import GRADIENT_GAIN, Gradient
from ergoqp.problem.load import TASKS
from ergoqp.simulation.loop import run_loop

GAINS = (0.01, 0.03, 0.1, 0.3, 1.0)
COSTS = ("svr", "smooth")
KINDS = tuple(kind for kind in OTHERS if kind not in KEPT)


def ends(kind: str, name: str, seed: int) -> dict[tuple[str, float], float]:
    """Return the score that each cost and gain ends with; nothing where there is no start."""
    unit = draw_unit(kind, name, seed).unit
    found: dict[tuple[str, float], float] = {}
    if unit is None:
        return found
    for cost in COSTS:
        for gain in GAINS:
            person = unit.start.copy()
            value = svr() if cost == "svr" else unit.problem.cost
            controller = Gradient(unit.problem, value, gain)
            run_loop(unit.problem, person, duration=DURATION, seed=unit.seed, controller=controller)
            end = rested(unit.problem, person)
            way: dict[str, Any] = {"end": end.score, "holds": end.holds}
            found[cost, gain] = end_of({"still": unit.still}, way)
    return found


def measure(report: Report) -> None:
    """Print the means."""
    seeds = range(TUNING, TUNING + (30 if report.full else 3))
    names = [TASKS[seed % len(TASKS)] for seed in seeds]
    kinds = [KINDS[seed // len(TASKS) % len(KINDS)] for seed in seeds]
    with prepared(dict.fromkeys(names)) as pool:
        starts = [found for found in pool.map(ends, kinds, names, seeds) if found]
    report.figure("starts", len(starts))
    report.figure("gain", GRADIENT_GAIN)
    for cost in COSTS:
        means = {gain: float(np.mean([found[cost, gain] for found in starts])) for gain in GAINS}
        for gain, mean in means.items():
            report.figure(f"{cost}.mean_end.{gain:g}", mean)
        report.figure(f"{cost}.best_gain", min(means, key=means.__getitem__))


if __name__ == "__main__":
    run(measure, __doc__ or "")
