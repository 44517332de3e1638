"""How soon a loop is fast: a fresh process, without a compiler, of a person never seen before.

`ready` is called by `benchmarks.step`. The process imports ergoqp, loads a problem with a stature
that is drawn anew, makes a `ergoqp.Stepper` and steps; all is CPU time of that process. The machine
code is that of the structure: of the installed wheel if ``ERGOQP_WHEEL_PYTHON`` names an
interpreter that has it installed, else of the cache, where another person has put it.
"""

from __future__ import annotations

import json
import os
import random
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from ergoqp.problem.load import load_problem
from ergoqp.registry import data_folder
from ergoqp.step.stepper import Stepper

PYTHON: Final = "ERGOQP_WHEEL_PYTHON"
"""Environment variable with the interpreter of an environment that has the wheel installed."""

STEP: Final = 100
"""The step that is timed, with as many around it as `_AROUND`."""

_AROUND: Final = 10

_TABLE: Final = "[response.ik]"

_CHILD: Final = """
import json, sys, time
began = time.process_time()
import ergoqp
problem = ergoqp.load_problem(sys.argv[2])
before = time.process_time()
stepper = ergoqp.Stepper(problem)
made = time.process_time()
stepper.step(problem.response.comfort)
first = time.process_time()
import numpy as np
rng, times = np.random.default_rng(0), []
for posture in problem.response.comfort + np.radians(5) * rng.normal(size=(int(sys.argv[1]), 32)):
    start = time.thread_time_ns()
    stepper.step(posture)
    times.append(time.thread_time_ns() - start)
empty = []
for _ in range(100):
    start = time.thread_time_ns()
    empty.append(time.thread_time_ns() - start)
print(json.dumps({
    "engine": stepper.engine, "first": first - began, "stepper": made - before,
    "times": [each - min(empty) for each in times],
}))
"""


@dataclass(frozen=True)
class Ready:
    """What a fresh process took.

    Attributes:
        engine: how its steps were computed.
        first_step_s: CPU time from the import to the first twist [s].
        stepper_s: CPU time of ``Stepper(problem)`` [s].
        step_us: CPU time of a step about the hundredth: the median of each one's shortest [us].
    """

    engine: str
    first_step_s: float
    stepper_s: float
    step_us: float


def ready(repetitions: int) -> Ready:
    """Return the shortest of several fresh processes."""
    python, environment = os.environ.get(PYTHON), dict(os.environ)
    if python is None:
        Stepper(load_problem("screwing"), compiled=True)
    found = []
    with tempfile.TemporaryDirectory() as empty:
        environment |= {"PATH": empty, "ERGOQP_COMPILE": "never"}
        file = Path(empty) / "person.toml"
        text = (data_folder("problems") / "screwing.toml").read_text(encoding="utf-8")
        if python is not None:
            # Nothing but what the wheel has installed.
            environment = {"HOME": empty, "PATH": empty, "ERGOQP_COMPILE": "never"}
        for _ in range(repetitions + 1):
            person = f"stature = {random.uniform(1.6, 1.9):.6f}"
            file.write_text(text.replace(_TABLE, f"{_TABLE}\n{person}"), encoding="utf-8")
            command = [python or sys.executable, "-c", _CHILD, str(STEP + _AROUND), str(file)]
            folder = empty if python is not None else None
            shown = subprocess.run(
                command, env=environment, cwd=folder, check=True, capture_output=True, text=True
            )
            found.append(json.loads(shown.stdout))
    # The first process may have written byte code.
    found = found[1:]
    times = np.array([each["times"][STEP - _AROUND :] for each in found])
    return Ready(
        found[0]["engine"],
        min(each["first"] for each in found),
        min(each["stepper"] for each in found),
        1e-3 * float(np.median(times.min(axis=0))),
    )
