"""Whatever comes in, a safe twist comes out, with a reason that names the cause. ``python -m benchmarks.fuzz``.

Random sequences alternate between sane trajectories (the model person follows, with noise) and attacks (`fuzz_inputs`): on the
five problems, and on random ones with other people, boxes without an inside, cones that exclude the start, narrow ranges.
20 000 steps, 1 000 000 with ``--full``; two processes. Figures:

``exceptions``
    calls that raised anything.
``unsafe``
    steps whose twist broke a limit by `ergoqp.simulation.check.Checker`, which shares no code with the step. Acceleration is
    judged against the twist of the last period (the executed one if it was given and usable), always. A speed above its limit
    is tolerated only where braking from an executed twist beyond it gives no less. Workspace and tool axis may be left by
    nothing but what braking itself forces after the measured pose or the executed twist jumped: from the jump on, the object
    must stay within the worst point of the straight stop from there. On top of the Checker the whole stop from every
    twist sent must stay inside as well, and the pose that the step reckoned with must be the one that was given or sent. The
    model's joints: none is predicted further outside its range, and none moves faster than its limit unless the step says that
    this row gave way.
``certified_share``
    of the steps whose inputs were all usable (nothing wrong, a fresh frame, enabled) and from which some twist other than
    braking is certifiable, the share that was not answered by braking. Wherever the step brakes, without exception, that is
    decided by 60 random reachable twists, each also shortened toward braking, with exact margins in numpy: none of them keeps
    what held through its own stop means that nothing was to be had.
``reasons_wrong``
    steps whose status or sentence does not fit: a wrong input that is not ``invalid`` or not named, a usable one called
    invalid, a joint or limit outside its range that is not named, or one named that is inside.
"""

from __future__ import annotations

import multiprocessing
from collections import Counter
from typing import Any

import numpy as np

from benchmarks.fuzz_inputs import attack
from benchmarks.fuzz_judge import Tally
from benchmarks.fuzz_loop import Loop
from benchmarks.fuzz_problems import problem_of
from benchmarks.report import Report, run

CHUNK = 2000
SEQUENCE = 250


def run_chunk(task: tuple[int, int]) -> Tally:
    """Run one chunk ``(number, steps)``; the same number gives the same inputs: ``run_chunk((7, 2000))`` reproduces it."""
    number, steps = task
    rng, judge = (np.random.default_rng([20_26, number, part]) for part in (0, 1))
    problem, tally = problem_of(number, rng), Tally()
    loop = Loop(problem, rng, judge, tally)
    attacks_left, sane_left = 0, int(rng.integers(5, 40))
    for i in range(steps):
        if i and i % SEQUENCE == 0:
            loop.restart()
            # Some loops begin under attack.
            attacks_left, sane_left = (3, 0) if rng.random() < 0.3 else (0, int(rng.integers(5, 40)))
        call = loop.sane()
        if sane_left > 0:
            sane_left -= 1
        else:
            attack(rng, problem, call, loop.lying)
            attacks_left -= 1
            if attacks_left <= 0:
                attacks_left, sane_left = int(rng.integers(1, 10)), int(rng.integers(0, 40))
        loop.take(call, f"chunk {number} step {i}")
    return tally


def _silent_chunk(task: tuple[int, int]) -> Tally:
    import warnings

    # A warning is noise in a loop that runs a thousand times a second; here it counts as an exception.
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("error")
        return run_chunk(task)


def fuzz(steps: int, processes: int = 2) -> Tally:
    """Run that many steps over all problems and return what was found."""
    size = min(CHUNK, max(SEQUENCE, steps // 20))
    tasks = [(number, size) for number in range(round(steps / size))]
    total = Tally()
    if processes == 1:
        found = map(_silent_chunk, tasks)
        for tally in found:
            total.add(tally)
        return total
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        for tally in pool.imap_unordered(_silent_chunk, tasks):
            total.add(tally)
    return total


def measure(report: Report) -> None:
    """Attack."""
    found = fuzz(report.pick(20_000, 1_000_000))
    for status, count in found.statuses.most_common():
        report.say(f"  {status:<12} {count:>9}")
    kinds: dict[str, Any] = {name: count for name, count in found.counts.items() if ": " in name}
    for name, count in sorted(kinds.items(), key=lambda item: -item[1]):
        report.say(f"  {count:>7}  {name}")
    shown: Counter = Counter()
    for example in found.examples:
        kind = example.split(" at chunk")[0]
        shown[kind] += 1
        if shown[kind] == 1:
            report.say(f"  {example[:600]}")
    report.figure("steps", found.steps)
    report.figure("exceptions", found.counts["exceptions"], "calls that raised")
    report.figure("unsafe", found.counts["unsafe"], "twists that broke a limit, by the independent checker")
    report.figure("certified_share", found.answered / max(found.judged, 1), "of usable, feasible inputs")
    report.figure("reasons_wrong", found.counts["reasons_wrong"], "reasons that do not name their cause")


if __name__ == "__main__":
    run(measure, "Hostile inputs, up to a million: no exception, no unsafe twist, and a reason for each.")
