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

- (no suffix): ergoqp as ``ergoqp run --guide best``, guided by the optimum of its own model;
- ``.descent``: the same without a guide, as ergoqp comes;
- ``.still``: nobody; ``.rule``: the rule of thumb, elbow height of the controller's own person,
  0.40 m ahead, level; ``.own_rule``: the same with the elbow of the very person;
- ``.open_loop``: straight to the optimum of ergoqp's model, without looking at the person;
- ``.gradient``, ``.gradient_smooth``: the EPFL report's equation 3.2 on its SVR, and on the smooth
  score.

The figures are described in `benchmarks.people_figures`: over all kinds, ``KIND.figure``,
``PROBLEM.figure``, ``kept.figure`` for the kinds that nothing was tuned on. Of the people
themselves: ``KIND.follows_still``, share of starts in which they are at rest once the object was
left alone; ``KIND.led_to_rest``, share of places, one drawn for
each start, to which they are led at 0.15 m/s,
come along and are at rest after 10 s; ``KIND.without_rest``, share of the places looked at for
starts where they have no rest: mostly out of reach; ``KIND.fell_at_start``, how often in holding
still; ``KIND.sole_mm``, how far a sole slides at most in any loop; ``KIND.hand_mm.still``, how far
a hand is off at rest at most; ``KIND.hold_mm``, how far it strays in holding still;
``KIND.route_matters``, share of places whose score depends on the way.

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
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from rich.progress import Progress

from benchmarks.people_draw import begin, make
from benchmarks.people_figures import SHORT, best_of, figures_of
from benchmarks.people_kinds import print_difference
from benchmarks.people_unit import APART_DEG, METHODS, run_unit
from benchmarks.report import Report, run
from ergoqp.files.whole import write_json
from ergoqp.problem_files.load import TASKS
from ergoqp.simulation.people import KINDS

KEPT = ("stepping", "dead_zone")
"""Kinds for judging only."""

JUDGING, TUNING = 1000, 0
"""First seeds of the two."""

OTHERS = tuple(kind for kind in KINDS if kind not in ("alike", "mass"))
STARTS = 20
SEEDS = 40
"""Starts that are wanted of a kind and problem, and how many seeds are tried for them."""
FEW = ("dentist", "desk", "screwing")
"""Problems of a quick run, whose people and optima take least time."""
MANY = 6
"""Starts of a quick run."""

_ROOT = Path(__file__).resolve().parent.parent
_WITHOUT = {"report", "cli", "comparison", "recordings", "studies", "whole_body", "export"}
"""Rooms that no loop comes by."""

_LIBRARIES = ("casadi", "daqp", "mujoco", "numpy", "scikit-learn", "scipy")

_WAYS = tuple(method or "ergoqp" for method in METHODS)


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


def print_figures(report: Report, found: Sequence[dict[str, Any]]) -> None:
    """Print the figures of all kinds, and fewer of each kind, each problem and the kept kinds."""
    drawn = [unit for unit in found if unit["drawn"]]
    report.figure("units", len(found))
    report.figure("starts", len(drawn), "units with a start bad enough")
    if not drawn:
        return
    report.figure("mean_start", sum(unit["still"] for unit in drawn) / len(drawn))
    report.figure("mean_best", sum(map(best_of, drawn)) / len(drawn), "of yardstick and all ways")
    report.figure("mean_best.yardstick", sum(unit["best"] for unit in drawn) / len(drawn))
    anywhere = sum(unit["anywhere"] for unit in drawn) / len(drawn)
    report.figure("mean_best_anywhere", anywhere, "whatever the way, from ease")
    cells = Counter((unit["kind"], unit["problem"]) for unit in drawn)
    report.figure("starts_least", min(cells.values()), "of a kind and problem")
    kinds = dict.fromkeys(unit["kind"] for unit in drawn)
    groups: dict[str, list[dict[str, Any]]] = {"": drawn}
    groups |= {kind: [unit for unit in drawn if unit["kind"] == kind] for kind in kinds}
    groups |= {name: [unit for unit in drawn if unit["problem"] == name] for name in TASKS}
    groups["kept"] = [unit for unit in drawn if unit["kind"] in KEPT]
    for name, units in groups.items():
        if not units:
            continue
        if name:
            of = [unit for unit in found if name in (unit["kind"], unit["problem"])]
            print_kind(report, name, units, of)
        print_ways(report, name, units)
    for cell in cells:
        units = [unit for unit in drawn if (unit["kind"], unit["problem"]) == cell]
        print_ways(report, ".".join(cell), units, shown=())


def print_ways(
    report: Report, name: str, units: Sequence[dict[str, Any]], shown: Sequence[str] = SHORT
) -> None:
    """Print the figures of every way over some units; those not `shown` go to the file alone."""
    columns = {way: figures_of(units, way) for way in _WAYS}
    for figure in dict.fromkeys(figure for values in columns.values() for figure in values):
        for way, values in columns.items():
            if figure in values:
                parts = (name, figure, "" if way == "ergoqp" else way)
                quiet = bool(name) and figure not in shown
                report.figure(".".join(filter(None, parts)), values[figure], quiet=quiet)


def print_kind(
    report: Report,
    name: str,
    units: Sequence[dict[str, Any]],
    tried: Sequence[dict[str, Any]],
) -> None:
    """Print whether these people do what a body does, and whether ways matter.

    Args:
        report: takes the figures.
        name: what they have in common.
        units: that were drawn.
        tried: those and the others, that found no start.
    """
    tries = sum((Counter(unit["tries"]) for unit in tried), Counter())
    if tries["places"]:
        share = tries["without_rest"] / tries["places"]
        report.figure(f"{name}.without_rest", share, f"of {tries['places']} places looked at")
    for why in ("fell_at_start", "fell_at_ease"):
        report.figure(f"{name}.{why}", tries[why], "times")
    still = [unit["ways"]["still"] for unit in units]
    rests = [way["holds"] and way["from_rest_deg"] < APART_DEG for way in still]
    report.figure(f"{name}.follows_still", float(np.mean(rests)), "at rest, the object left alone")
    asked = [unit["follows"] for unit in units]
    led = [each for each in asked if each is not None]
    if led:
        said = f"of {len(led)} places; {len(asked) - len(led)} out of reach"
        report.figure(f"{name}.led_to_rest", float(np.mean(led)), said)
    every = [way for unit in units for way in unit["ways"].values()]
    report.figure(f"{name}.sole_mm", max(way["slid_mm"] for way in every), "at most")
    for way in ("still", "ergoqp"):
        off = sorted(unit["ways"][way]["hand_mm"] for unit in units)
        beyond = float(np.mean(np.array(off) > 10.0))
        report.figure(
            f"{name}.hand_mm.{way}", off[-1], f"at rest, at most; beyond 10: {beyond:.3f}"
        )
    if held := max(unit["held_mm"] for unit in tried):
        report.figure(f"{name}.hold_mm", held, "in 20 s, at most, at every start that was tried")
    differ, count = (sum(unit["routes"][i] for unit in units) for i in range(2))
    if count:
        report.figure(f"{name}.route_matters", differ / count, "share of places")


def measure(report: Report, options: argparse.Namespace) -> None:
    """Run what is not kept yet, print the figures, write the page."""
    from benchmarks.people_page import write_people_page

    kinds = tuple(options.kinds.split(",")) if options.kinds else OTHERS
    usual = TASKS if report.full else FEW
    problems = tuple(options.problems.split(",")) if options.problems else usual
    for what, given, allowed in (("--kinds", kinds, KINDS), ("--problems", problems, TASKS)):
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
    print_figures(report, found)
    if options.page or report.full:
        path = write_people_page(found, _WAYS, options.out)
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
