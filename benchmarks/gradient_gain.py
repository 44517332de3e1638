"""Which gain the EPFL report's gradient does best with: the report leaves it open.

Run ``python -m benchmarks.gradient_gain [--quick | --full] [--json FILE]``. The starts are of
followers with seeds for tuning, one problem after another: 3 by default, 30 with ``--full``. Every
gain leads every start, on the SVR and on the smooth score.

``mean_end.GAIN``: mean exact score of the rests after `GRADIENT` seconds, over both costs;
``lets_go.GAIN``: share of the loops that end out of reach. ``best_gain``: the lowest mean. The
baseline has `ergoqp.simulation.baselines.GRADIENT_GAIN`, printed as ``gain``.
"""

from __future__ import annotations

import numpy as np

from benchmarks.people import TUNING, prepared
from benchmarks.people_unit import GRADIENT, draw_unit, rest_score, svr
from benchmarks.report import Report, run
from ergoqp.problem_files.load import TASKS
from ergoqp.simulation.baselines import GRADIENT_GAIN, Gradient
from ergoqp.simulation.loop import run_loop

GAINS = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0)


def ends(name: str, seed: int) -> list[tuple[float, int, bool]] | None:
    """Return (gain, exact score of the rest, whether it is in reach) of every loop of a start."""
    unit = draw_unit("follower", name, seed)
    if unit is None:
        return None
    found = []
    for gain in GAINS:
        for cost in (svr(), unit.problem.cost):
            person = unit.start.copy()
            run_loop(
                unit.problem,
                person,
                duration=GRADIENT,
                seed=unit.seed,
                controller=Gradient(unit.problem, cost, gain),
            )
            found.append((gain, *rest_score(unit.problem, person)))
    return found


def measure(report: Report) -> None:
    """Print the means."""
    seeds = range(TUNING, TUNING + (30 if report.full else 3))
    names = [TASKS[seed % len(TASKS)] for seed in seeds]
    with prepared(dict.fromkeys(names)) as pool:
        starts = [found for found in pool.map(ends, names, seeds) if found is not None]
    report.figure("starts", len(starts))
    report.figure("gain", GRADIENT_GAIN)
    means = {}
    for gain in GAINS:
        of = [(end, holds) for found in starts for each, end, holds in found if each == gain]
        means[gain] = float(np.mean([end for end, _ in of]))
        report.figure(f"mean_end.{gain:g}", means[gain])
        report.figure(f"lets_go.{gain:g}", float(np.mean([not holds for _, holds in of])))
    report.figure("best_gain", min(means, key=means.__getitem__))


if __name__ == "__main__":
    run(measure, __doc__ or "")
