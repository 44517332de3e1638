"""Whether the tests notice mistakes in what the safety rests on, put in and tested one at a time.

Run ``python -m tools.mutants [--quick | --full] [--since COMMIT] [--keep FOLDER] [--json
FILE]``, or ``make mutants``. A sample of the mistakes of `tools.mutants.kinds`, the same from
run to run, is put into copies of the project: the control step, the limits, the rest, the frames,
the layout of the exported step, the sheet with its data, and the checker. With ``--since`` they are
put only into lines that came after COMMIT. Each is judged by the tests that run its line (coverage,
measured first), the quickest first, until one fails. With ``--keep`` what was found is kept in
FOLDER, and a run that was ended goes on where it was, as long as the commit is the same.

- ``mutants``: mistakes tried.
- ``killed_share``: share of them that a test noticed, or that never ended. A mistake on a line that
  no test runs is alive.
- ``killed_share.changing``: the same without those that change nothing (``explained``).
- ``killed_share.unpinned``: the same of the first mutants, without the tests that only compare with
  answers of before (``tests/step/test_pinned.py``).
- ``not_covered``: of those alive, how many stand on such a line.
- ``explained``: of those alive, how many change nothing, each with its reason in
  ``tools/mutants/alive.toml``.
- ``unexplained``: the rest: a test is missing.

Every one that is alive is printed.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import tomllib
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from typing import Any, Final

from coverage import CoverageData

from benchmarks.kept import kept_folder
from benchmarks.report import Report, run
from tools.mutants.kinds import Mutant, mutants_of

ROOT: Final = Path(__file__).resolve().parents[2]

MUTATED: Final = (
    "ergoqp/step/**/*.py",
    "ergoqp/limits/*.py",
    "ergoqp/export/layout.py",
    "ergoqp/simulation/check.py",
    "ergoqp/problem/settings.py",
    "ergoqp/problem/problem.py",
    "ergoqp/problem/validate.py",
    "ergoqp/identification/calibrate.py",
    "ergoqp/sheets/*.py",
    "ergoqp/sheets/*.toml",
)

TESTS: Final = (
    "tests/test_wrong_arguments.py",
    "tests/step",
    "tests/problem",
    "tests/test_evaluator.py",
    "tests/test_rigid.py",
    "tests/learning",
    "tests/limits",
    "tests/native",
    "tests/export",
    "tests/identification/test_calibrate.py",
    "tests/sheets",
    "tests/simulation",
    "tests/rest",
    "tests/lab",
    "tests/solvers",
    "tests/datasets/test_posture_data.py",
    "tests/docs/test_problem_page.py",
)
"""The tests that may notice; those of other pages, recordings and commands would only add time."""

PINNED: Final = "tests/step/test_pinned.py"

READS: Final = {
    "ergoqp/sheets/reba.toml": "ergoqp/sheets/assessment.py",
    "ergoqp/sheets/interval.toml": "ergoqp/sheets/interval.py",
}
"""Code that uses a file of data: the tests that run it judge the file."""

BUDGET: Final = 240.0
"""How long the tests of one mutant may take, by what they take without [s]."""

WORKERS: Final = 2


@dataclass(frozen=True)
class Verdict:
    """What became of a mutant.

    Attributes:
        mutant: the mistake.
        now: the line with it.
        killed: whether a test noticed.
        covered: whether a test runs the line.
    """

    mutant: Mutant
    now: str
    killed: bool
    covered: bool


class Tests:
    """Which tests run which line, and how long they take.

    Args:
        folder: a copy of the project, in which the tests are run once with coverage.
        paths: of the tests.
    """

    def __init__(self, folder: Path, paths: Sequence[str]) -> None:
        """Run them once."""
        printed = folder.parent / "tests.txt"
        if not printed.exists():
            printed.write_text(self._run(folder, paths), encoding="utf-8")
        self._seconds: dict[str, float] = {}
        for seconds, test in re.findall(
            r"^\s*([\d.]+)s (?:setup|call|teardown)\s+(\S.*)$",
            printed.read_text(encoding="utf-8"),
            re.MULTILINE,
        ):
            self._seconds[test.strip()] = self._seconds.get(test.strip(), 0.0) + float(seconds)
        data = CoverageData(str(folder / ".coverage"))
        data.read()
        self._lines = {
            str(Path(file).relative_to(folder)): {
                line: {context.partition("|")[0] for context in contexts if context}
                for line, contexts in data.contexts_by_lineno(file).items()
            }
            for file in data.measured_files()
        }

    @staticmethod
    def _run(folder: Path, paths: Sequence[str]) -> str:
        options = [
            "--cov=ergoqp",
            "--cov-context=test",
            "--cov-report=",
            "--durations=0",
            "--durations-min=0",
        ]
        found = [str(path) for pattern in paths for path in sorted(folder.glob(pattern))]
        done = _pytest(folder, [*found, *options, "-n", str(WORKERS)], timeout=3600)
        if done.returncode:
            raise RuntimeError(f"the tests fail without a mistake:\n{done.stdout[-3000:]}")
        return done.stdout

    def of(self, mutant: Mutant, pinned: bool = True) -> tuple[list[str], bool]:
        """Return a mutant's tests, what may notice soonest first, and whether any runs its line.

        Args:
            mutant: the mistake.
            pinned: whether those that compare with answers of before may judge.
        """
        lines = self._lines.get(READS.get(mutant.path, mutant.path), {})
        of_file: set[str] = set().union(*lines.values())
        # What runs at import, such as a constant, is run by no test: those of the whole file are
        # asked.
        running = set() if mutant.path in READS else self._on(lines, mutant)
        nearest = sorted(running, key=self._time)
        # What a cache or an import keeps is run by the first test alone; others of the same files
        # depend on it all the same.
        files = {test.partition("::")[0] for test in running or of_file}
        others = sorted(
            (
                test
                for test in self._seconds
                if test.partition("::")[0] in files and test not in running
            ),
            key=self._time,
        )
        chosen, spent = [], 0.0
        kept = [test for test in of_file if test.startswith(PINNED)] if pinned else []
        ordinary = [test for test in (*nearest, *others) if not test.startswith(PINNED)]
        for test in (*sorted(kept, key=self._time), *ordinary):
            if spent + self._time(test) <= BUDGET:
                chosen.append(test)
                spent += self._time(test)
        return chosen, bool(of_file)

    def _on(self, lines: dict[int, set[str]], mutant: Mutant) -> set[str]:
        """Return the tests that run the statement: its first line counts, which may stand above."""
        for line in range(mutant.line, max(mutant.line - 12, 0), -1):
            if line in lines:
                return lines[line]
        return set()

    def _time(self, test: str) -> float:
        return self._seconds.get(test, 0.1)


def judged(folder: Path, mutant: Mutant, tests: Tests, pinned: bool = True) -> Verdict | None:
    """Return what the tests say of a mutant; None if it is no mistake.

    They run in a copy of the project, which is left as it was.
    """
    source = mutant.source()
    if source is None:
        return None
    lines = zip(mutant.code.splitlines(), source.splitlines(), strict=False)
    now = next((after.strip() for before, after in lines if before != after), "")
    chosen, covered = tests.of(mutant, pinned)
    if not chosen:
        return Verdict(mutant, now, False, covered)
    path = folder / mutant.path
    try:
        path.write_text(source, encoding="utf-8")
        (folder / "chosen.txt").write_text("\n".join(chosen), encoding="utf-8")
        try:
            done = _pytest(folder, ["@chosen.txt", "-x", "-n", "0"], timeout=60 + 3 * BUDGET)
        except subprocess.TimeoutExpired:
            return Verdict(mutant, now, True, covered)
    finally:
        path.write_text(mutant.code, encoding="utf-8")
    return Verdict(mutant, now, done.returncode != 0, covered)


def _pytest(
    folder: Path, options: Sequence[str], timeout: float
) -> subprocess.CompletedProcess[str]:
    """Run tests in a copy of the project, with all that they start, for so long at most."""
    # A cache of compiled code of its own, filled by the first run: that of the user is left alone.
    environment = {
        **os.environ,
        "XDG_CACHE_HOME": str(folder.parent / "cache"),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        "--no-header",
        *options,
    ]
    with subprocess.Popen(
        command,
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    ) as process:
        try:
            output, _ = process.communicate(timeout=timeout)
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
    return subprocess.CompletedProcess(command, process.returncode, output, "")


def _copy(folder: Path) -> Path:
    listed = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout.split("\n")
    for name in filter(None, listed):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, folder / name)
    return folder


class _Kept:
    """What was found of mutants so far, in a file.

    Args:
        path: of the file, made at the first verdict.
    """

    def __init__(self, path: Path) -> None:
        """Read what is there."""
        self._path, self._lock = path, threading.Lock()
        lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
        self._found: dict[str, list[Any] | None] = dict(map(json.loads, lines))

    def of(
        self, mutant: Mutant, pinned: bool, judge: Callable[[], Verdict | None]
    ) -> Verdict | None:
        """Return the verdict on a mutant that is kept, or else what `judge` gives."""
        key = f"{mutant.line}: {mutant.name}, {pinned}"
        if key in self._found:
            kept = self._found[key]
            return None if kept is None else Verdict(mutant, *kept)
        verdict = judge()
        kept = None if verdict is None else [verdict.now, verdict.killed, verdict.covered]
        with self._lock, self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps([key, kept]) + "\n")
        return verdict


def _place(report: Report, since: str | None) -> AbstractContextManager[str]:
    """Return the folder of the copies, which is kept or goes."""
    place = kept_folder(report, "mutants" if since is None else f"mutants-since-{since}")
    if place is None:
        return tempfile.TemporaryDirectory(prefix="ergoqp-mutants-")
    return nullcontext(str(place))


def _since(commit: str, paths: Sequence[str]) -> Callable[[Mutant], bool]:
    """Return whether a mutant stands on a line that came after a commit."""
    came: dict[str, set[int]] = {}
    for path in paths:
        shown = subprocess.run(
            ["git", "diff", "-U0", commit, "--", path],
            cwd=ROOT,
            check=True,
            capture_output=True,
            text=True,
        ).stdout
        came[path] = set()
        for first, count in re.findall(r"^@@ .* \+(\d+)(?:,(\d+))? @@", shown, re.MULTILINE):
            came[path] |= set(range(int(first), int(first) + int(count or 1)))
    return lambda mutant: mutant.line in came[mutant.path]


def measure(report: Report, since: str | None = None) -> None:
    """Try the mutants in copies of the project, two at a time."""
    patterns = MUTATED if since else report.pick(MUTATED[-2:], MUTATED)
    paths = sorted(
        str(path.relative_to(ROOT)) for pattern in patterns for path in ROOT.glob(pattern)
    )
    counts = _since(since, paths) if since else None
    sample = sorted(
        (
            mutant
            for path in paths
            for mutant in mutants_of(ROOT, path)
            if counts is None or counts(mutant)
        ),
        key=lambda mutant: mutant.rank,
    )
    wanted = report.pick(12, 60 if since else 320)
    known = tomllib.loads(Path(__file__).with_name("alive.toml").read_text(encoding="utf-8"))[
        "alive"
    ]
    verdicts: list[Verdict] = []
    judges = TESTS if since else report.pick(("tests/sheets",), TESTS)
    with _place(report, since) as place, ThreadPoolExecutor(WORKERS) as pool:
        folders: SimpleQueue[Path] = SimpleQueue()
        for number in range(WORKERS):
            folders.put(_copy(Path(place) / str(number)))
        tests = Tests(_copy(Path(place) / "clean"), judges)
        report.say(f"{len(sample)} mistakes are possible; {wanted} are tried")
        kept = _Kept(Path(place) / "verdicts.jsonl")

        def one(mutant: Mutant, pinned: bool = True) -> Verdict | None:
            folder = folders.get()
            try:
                return kept.of(mutant, pinned, lambda: judged(folder, mutant, tests, pinned))
            finally:
                folders.put(folder)

        for future in as_completed([pool.submit(one, mutant) for mutant in sample[:wanted]]):
            verdict = future.result()
            if verdict is None:
                continue
            verdicts.append(verdict)
            if not verdict.killed:
                where = f"{verdict.mutant.path}:{verdict.mutant.line}"
                reason = known.get(
                    verdict.mutant.name,
                    "NOT EXPLAINED" if verdict.covered else "NO TEST RUNS THIS LINE",
                )
                report.say(
                    f"alive {where} [{verdict.mutant.kind}]\n  - {verdict.mutant.was}\n  +"
                    f" {verdict.now}\n  {reason}"
                )
            if len(verdicts) % 20 == 0:
                report.say(
                    f"{len(verdicts)}/{wanted}, {sum(verdict.killed for verdict in verdicts)}"
                    " killed"
                )
        again = pool.map(partial(one, pinned=False), sample[: 0 if since else report.pick(0, 50)])
        unpinned = [verdict.killed for verdict in again if verdict is not None]
    alive = [verdict for verdict in verdicts if not verdict.killed]
    explained = sum(verdict.mutant.name in known for verdict in alive)
    report.figure("mutants", len(verdicts))
    report.figure("killed_share", 1 - len(alive) / len(verdicts))
    report.figure(
        "killed_share.changing", 1 - (len(alive) - explained) / (len(verdicts) - explained)
    )
    if unpinned:
        report.figure(
            "killed_share.unpinned", sum(unpinned) / len(unpinned), f"of the first {len(unpinned)}"
        )
    report.figure("not_covered", sum(not verdict.covered for verdict in alive))
    report.figure(
        "explained", explained, "alive, and change nothing: reasons in tools/mutants/alive.toml"
    )
    report.figure("unexplained", len(alive) - explained)


def main() -> None:
    """Run the command line."""
    own = argparse.ArgumentParser(add_help=False)
    own.add_argument("--since", metavar="COMMIT")
    options, others = own.parse_known_args()
    run(partial(measure, since=options.since), __doc__ or "", others)


if __name__ == "__main__":
    main()
