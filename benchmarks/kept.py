"""Long runs that go on where they were ended, as long as the commit is the same.

What is kept is unpickled, which can run code: the folder must be yours alone.
"""

from __future__ import annotations

import pickle
import subprocess
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from pathlib import Path
from typing import Any, Final

from benchmarks.report import Report

ROOT: Final = Path(__file__).resolve().parents[1]


def kept_folder(report: Report, name: str) -> Path | None:
    """Return where a run keeps what it found at this commit; None without ``--keep``."""
    if report.keep is None:
        return None
    if _git("status", "--porcelain", "--untracked-files=no"):
        raise SystemExit("--keep: files differ from the last commit, so commit them or go without")
    size = "full" if report.full else "quick"
    place = report.keep.resolve() / f"{name}-{size}-{_git('rev-parse', '--short=12', 'HEAD')}"
    place.mkdir(parents=True, exist_ok=True)
    return place


def _git(*arguments: str) -> str:
    command = ["git", *arguments]
    done = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
    return done.stdout.strip()


class KeptPool(ProcessPoolExecutor):
    """Two processes, whose results are kept by the order in which the tasks are given.

    Args:
        report: of the run, which says where they are kept.
        name: of the benchmark.
        more: arguments of `ProcessPoolExecutor`.
    """

    def __init__(self, report: Report, name: str, **more: Any) -> None:
        """Start them."""
        super().__init__(2, **more)
        self._place, self._tasks = kept_folder(report, name), 0

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Return what is kept of this task, or give it to a process."""
        if self._place is None:
            return super().submit(function, *args, **kwargs)
        path = self._place / f"{self._tasks}-{function.__name__}.pickle"
        self._tasks += 1
        if path.exists():
            kept: Future[Any] = Future()
            kept.set_result(pickle.loads(path.read_bytes()))
            return kept
        future = super().submit(function, *args, **kwargs)
        future.add_done_callback(lambda done: _keep(path, done))
        return future


def _keep(path: Path, done: Future[Any]) -> None:
    if done.cancelled() or done.exception() is not None:
        return
    half = path.with_suffix(".half")
    half.write_bytes(pickle.dumps(done.result()))
    half.replace(path)
