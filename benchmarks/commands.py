"""What the commands take, from the start of the program to its end.

Run ``python -m benchmarks.commands [--quick | --full] [--json FILE]``; ``--quick`` leaves out
``score_30000_per_s`` and ``jobs_2``. Every command runs as a process of its own. The machine code
that a wheel holds is in the cache, and so is what an earlier run has kept. Times are the shortest
CPU time of several runs, of the process and its children, except where the name says wall.

- ``python_s``: an interpreter that does nothing; ``import_s``: ``import ergoqp`` too. Both are
  controls, and part of all other figures.
- ``run_s``: ``ergoqp run screwing --duration 5`` with page; ``run_s.without_page``.
- ``score_3000_s``: ``ergoqp score`` of 3000 frames at 30 Hz with page, and
  ``score_3000_s.without_page``; ``score_30000_per_s``: frames per second of 30 000 frames.
- ``optimise_s``: ``ergoqp optimise screwing``; ``group_4_s``: ``ergoqp group desk`` for four
  people.
- ``jobs_2``: elapsed time of ``ergoqp optimise screwing --starts 96`` with one process over that
  with two; ``jobs_2.wall_s`` and ``jobs_1.wall_s``: both.
"""

from __future__ import annotations

import math
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.long_recording import write_recording
from benchmarks.report import Report, run
from ergoqp.problem.load import load_problem
from ergoqp.rest.batch import BatchedRests
from ergoqp.rest.model_person import ModelPerson, person_of
from ergoqp.step.stepper import Stepper

_NO_BYTE_CODE = "PYTHONDONTWRITEBYTECODE"

_PAGELESS = """
import sys
sys.modules["viser"] = None
from ergoqp.cli.main import main
main()
"""
"""A command of an environment without the extra for pages, which then writes none."""


def measure(report: Report) -> None:
    """Print all figures."""
    rounds = report.pick(1, 7)
    Stepper(load_problem("screwing"), compiled=True)
    for name in ("screwing", "desk"):
        BatchedRests(ModelPerson(person_of(load_problem(name))))
    ergoqp = ["-m", "ergoqp"]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shorter, longer = folder / "shorter.bvh", folder / "longer.bvh"
        write_recording(shorter, 100.0, 30.0)
        out = ["--out", str(folder / "out")]
        walk = ["run", "screwing", "--duration", "5", *out]
        score = ["score", str(shorter), *out]
        report.figure("python_s", shortest(["-c", "pass"], rounds))
        report.figure("import_s", shortest(["-c", "import ergoqp"], rounds))
        report.figure("run_s", shortest([*ergoqp, *walk], rounds))
        report.figure("run_s.without_page", shortest(["-c", _PAGELESS, *walk], rounds))
        report.figure("score_3000_s", shortest([*ergoqp, *score], rounds))
        report.figure("score_3000_s.without_page", shortest(["-c", _PAGELESS, *score], rounds))
        report.figure("optimise_s", shortest([*ergoqp, "optimise", "screwing", *out], rounds))
        people = ["group", "desk", "--people", "1.55,1.65,1.75,1.85", *out]
        report.figure("group_4_s", shortest([*ergoqp, *people], rounds))
        if not report.full:
            return
        write_recording(longer, 1000.0, 30.0)
        took = shortest([*ergoqp, "score", str(longer), *out], rounds // 2)
        report.figure("score_30000_per_s", 30_000 / took)
        walls = {
            jobs: elapsed(
                [*ergoqp, "optimise", "screwing", "--starts", "96", "--jobs", jobs, *out], rounds
            )
            for jobs in ("1", "2")
        }
        report.figure("jobs_2", walls["1"] / walls["2"])
        for jobs, wall in walls.items():
            report.figure(f"jobs_{jobs}.wall_s", wall)


def shortest(arguments: list[str], rounds: int) -> float:
    """Return the shortest CPU time of a Python process and its children [s]."""
    least = math.inf
    for number in range(rounds + 1):
        before = _children()
        _call(arguments)
        # The first run fills caches.
        least = min(least, _children() - before) if number else least
    return least


def elapsed(arguments: list[str], rounds: int) -> float:
    """Return the shortest elapsed time of a Python process [s]."""
    least = math.inf
    for _ in range(rounds):
        begin = time.perf_counter()
        _call(arguments)
        least = min(least, time.perf_counter() - begin)
    return least


def _children() -> float:
    times = os.times()
    return times.children_user + times.children_system


def _call(arguments: list[str]) -> None:
    # As after an installation, modules are byte code, whatever the environment says.
    environment = {key: value for key, value in os.environ.items() if key != _NO_BYTE_CODE}
    subprocess.run([sys.executable, *arguments], check=True, capture_output=True, env=environment)


if __name__ == "__main__":
    run(measure, __doc__ or "")
