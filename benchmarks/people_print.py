"""What `benchmarks.people` prints: of the people themselves, and of every way of moving the object.

Of the people: ``follows_still``, share of starts in which they are at rest once the object was left
alone (of who is pushed or trembles: at some time of the last 5 s of 13); of one place each, drawn
at random, to which they are led at 0.15 m/s: ``left_behind``, share that is out of reach for a slow
hand too, and ``led_to_rest``, share of the others in which they are at rest after 10 s;
``without_rest``, share of the places looked at for starts where they have no rest: mostly out of
reach; ``fell_at_start``, how often in holding still; ``sole_mm``, how far a sole slides at most in
any loop, and ``sole_mm.still`` where the object is left alone; ``hand_mm.still``, how far a hand is
off at rest at most; ``hold_mm``, how far it strays in holding still; ``route_matters``, share of
places whose score depends on the way. The ways are described in `benchmarks.people_figures`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence

import numpy as np

from benchmarks.people_figures import (
    CONTACT_N,
    SHORT,
    SUSTAINED_N,
    Numbers,
    best_of,
    figures_of,
)
from benchmarks.people_unit import APART_DEG, METHODS
from benchmarks.report import Report

WAYS = tuple(method or "ergoqp" for method in METHODS)
"""Names of the ways."""


def print_figures(report: Report, found: Sequence[Numbers], kept: Collection[str]) -> None:
    """Print the figures of all kinds, and fewer of each kind, each problem and the kept kinds.

    Args:
        report: takes the figures.
        found: units, drawn or not.
        kept: kinds for judging only.
    """
    drawn = [unit for unit in found if unit["drawn"]]
    report.figure("units", len(found))
    report.figure("starts", len(drawn), "units with a start bad enough")
    if not drawn:
        return
    report.figure("mean_start", sum(unit["still"] for unit in drawn) / len(drawn))
    report.figure("mean_best", sum(map(best_of, drawn)) / len(drawn), "of yardstick and all ways")
    report.figure("mean_best.yardstick", sum(unit["best"] for unit in drawn) / len(drawn))
    anywhere = sum(min(unit["anywhere"], best_of(unit)) for unit in drawn) / len(drawn)
    report.figure("mean_best_anywhere", anywhere, "whatever the way, from ease")
    cells = Counter((unit["kind"], unit["problem"]) for unit in drawn)
    report.figure("starts_least", min(cells.values()), "of a kind and problem")
    if any(unit["ways"]["still"]["force"] is not None for unit in drawn):
        report.figure("limit.sustained_n", SUSTAINED_N, "EN 1005-3, half of one arm upwards")
        for figure, limit in zip(("clamped_n", "struck_n"), CONTACT_N, strict=True):
            report.figure(f"limit.{figure}", limit, "ISO/TS 15066, hands and fingers")
    print_ways(report, "", drawn)
    groups = {name: (name,) for unit in drawn for name in (unit["kind"], unit["problem"])}
    for name, members in (groups | {"kept": tuple(kept)}).items():
        tried = [unit for unit in found if {unit["kind"], unit["problem"]} & set(members)]
        units = [unit for unit in tried if unit["drawn"]]
        if units:
            print_kind(report, name, units, tried)
            print_ways(report, name, units)
    for cell in cells:
        units = [unit for unit in drawn if (unit["kind"], unit["problem"]) == cell]
        print_ways(report, ".".join(cell), units, shown=())


def print_ways(
    report: Report, name: str, units: Sequence[Numbers], shown: Sequence[str] = SHORT
) -> None:
    """Print the figures of every way over some units; those not `shown` go to the file alone."""
    ways = [way for way in units[0]["ways"] if all(way in unit["ways"] for unit in units)]
    columns = {way: figures_of(units, way) for way in ways}
    for figure in dict.fromkeys(figure for values in columns.values() for figure in values):
        for way, values in columns.items():
            if figure in values:
                parts = (name, figure, "" if way == "ergoqp" else way)
                quiet = bool(name) and figure not in shown
                report.figure(".".join(filter(None, parts)), values[figure], quiet=quiet)


def print_kind(
    report: Report,
    name: str,
    units: Sequence[Numbers],
    tried: Sequence[Numbers],
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
        report.figure(f"{name}.led_to_rest", float(np.mean(led)), f"of {len(led)} places")
    share = 1 - len(led) / len(asked)
    report.figure(f"{name}.left_behind", share, "share that does not come along to such a place")
    every = [way for unit in units for way in unit["ways"].values()]
    report.figure(f"{name}.sole_mm", max(way["slid_mm"] for way in every), "at most")
    slid = max(way["slid_mm"] for way in still)
    report.figure(f"{name}.sole_mm.still", slid, "at most, the object left alone")
    for way in ("still", "ergoqp"):
        off = sorted(unit["ways"][way]["hand_mm"] for unit in units)
        beyond = float(np.mean(np.array(off) > 10.0))
        report.figure(
            f"{name}.hand_mm.{way}", off[-1], f"at rest, at most; beyond 10: {beyond:.3f}"
        )
    if held := max((unit["held_mm"] for unit in tried), default=0.0):
        report.figure(f"{name}.hold_mm", held, "in 20 s, at most, at every start that was tried")
    differ, count = (sum(unit["routes"][i] for unit in units) for i in range(2))
    if count:
        report.figure(f"{name}.route_matters", differ / count, "share of places")
