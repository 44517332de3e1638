"""Whatever comes in, a safe twist comes out, with a reason that names the cause.

Run ``python -m tools.fuzz``. Parts in other files of this folder are named like `inputs`.

Random sequences alternate between sane trajectories (the model person follows, with noise) and
attacks (`inputs`): on the five problems, and on random ones with other people, boxes without
an inside, cones that exclude the start, narrow ranges, other periods and averages
(`problems`); every other problem declares a robot. 20 000 steps, 1 000 000 with ``--full``;
two processes. In seven of ten sequences the robot keeps its declaration and nothing that is said of
it is a lie. Before 15 % of the calls the same call or another one is interrupted at a random point
(`interruptions`). In a quarter of the chunks the cost, the response or a limit gives NaN or
infinity in a part of its domain (`terms`). Figures:

``exceptions``
    calls that raised anything but what is documented, also in and after an interrupted call.
``unsafe`` times that a limit was broken, by a judge in numpy that shares no code with the step.
    Speed, axes, acceleration and jerk (2 a / W, from the middle of one period to that of the next)
    are judged against what was sent before, always and to 1e-9, whatever the robot is said to have
    done: in every step, every call of `Stepper.brake` and every stop (`judge.Sent`). The
    object itself, moved by a robot within its declaration, is followed on its whole way
    (`world`): what is inside its workspace and its tool cone stays inside, what is outside
    comes no further out, and what is outside of a region to keep out of never gets into it
    (`regions`). From a tenth of the steps it is really braked down by a clone of the loop,
    at regular and uneven periods, with and without the one hold that is declared (`object`).
    Only where nobody sent it (another pose is given, the loop takes over a moving object, a robot
    disobeys, a period was longer than may be) may it be as far outside as braking forces from
    there. A step that has to brake sends what `Stepper.brake` does; after a fault, and after it was
    disabled, nothing moves before it has come to rest; a pose that is not given is the declared
    motion, or what a faulty robot reports; ``brake(elapsed=)`` leads to where calls one by one
    lead. The model's joints: none is predicted further outside its range, and none moves faster
    than its limit unless the step says that this row gave way. Where a term gives no number, the
    step brakes; twist, pose and state are always finite. An interrupted call of `step`, `brake`,
    `stop`, `reset` or `try_again` counts as not made: state and frame are those before it, to the
    last bit, and `Stepper.brake` gives the same answer and reason as before it. Only before its
    last line, where a tracer may raise and a signal handler never does, it may count as made.
``lost_jerk`` those of ``unsafe`` that are jerks beyond their bound which no reason names.
``named_short`` jerks beyond their bound where periods much shorter than the loop's had used up the
    history, and the step said so.
``certified_share`` of the steps whose inputs were all usable (nothing wrong, a fresh frame,
    enabled, no robot at fault, periods as declared) and from which some twist other than braking
    was possible, the share that was not answered by braking. Wherever the step brakes, without
    exception, that is decided by 60 random twists within reach of the planned one, each also
    shortened toward braking to 0.3 and 0.1 of the way (`judge.Law`). What is under way counts
    first: what the mean has still to send, rising on the way for periods up to h = 3 dt, and what a
    declared robot owes, done already or not, with its gain error, its noise and one hold at their
    ends. Then comes the way of the new twist u by the law of the problem's stop: half its period
    (all of it without a mean), half its stop, u max |u_i| / a_i / 2, and what a mean that rises
    with it can add, at most 1.5 h u and a (h dt + h^2 / 8). A twist is possible if on the way
    through both, and on the circle that the tool's axis turns on, every row of workspace and cone,
    and every joint by the model, stays inside, or at least no further outside than it is, or than
    braking leads by the same law. Problems with regions to keep out of do not count here.
``reasons_wrong`` steps whose status or sentence does not fit: a wrong input that is not ``invalid``
    or not named, a usable one refused, a joint or limit outside that is not named, or one named
    that is inside, ``recovering`` for what does not come back; a robot that is blamed and does what
    is declared, or is not blamed and does not, reckoned from the calls alone (`robot`); a term
    that is not named where it gives no number and nothing else makes the step brake, or is named
    where it gives one.

The kinds of what is wrong are counted beside them, and how many calls were interrupted and met a
term without a number. ``run_chunk((number, steps))`` makes the same
calls again; only when a signal handler interrupts is up to the clock.
"""

from __future__ import annotations

import multiprocessing
import warnings
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Executor
from typing import Any, Final

import numpy as np

from benchmarks.kept import KeptPool
from benchmarks.report import Report, run
from ergoqp.problem.problem import Problem
from tools.fuzz.inputs import attack
from tools.fuzz.judge import Tally
from tools.fuzz.loop import Loop
from tools.fuzz.problems import problem_of
from tools.fuzz.terms import Spoiled, spoiled

CHUNK = 2000
SEQUENCE = 250

_SPOILED: Final = 0.25
"""Share of the chunks in which a term of the problem gives no number somewhere."""


def run_chunk(task: tuple[int, int], of: Problem | None = None) -> Tally:
    """Run one chunk ``(number, steps)``; the same number gives the same calls.

    A call such as ``run_chunk((7, 2000))`` reproduces a chunk.

    Args:
        task: the number and the steps.
        of: the problem; None: that of the number.
    """
    number, steps = task
    rng, judge, interrupts, terms = (
        np.random.default_rng([20_26, number, part]) for part in range(4)
    )
    problem, without, tally = of or problem_of(number, rng), Spoiled(), Tally()
    if terms.random() < _SPOILED:
        problem, without = spoiled(problem, terms)
    loop = Loop(problem, without, (rng, judge, interrupts), tally)
    attacks_left, sane_left = 0, int(rng.integers(5, 40))
    for i in range(steps):
        if i and i % SEQUENCE == 0:
            loop.restart()
            # Some loops begin under attack.
            attacks_left, sane_left = (
                (3, 0) if rng.random() < 0.3 else (0, int(rng.integers(5, 40)))
            )
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
    # A warning is noise in a loop that runs a thousand times a second; here it counts as an
    # exception.
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("error")
        return run_chunk(task)


def fuzz(steps: int, pool: Executor, say: Callable[[str], object]) -> Tally:
    """Run that many steps over all problems and return the findings; `say` hears of progress."""
    size = min(CHUNK, max(SEQUENCE, steps // 20))
    tasks = [(number, size) for number in range(round(steps / size))]
    total = Tally()
    futures = [pool.submit(_silent_chunk, task) for task in tasks]
    for done, future in enumerate(futures, start=1):
        total.add(future.result())
        if done % 20 == 0:
            say(f"  {done}/{len(tasks)} chunks")
    return total


def measure(report: Report) -> None:
    """Attack."""
    context = multiprocessing.get_context("spawn")
    with KeptPool(report, "fuzz", mp_context=context) as pool:
        found = fuzz(report.pick(20_000, 1_000_000), pool, report.say)
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
    report.say(
        f"  {found.stops} stops braked down to rest, {found.judged} steps judged for"
        " certified_share"
    )
    report.say(
        f"  {found.interrupted} calls interrupted, {found.spoiled} steps at which a term gave no"
        " number"
    )
    report.figure("steps", found.steps)
    report.figure("exceptions", found.counts["exceptions"], "calls that raised")
    report.figure("unsafe", found.counts["unsafe"], "limits broken, by the independent judge")
    report.figure(
        "lost_jerk",
        found.counts["unsafe: jerk"] + found.counts["unsafe: stop: jerk"],
        "jerks beyond the limit that no reason names, in unsafe too",
    )
    report.figure(
        "named_short",
        found.counts["named short"],
        "jerks after much shorter periods, which were named",
    )
    report.figure(
        "certified_share", found.answered / max(found.judged, 1), "of usable, feasible inputs"
    )
    report.figure(
        "reasons_wrong", found.counts["reasons_wrong"], "reasons that do not name their cause"
    )


def main() -> None:
    """Run the command line."""
    run(
        measure,
        "Hostile inputs, up to a million: no exception, no unsafe twist, and a reason for each.",
    )


if __name__ == "__main__":
    main()
