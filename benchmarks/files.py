"""Files mistyped, cut off, forged or half written: what is said of them, what finding out costs.

Run ``python -m benchmarks.files [--quick | --full] [--json FILE]``. Each file is one that the
package reads, of ten kinds, with one to three mutations of `benchmarks.file_mutations`. It is
read in a process of its own memory, and either it is read, or one error of the package says in one
sentence why not.

- ``files``: how many; ``read``: of them, those that were read all the same (some mutations change
  nothing that matters).
- ``internal_faults``: other exceptions than the package's own.
- ``killed``: processes that ended, or did not answer for a minute.
- ``above_1_gb``: files that took more memory than that; ``slower_than_5_s``.
- ``messages_incomplete``: sentences without where it is (the file or the key) and what happened,
  those of a value that do not say what is allowed, and those of more than one line that do not
  count mistakes.

The control: ``control.internal_faults`` of the plain readers of the standard library and numpy on
the same files of text and arrays, which shows that the mutations are no harmless ones.
"""

from __future__ import annotations

import json
import multiprocessing
import re
import resource
import tempfile
import time
import tomllib
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.file_kinds import KINDS, Kind
from benchmarks.file_mutations import mutated
from benchmarks.report import Report, run
from ergoqp.errors import ErgoqpError

_PATIENCE = 60.0
_CHUNK = 50

Found = tuple[str, str, float, float, bool]


def main_of(numbers: list[int], folder: str, pipe: Connection) -> None:
    """Read one file after the other in this process, and report each.

    The report is (kind, what happened, seconds, megabytes, control).
    """
    kinds = [make(Path(folder)) for make in KINDS]
    for number in numbers:
        rng = np.random.default_rng([number, 12])
        kind = kinds[number % len(kinds)]
        pipe.send(_read(kind, rng, Path(folder)))
    pipe.close()


def _read(kind: Kind, rng: np.random.Generator, folder: Path) -> Found:
    path = mutated(kind, rng, folder)
    fails = _control(path)
    before, begin = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.perf_counter()
    try:
        kind.read(path)
        said = ""
    except ErgoqpError as error:
        said = _incomplete(str(error), path)
    except Exception as error:  # what the package lets through is what is looked for
        said = f"fault: {type(error).__name__}: {error}"[:300]
    took, more = (
        time.perf_counter() - begin,
        (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024,
    )
    return kind.name, said, took, more, fails


def _incomplete(message: str, path: Path) -> str:
    """Return "said" for a sentence that says everything, else what is wrong with it."""
    lines = message.splitlines()
    if len(lines) > 1 and not re.search(r"\d+ mistakes:$", lines[0]):
        return f"incomplete: more than one line: {message}"[:300]
    for line in lines[1:] or lines:
        where = path.stem in message or re.match(r"\s*[a-z_.0-9]+: ", line)
        event = re.search(r"\b(is|are|was|not|cannot|nothing|no)\b", line)
        value = re.search(r"\bgot\b", line)
        allowed = re.search(
            r"\b(allowed|required|usual|give|needed|stands?|expected|starts?|ends?|comes?|must|only"
            r"|state)\b",
            line,
        )
        if not (where and (allowed if value else event)):
            return f"incomplete: {line}"[:300]
    return "said"


def _control(path: Path) -> bool:
    """Whether the plain reader of the format raises."""
    if not path.is_file():
        return True
    try:
        if path.suffix == ".toml":
            tomllib.loads(path.read_text(encoding="utf-8"))
        elif path.suffix in (".json", ".jsonl"):
            for line in (
                path.read_text(encoding="utf-8").splitlines()
                if path.suffix == ".jsonl"
                else [path.read_text()]
            ):
                json.loads(line)
        elif path.suffix == ".npz" and path.stat().st_size < 1e6:
            with path.open("rb") as raw:
                np.load(raw, allow_pickle=False)
    except Exception:
        return True
    return False


def measure(report: Report) -> None:
    """Read them all, in two processes at a time."""
    count = report.pick(600, 5000)
    waiting = [list(range(start, min(start + _CHUNK, count))) for start in range(0, count, _CHUNK)]
    found: list[Found] = []
    killed: list[str] = []
    context = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory() as scratch:
        running: list[tuple[Any, Connection, list[int]]] = []
        while waiting or running:
            while waiting and len(running) < 2:
                numbers = waiting.pop(0)
                folder = Path(scratch) / f"{numbers[0]}"
                folder.mkdir()
                ours, theirs = context.Pipe(duplex=False)
                process = context.Process(target=main_of, args=(numbers, str(folder), theirs))
                process.start()
                theirs.close()
                running.append((process, ours, numbers))
            process, ours, numbers = running.pop(0)
            done = _listen(ours)
            found += done
            if len(done) < len(numbers):
                killed.append(f"file {numbers[len(done)]}")
                waiting.append(numbers[len(done) + 1 :])
                process.kill()
            process.join()
            report.say(f"{len(found)}/{count}")
            waiting = [some for some in waiting if some]
    _figures(report, found, killed)


def _listen(pipe: Connection) -> list[Found]:
    """Return what a process says until it ends, or says nothing for a minute."""
    done = []
    try:
        while pipe.poll(_PATIENCE):
            done.append(pipe.recv())
    except EOFError:
        pass
    return done


def _figures(report: Report, found: list[Found], killed: list[str]) -> None:
    said: dict[str, int] = {}
    for kind, what, *_ in found:
        if what not in ("", "said"):
            said[f"{kind}: {what}"] = said.get(f"{kind}: {what}", 0) + 1
    for words, count in sorted(said.items(), key=lambda item: -item[1])[:40]:
        report.say(f"  {count:>4}  {words}")
    report.figure("files", len(found))
    report.figure("read", sum(what == "" for _, what, *_ in found))
    report.figure("internal_faults", sum(what.startswith("fault") for _, what, *_ in found))
    report.figure("killed", len(killed), ", ".join(killed)[:100])
    report.figure("above_1_gb", sum(more > 1024 for *_, more, _ in found))
    report.figure("slower_than_5_s", sum(took > 5 for _, _, took, *_ in found))
    report.figure("slowest_s", max(took for _, _, took, *_ in found))
    report.figure(
        "messages_incomplete", sum(what.startswith("incomplete") for _, what, *_ in found)
    )
    report.figure(
        "control.internal_faults",
        sum(fails for *_, fails in found),
        "of plain readers on the same files",
    )


if __name__ == "__main__":
    run(measure, __doc__ or "")
