"""Files of the package whose functions run in one call, counted in a process of their own.

Run ``python -m tools.house.runs PROBLEM | stepper | RECORDING``. What the call imports counts too,
as far as functions or classes run; the lines of a module alone do not.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any, Final

ROOT: Final = Path(__file__).resolve().parents[2]


def runs_of(what: str) -> int:
    """Return the number of files that a call of `call_of` runs through, in another process."""
    command = [sys.executable, "-m", "tools.house.runs", what]
    done = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
    return int(done.stdout)


def call_of(what: str) -> Callable[[], Any]:
    """Return the call: a problem that is loaded, its `Stepper`, or a recording that is read."""
    import ergoqp

    if what == "stepper":
        problem = ergoqp.load_problem("screwing")
        return lambda: ergoqp.Stepper(problem, compiled=False)
    if Path(what).suffix:
        return lambda: ergoqp.load_recording(what)
    return lambda: ergoqp.load_problem(what)


def files_run(call: Callable[[], Any]) -> set[str]:
    """Return the files of the package whose functions a call runs."""
    package, found = str(ROOT / "ergoqp"), set()

    def note(frame: FrameType, event: str, _: Any) -> None:
        code = frame.f_code
        if event == "call" and code.co_name != "<module>" and code.co_filename.startswith(package):
            found.add(code.co_filename)

    sys.setprofile(note)
    try:
        call()
    finally:
        sys.setprofile(None)
    return found


if __name__ == "__main__":
    ran = files_run(call_of(sys.argv[1]))
    print(len(ran))
    print(*sorted(str(Path(each).relative_to(ROOT)) for each in ran), sep="\n", file=sys.stderr)
