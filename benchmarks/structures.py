"""Whether problems of one structure share one step, and whether all its forms are one.

Run ``python -m benchmarks.structures [--quick | --full]``.

Problems are drawn over every number of a problem file, of the kinds of `benchmarks.drawn`.

- ``drawn``: how many; ``recompiled``: those whose function is not that of the others of their kind,
  so that it would be compiled again; ``difference``: the largest difference of any output of the
  machine code of the first one of a kind, with the numbers of another, from that one's own
  interpreted step, over ``states`` states. Not a number counts as one only on both sides.
- ``threads_wrong``: answers of four people in four threads on one library that are not those of
  each alone; ``threads_steps``: of how many.
- ``compile_s``, ``compile_mb``: CPU time of a process that makes a compiled stepper with an empty
  cache, its compiler included, and the largest memory of the compiler.
- ``forms_differ``: inputs after which any bit of the compiled or the exported step is another than
  that of the interpreted one, of ``forms_inputs``, over all problems of ``problems/``, as
  `tools.same` makes them.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.drawn import KINDS, drawn, postures
from benchmarks.report import Report, run
from ergoqp.problem.problem import Problem
from ergoqp.solvers import solver_named
from ergoqp.step.function import build_shared_step, shared_step
from ergoqp.step.stepper import Stepper
from tools import same

_COMPILE: Final = """
import resource
import ergoqp
ergoqp.Stepper(ergoqp.load_problem("screwing"), compiled=True)
own, other = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
seconds = sum(each.ru_utime + each.ru_stime for each in (own, other))
print(seconds, other.ru_maxrss / 1024)
"""


def compile_cost() -> tuple[float, float]:
    """Return what a first compilation takes: CPU time [s] and memory of the compiler [MB]."""
    with tempfile.TemporaryDirectory() as cache:
        environment = os.environ | {"XDG_CACHE_HOME": cache}
        command = [sys.executable, "-c", _COMPILE]
        shown = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    seconds, megabytes = map(float, shown.stdout.split())
    return seconds, megabytes


def with_library(problem: Problem, library: object) -> Stepper:
    """Return a stepper of a problem that is computed by a shared step of its structure."""
    stepper = Stepper(problem, compiled=False)
    stepper._bind(library)  # type: ignore[arg-type]
    return stepper


def apart(one: np.ndarray, other: np.ndarray) -> float:
    """Return the largest difference of two answers; inf if only one of two entries is a number."""
    different = one[~((one == other) | (np.isnan(one) & np.isnan(other)))]
    if not different.size:
        return 0.0
    found = np.abs(one - other)
    return float(np.nanmax(np.where(np.isnan(one) != np.isnan(other), np.inf, found)))


def shares(report: Report, count: int, states: int) -> None:
    """Report whether drawn problems share the function and the library of the first one."""
    recompiled, worst, solver = 0, 0.0, solver_named("daqp")
    for kind in KINDS:
        first = drawn(kind, 0)
        text, library = (
            build_shared_step(first, solver).serialize(),
            shared_step(first, "daqp", True),
        )
        for seed in range(1, count // len(KINDS) + 1):
            problem = drawn(kind, seed)
            recompiled += build_shared_step(problem, solver).serialize() != text
            own, lent = Stepper(problem, compiled=False), with_library(problem, library)
            for posture in postures(problem, seed, states):
                worst = max(worst, apart(own.step(posture).values, lent.step(posture).values))
    report.figure("drawn", count // len(KINDS) * len(KINDS))
    report.figure("recompiled", recompiled)
    report.figure("difference", worst, f"over {states} states each")


def threads_wrong(steps: int) -> tuple[int, int]:
    """Return how many answers of four threads are wrong, and of how many."""
    problems = [drawn("plain", seed) for seed in range(4)]
    library = shared_step(problems[0], "daqp", True)

    def answers(seed: int) -> np.ndarray:
        problem = problems[seed]
        stepper = with_library(problem, library)
        return np.array([stepper.step(q).values for q in postures(problem, seed, steps)])

    alone = [answers(seed) for seed in range(4)]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(answers, range(4)))
    pairs = zip(alone, together, strict=True)
    wrong = sum(
        a.tobytes() != b.tobytes() for one, other in pairs for a, b in zip(one, other, strict=True)
    )
    return wrong, 4 * steps


def forms_differ(report: Report) -> None:
    """Report whether interpreted, compiled and exported step answer alike to the bit."""
    names = sorted(path.stem for path in (same.ROOT / "problems").glob("*.toml"))
    number = -(-report.pick(700, 10_000) // len(names))
    different = 0
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        for name in names:
            same.child(same.ROOT, folder, "record", name, "plain", str(number))
            for form in ("plain", "compiled", "exported"):
                same.child(same.ROOT, folder, "answer", name, form, "now")
            forms = (f"now_{form}" for form in ("compiled", "exported"))
            different += sum(same.differing(folder, name, "now_plain", form) for form in forms)
    report.figure("forms_differ", different, "compiled and exported to interpreted")
    report.figure("forms_inputs", number * len(names))


def measure(report: Report) -> None:
    """Measure all figures of this file."""
    seconds, megabytes = compile_cost()
    report.figure("compile_s", seconds, "CPU, building and compiling")
    report.figure("compile_mb", megabytes)
    shares(report, report.pick(25, 200), 50)
    wrong, steps = threads_wrong(report.pick(500, 4500))
    report.figure("threads_wrong", wrong)
    report.figure("threads_steps", steps)
    forms_differ(report)


if __name__ == "__main__":
    run(measure, "Problems of one structure share one step, and all its forms are one.")
