"""The step against that of an earlier commit, in the same run.

Run ``python -m benchmarks.step_before [--quick | --full] [--before COMMIT] [--json FILE]``.

The earlier one is the last in which the person had no eyes (`BEFORE`), or COMMIT. It is taken out
of the repository's own history, so this needs a clone with that history. Both versions record their
own closed loop of ``screwing``, with the same people and starts, and take turns in timing passes
over it; a figure is the ratio of the medians over the passes.

- ``interpreted``, ``compiled``, ``c``: with no robot declared, the whole call, now over before.
- ``FORM.declared``: with everything of a robot declared that can be, over the earlier step without.
- ``FORM.now_us``, ``FORM.before_us``, ``FORM.declared_us``: the medians themselves.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tarfile
import tempfile
from io import BytesIO
from pathlib import Path

import numpy as np

from benchmarks.report import Report, run

BEFORE = "c2e04a1"
ROOT = Path(__file__).resolve().parent.parent


class Version:
    """One version in a process of its own."""

    def __init__(self, folder: Path, form: str, declared: bool, seconds: float) -> None:
        """Start it; it is ready when `ready` says so."""
        worker = str(ROOT / "benchmarks" / "step_worker.py")
        command = [sys.executable, worker, str(folder), form, str(int(declared)), str(seconds)]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=folder
        )
        self.times: list[float] = []

    def ready(self) -> bool:
        """Wait until it has recorded and warmed up."""
        assert self._process.stdout is not None
        return self._process.stdout.readline().strip() == "ready"

    def one_pass(self) -> None:
        """Time one pass."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(file=self._process.stdin, flush=True)
        self.times.append(float(self._process.stdout.readline()))

    def end(self) -> None:
        """Close it."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()


def measure(report: Report, before: str = BEFORE) -> None:
    """Time all three versions of each form in turns."""
    archive = subprocess.run(["git", "archive", before], cwd=ROOT, capture_output=True, check=False)
    if archive.returncode:
        report.say(f"the commit {before} is not in this clone: nothing to compare with")
        return
    with tempfile.TemporaryDirectory() as scratch:
        with tarfile.open(fileobj=BytesIO(archive.stdout)) as packed:
            packed.extractall(scratch, filter="data")
        for form in ("interpreted", "compiled", "c"):
            _compare(report, form, Path(scratch))


def _compare(report: Report, form: str, before: Path) -> None:
    seconds, passes = report.pick(1.0, 20.0), report.pick(3, 31)
    versions = {
        "before": Version(before, form, False, seconds),
        "now": Version(ROOT, form, False, seconds),
    }
    versions["declared"] = Version(ROOT, form, True, seconds)
    if not all([version.ready() for version in versions.values()]):
        report.say(f"{form}: a compiler or CMake is missing")
        return
    for _ in range(passes):
        for version in versions.values():
            version.one_pass()
    for version in versions.values():
        version.end()
    medians = {name: float(np.median(version.times)) for name, version in versions.items()}
    report.figure(
        form, medians["now"] / medians["before"], "no robot declared, over the commit before"
    )
    report.figure(
        f"{form}.declared", medians["declared"] / medians["before"], "everything declared"
    )
    for name, value in medians.items():
        report.figure(f"{form}.{name}_us", value)


if __name__ == "__main__":
    own = argparse.ArgumentParser(add_help=False)
    own.add_argument("--before", default=BEFORE, metavar="COMMIT")
    options, others = own.parse_known_args()
    run(lambda report: measure(report, options.before), __doc__ or "", others)
