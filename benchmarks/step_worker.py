"""One version of the step, timed when it is told to.

`benchmarks.step_before` runs it for the code in a given folder.

``python step_worker.py FOLDER FORM DECLARED SECONDS`` with FORM ``interpreted``, ``compiled`` or
``c``; DECLARED 1 declares a robot. Every line that it reads makes one pass over a recorded closed
loop; it answers with the median of the whole calls [us].
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ALL = {
    "delay": 0.03,
    "lag": 0.05,
    "gain_error": 0.02,
    "pose_delay": 0.02,
    "pose_noise": 0.001,
    "pose_noise_deg": 0.2,
}
ALL |= {"longest_hold": 0.05}
"""Everything that can be declared of a robot, at once."""


def main(folder: str, form: str, declared: str, seconds: str) -> None:
    """Record a loop with this version's own step, then time passes over it."""
    sys.path[0] = folder
    import numpy as np

    import ergoqp
    from benchmarks import step as of_version

    # An import before the path is set would time the version of this very file twice.
    if not Path(ergoqp.__file__).is_relative_to(folder):
        raise RuntimeError(f"ergoqp is that of {ergoqp.__file__}, not of {folder}")

    problem: Any = ergoqp.load_problem("screwing")
    if declared == "1":
        from ergoqp.problem.settings import DeclaredRobot

        problem = problem.replace(robot=DeclaredRobot(**ALL))
    calls = of_version.trajectory(problem, ergoqp.Stepper(problem), float(seconds)).calls
    if form == "c":
        with tempfile.TemporaryDirectory() as scratch:
            ready = _exported(problem, calls, Path(scratch) / "step")
            answer(ready)
        return
    stepper = ergoqp.Stepper(problem, compiled=form == "compiled")
    answer(lambda: float(np.median(of_version.time_calls(stepper, calls)[0])))


def _exported(problem: Any, calls: Any, folder: Path) -> Any:
    from benchmarks import step_c as of_version
    from ergoqp.export.folder import export_step

    export_step(problem, folder)
    for command in (["cmake", "-S", ".", "-B", "build"], ["cmake", "--build", "build"]):
        subprocess.run(command, cwd=folder, check=True, capture_output=True)
    wrapper = of_version._wrapper(folder)
    (folder / "inputs").write_bytes(
        b"".join(bytes(of_version._input(wrapper, *call)) for call in calls)
    )

    def one_pass() -> float:
        shown = subprocess.run(
            ["build/replay", "inputs", "outputs", "2"],
            cwd=folder,
            check=True,
            capture_output=True,
            text=True,
        ).stdout
        return float(dict(map(str.split, shown.splitlines()))["median_ns"]) / 1e3

    return one_pass


def answer(one_pass: Any) -> None:
    """Warm up, say so, and make a pass for every line."""
    one_pass()
    print("ready", flush=True)
    for _ in sys.stdin:
        print(one_pass(), flush=True)


if __name__ == "__main__":
    if sys.argv[2] == "c" and shutil.which("cmake") is None:
        print("no CMake", flush=True)
    else:
        main(*sys.argv[1:5])
