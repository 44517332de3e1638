"""Closed loops with people of other kinds than the controller's model, beside every simple way.

Run ``python -m benchmarks.people [--quick | --full] [--kinds A,B] [--problems A,B] [--tuning]
[--out DIR] [--json FILE]``. ``--quick`` (the default) runs one start of six kinds in one of three
problems; ``--full`` twenty per kind and problem, for which up to forty seeds are tried, as not all
of them give a start. Every start has a person of its own. ``mass`` is
run when it is named (``--kinds mass``): it takes as long as all the others.

Seeds from 1000 are for judging; with ``--tuning`` seeds from 0 are taken, for whoever builds the
loop, and the kinds of `KEPT` are refused: nobody looks at the loop with them while building it.

A unit is a kind, a problem and a seed. Its start is a place drawn in the workspace, to which the
object is carried straight from comfort, and where the person has come to rest (even seeds: the
worst of six such places, since awkward ones are what this is about). It counts if that rest scores
at least 2 points above the best. The best is frozen before any loop is run: the lowest exact score
of the person's own undisturbed rest over places carried to straight from this start (48 spread over
the workspace, searched around the best three; the rule's, the nominal optimum's; of people with
mass, who take long, 20 and no search). What 24 places from ease find is looked at first, so that no
start is taken that is not bad beside them. People with mass hold still for 20 s at the start. From
there the same person with the same noise is led by

- (no suffix): ergoqp as ``ergoqp run --seek``, which tries places and keeps what measures best;
- ``.guided``: ergoqp as ``ergoqp run --guide best``, guided by the optimum of its own model;
- ``.descent``: the same without a guide, as ergoqp comes;
- ``.still``: nobody; ``.rule``: the rule of thumb, elbow height of the controller's own person,
  0.40 m ahead, level; ``.own_rule``: the same with the elbow of the very person;
- ``.open_loop``: straight to the optimum of ergoqp's model, without looking at the person;
- ``.gradient``, ``.gradient_smooth``: the EPFL report's equation 3.2 on its SVR, and on the smooth
  score;
- ``.without_gaze``: ergoqp with a model that does not look at the work (people who look alone).

The figures are described in `benchmarks.people_figures`, those of the people themselves in
`benchmarks.people_print`: over all kinds, ``KIND.figure``, ``PROBLEM.figure``, ``kept.figure`` for
the kinds that nothing was tuned on, and ``KIND.PROBLEM.figure`` in the JSON file.

Finished units are kept in ``--out`` (``out/people``) by what they depend on: a run that was ended
goes on from there. The page ``report.html`` there has the tables, ``tables.md`` too, and the worst
ten runs as replays.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import sys
import time
from collections.abc import Collection, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from rich.progress import Progress

from benchmarks.people_draw import begin, make
from benchmarks.people_kinds import print_difference
from benchmarks.people_print import WAYS, print_figures
from benchmarks.people_unit import run_unit
from benchmarks.report import Report, run
from ergoqp.files.atomic import write_json
from ergoqp.problem.load import TASKS
from ergoqp.simulation.people import kinds as all_kinds

KEPT = ("stepping", "dead_zone")
"""Kinds for judging only."""

JUDGING, TUNING = 1000, 0
"""First seeds of the two."""

OTHERS = tuple(kind for kind in all_kinds() if kind not in ("alike", "mass"))
STARTS = 20
SEEDS = 40
"""Starts that are wanted of a kind and problem, and how many seeds are tried for them."""
FEW = ("dentist", "desk", "screwing")
"""Problems of a quick run, whose people and optima take least time."""
MANY = 6
"""Starts of a quick run."""

_ROOT = Path(__file__).resolve().parent.parent
_WITHOUT = {"report", "cli", "comparison", "mocap", "whole_body", "export"}
"""Rooms that no loop comes by."""

_LIBRARIES = ("casadi", "daqp", "mujoco", "numpy", "scikit-learn", "scipy")


def units_of(kinds: Sequence[str], problems: Sequence[str], full: bool, first: int) -> list[tuple]:
    """Return the units (kind, problem, seed) of a sample."""
    if full:
        seeds = range(first, first + STARTS)
        return [(kind, name, seed) for seed in seeds for kind in kinds for name in problems]
    chosen = enumerate(kinds[:MANY])
    return [(kind, problems[i % len(problems)], first + i) for i, kind in chosen]


def missing(found: Sequence[dict[str, Any]], first: int) -> list[tuple]:
    """Return the next units of cells that have less than `STARTS` starts: some drew none."""
    cells: dict[tuple[str, str], list[bool]] = {}
    for unit in found:
        cells.setdefault((unit["kind"], unit["problem"]), []).append(unit["drawn"])
    return [
        (*cell, first + seed)
        for cell, drawn in cells.items()
        for seed in range(len(drawn), min(len(drawn) + STARTS - sum(drawn), SEEDS))
    ]


@cache
def digest(kind: str) -> str:
    """Return a short text that stands for everything that a unit of a kind depends on.

    As it is at the first call: what is changed while units run is not what they were run with.
    """
    found = hashlib.sha256(" ".join(map(version, _LIBRARIES)).encode())
    for folder, ending in (("ergoqp", "py"), ("models", "*"), ("problems", "toml")):
        for path in sorted((_ROOT / folder).rglob(f"*.{ending}")):
            parts = path.relative_to(_ROOT).parts
            if not _WITHOUT & set(parts) and (kind == "mass" or "mass" not in parts):
                found.update(path.read_bytes())
    for name in ("people_draw", "people_unit", "people_way"):
        found.update((_ROOT / "benchmarks" / f"{name}.py").read_bytes())
    return found.hexdigest()[:12]


def prepared(problems: Collection[str], quick: bool = False) -> ProcessPoolExecutor:
    """Return two processes that have what takes long for these problems, made once.

    Args:
        problems: of their units.
        quick: nothing is worth compiling.
    """
    both = min(2, os.cpu_count() or 1)
    with ProcessPoolExecutor(both, initializer=begin, initargs=({},)) as pool:
        what = [*(("svr",) if problems else ()), *problems]
        made = dict(zip(what, pool.map(make, what), strict=True))
    if quick:
        made["compiled"] = False
    return ProcessPoolExecutor(both, initializer=begin, initargs=(made,))


def finished(units: Iterable[tuple], folder: Path, say: Report) -> list[dict[str, Any]]:
    """Return the numbers of units, run in two processes where they are not kept yet."""
    of = {kind: digest(kind) for kind in {unit[0] for unit in units}}
    for kind, before in of.items():
        if digest.__wrapped__(kind) != before:
            raise SystemExit("ergoqp was changed while its units ran: start again")
    paths = {unit: folder / of[unit[0]] / f"{'-'.join(map(str, unit))}.json" for unit in units}
    left = [unit for unit, path in paths.items() if not path.is_file()]
    for path in paths.values():
        path.parent.mkdir(parents=True, exist_ok=True)
    say.say(f"{len(paths)} units, {len(left)} to run, kept in {os.path.relpath(folder)}")
    if left:
        run_all({unit: paths[unit] for unit in left}, say)
    return [json.loads(path.read_text()) for path in paths.values()]


def run_all(left: Mapping[tuple, Path], say: Report) -> None:
    """Run units and write the numbers of each to its path as soon as they are there.

    Raises:
        SystemExit: names the units that failed, after all others.
    """
    failed: list[str] = []
    problems = dict.fromkeys(unit[1] for unit in left)
    pool = prepared(problems, quick=not say.full)
    try:
        with Progress(disable=not sys.stdout.isatty()) as progress:
            bar = progress.add_task("units", total=len(left))
            futures = {pool.submit(run_unit, *unit): unit for unit in left}
            for done, future in enumerate(as_completed(futures), start=1):
                unit = futures[future]
                try:
                    write_json(left[unit], future.result())
                except Exception as error:
                    failed.append(f"{'-'.join(map(str, unit))}: {type(error).__name__}: {error}")
                progress.advance(bar)
                if progress.disable and done % 20 == 0:
                    say.say(f"{done}/{len(left)}")
    finally:
        pool.shutdown(cancel_futures=True)
    if failed:
        raise SystemExit("\n".join(["units failed:", *failed]))


def measure(report: Report, options: argparse.Namespace) -> None:
    """Run what is not kept yet, print the figures, write the page."""
    from benchmarks.people_page import write_people_page

    kinds = tuple(options.kinds.split(",")) if options.kinds else OTHERS
    usual = TASKS if report.full else FEW
    problems = tuple(options.problems.split(",")) if options.problems else usual
    for what, given, allowed in (("--kinds", kinds, all_kinds()), ("--problems", problems, TASKS)):
        if unknown := set(given) - set(allowed):
            raise SystemExit(f"{what}: got {sorted(unknown)}, allowed some of {', '.join(allowed)}")
    if options.tuning:
        if options.kinds and set(kinds) & set(KEPT):
            raise SystemExit(f"--tuning: got {', '.join(KEPT)}, which are for judging only")
        kinds = tuple(kind for kind in kinds if kind not in KEPT)
    first = TUNING if options.tuning else JUDGING
    units = units_of(kinds, problems, report.full, first)
    started = time.perf_counter()
    found = finished(units, options.out, report)
    while report.full and (more := missing(found, first)):
        found += finished(more, options.out, report)
    took = time.perf_counter() - started
    report.figure("seconds", took, "for the units that were not kept")
    cores = sum(unit["cpu_s"] for unit in found) / 60
    report.figure("core_minutes", cores, "of all units: half as many minutes on two cores")
    with prepared(()) as pool:
        print_difference(report, kinds, problems if report.full else problems[:1], pool)
    print_figures(report, found, KEPT)
    if options.page or report.full:
        path = write_people_page(found, WAYS, options.out)
        report.say(f"page: {os.path.relpath(path)}")


def parser() -> argparse.ArgumentParser:
    """Return what reads the options of this benchmark; the others are those of all."""
    own = argparse.ArgumentParser(add_help=False)
    own.add_argument("--kinds", help="kinds of people, with commas between")
    own.add_argument("--problems", help="problems, with commas between")
    own.add_argument("--tuning", action="store_true", help="seeds for building the loop")
    own.add_argument("--page", action="store_true", help="write the page for a quick run too")
    own.add_argument("--out", type=Path, default=_ROOT / "out" / "people")
    return own


if __name__ == "__main__":
    options, rest = parser().parse_known_args()
    run(lambda report: measure(report, options), __doc__ or "", rest)
