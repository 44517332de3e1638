"""Times and answers of the exported step, built by its own CMake file, on a recorded loop's calls.

Times are taken in C around every call of `ergoqp_step`, by the exported `replay` program; nothing
of Python is in them.
"""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from ergoqp.export.folder import export_step
from ergoqp.problem.problem import Problem
from ergoqp.step.stepper import Stepper

Call = tuple[Any, Any, float]


@dataclass(frozen=True)
class CTimes:
    """What the exported step took, and how far its answers are from those in Python.

    Attributes:
        median_us: of all calls [us].
        p99_us: 99th percentile [us].
        p999_us: 99.9th percentile [us].
        max_us: the longest [us].
        least_us: median of every step's shortest time over the passes [us].
        own_p999_us: 99.9th percentile of every step's shortest time over the passes [us]: what the
            step itself needs, without the interruptions of a shared machine.
        difference: largest difference of any twist from Python's [m/s, rad/s].
        states: number of calls that were compared.
    """

    median_us: float
    p99_us: float
    p999_us: float
    max_us: float
    least_us: float
    own_p999_us: float
    difference: float
    states: int


def c_times(
    problem: Problem, calls: Sequence[Call], passes: int, flags: Sequence[str] = ()
) -> CTimes | None:
    """Export, build, answer and time; None without CMake or a compiler.

    Args:
        problem: the task.
        calls: (posture, pose, age) of every step.
        passes: how often to go through them; the first is not counted.
        flags: further flags of the compiler.
    """
    if shutil.which("cmake") is None or shutil.which("cc") is None:
        return None
    with tempfile.TemporaryDirectory() as scratch:
        folder, wrapper = built(problem, Path(scratch) / "step", flags)
        (folder / "inputs").write_bytes(b"".join(bytes(_input(wrapper, *call)) for call in calls))
        run = ["build/replay", "inputs", "outputs", str(passes)]
        shown = subprocess.run(run, cwd=folder, check=True, capture_output=True, text=True).stdout
        told = {name: float(value) for name, value in map(str.split, shown.splitlines())}
        answers = (folder / "outputs").read_bytes()
    size = len(answers) // len(calls)
    outputs = [wrapper.Output.from_buffer_copy(answers, i * size) for i in range(len(calls))]
    stepper, difference = Stepper(problem), 0.0
    for (posture, pose, age), output in zip(calls, outputs, strict=True):
        twist = stepper.step(posture, pose, age=age).twist
        difference = max(difference, float(np.abs(twist - output.twist[:]).max()))
    names = ("median", "p99", "p999", "max", "shortest_median", "shortest_p999")
    median, p99, p999, longest, least, own = (told[f"{name}_ns"] / 1e3 for name in names)
    return CTimes(median, p99, p999, longest, least, own, difference, len(calls))


def built(problem: Problem, folder: Path, flags: Sequence[str] = ()) -> tuple[Path, ModuleType]:
    """Export the step to a folder and build it there; return (folder, wrapper for Python)."""
    export_step(problem, folder)
    environment = os.environ | {"CFLAGS": " ".join(flags)}
    for command in (["cmake", "-S", ".", "-B", "build"], ["cmake", "--build", "build"]):
        subprocess.run(command, cwd=folder, check=True, capture_output=True, env=environment)
    return folder, _wrapper(folder)


def _wrapper(folder: Path) -> ModuleType:
    """The exported wrapper for Python, for the layout of its structs."""
    spec = importlib.util.spec_from_file_location(
        "exported_step", folder / "python" / "ergoqp_step.py"
    )
    if spec is None or spec.loader is None:
        raise RuntimeError("the export holds no Python wrapper")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _input(wrapper: ModuleType, posture: Any, pose: Any, age: float) -> Any:
    given = wrapper.Input(
        frame=int(posture is not None and np.ndim(posture) > 0), enable=1, age=age
    )
    given.observed[:] = [1.0] * len(given.observed)
    given.dt = wrapper.DT
    if given.frame:
        given.posture[:] = posture
    if np.ndim(pose) == 2:
        given.pose[:], given.has_pose = np.ravel(pose).tolist(), 1
    return given
