"""The figures of many units: shares, means, times, ways and forces, for every method.

An end counts by the exact score of the person's rest there. Where there is none, because the hand
is not on the object, the person out of balance or moving on, it counts as no better than the start:
nobody wins by taking the object away. In the shares that end worse it is worse than any rest.

The best is the lower one of what the yardstick found before any loop was run, and of what any way
ended with: a yardstick that is beaten is not the best there is.

``share_at_best``: ends at rest and no higher than the best; ``share_at_20s``: had the object been
left there after 20 s; ``share_living_at_best``: what the person does in the last second does, where
there is a rest. ``mean_above_best``: points above it on average; ``beats_yardstick``: share that
ends below what was found before. ``worse_than_start``, ``worse_than_still``, ``worse_than_rule``,
``worse_than_own_rule``: shares that end worse than the rest at the start, than had the object been
left alone, than by the rule of thumb for the controller's person or for the very person;
``gain_over_rule``, ``gain_over_own_rule``: points below those. ``never_rests``: share in which the
object moved in the last 3 s; ``first_rest_s``: median time until it stood still for a second, 60
where never; ``first_rest_in_20s``: share in which that was within 20 s; ``tries``: how many places
ergoqp measured, on average; ``moves_per_minute``: how often the object set off from rest;
``limits_broken``: steps that broke a limit of the object's own motion, by the independent
checker, in all loops together. ``peak_above_start``: share in which the score on the way, a median
over 1 s, was more than a point above the higher of start and still. ``path_m``: median way of the
object. ``unbalanced``: share of the time with the centre of mass outside the feet.
``power_above_3hz``: share of the twist's power there. ``no_rest``: share that ends where the person
has none; ``lets_go``: with a hand more than 10 mm off; ``falls_over``: out of balance.
``force_median_n``, ``force_p99_n``, ``force_peak_n`` (the largest of all), ``force_tires`` (share
of the runs whose median is above `SUSTAINED_N`), ``slips`` (per run), ``falls`` (share): of people
with mass alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

SHORT = (
    "share_at_best",
    "mean_end",
    "mean_above_best",
    "worse_than_still",
    "worse_than_rule",
    "gain_over_rule",
    "gain_over_own_rule",
    "never_rests",
    "no_rest",
)
"""Figures that are printed per kind and per problem too; the JSON file has all of them."""

SUSTAINED_N = 25.0
"""What a hand may hold on to [N].

Half of what one arm is taken to be capable of in its weakest direction, upwards, sitting: 50 N (EN
1005-3, table 1, professional use). Half is the standard's bound for what it recommends; how long
and how often lowers it further, which a run of a minute says nothing of.
"""
CONTACT_N = (140.0, 280.0)
"""What hands and fingers may be pressed with, clamped and struck [N] (ISO/TS 15066, table A.2).

Limits for the onset of pain in an unwanted contact: not for a grip, beside which they are printed.
"""

_LONGEST = 60.0
_OFF_MM = 10.0
"""A hand further off has let go [mm]."""

Numbers = dict[str, Any]


def figures_of(units: Sequence[Numbers], method: str) -> dict[str, float]:
    """Return the figures of one method over units that were drawn.

    Args:
        units: as of `benchmarks.people_unit.run_unit`, at least one.
        method: one of their ways.
    """
    pairs = [(unit, unit["ways"][method]) for unit in units]

    def column(read: Callable[[Numbers, Numbers], float]) -> np.ndarray:
        return np.array([read(unit, way) for unit, way in pairs])

    end, best = column(end_of), column(lambda u, w: best_of(u))
    holds = column(lambda u, w: w["holds"]).astype(bool)
    early = column(lambda u, w: w["early_holds"] and w["early"] <= best_of(u))
    start = column(lambda u, w: u["still"])
    still, rule, own = (
        column(lambda u, w, name=name: end_of(u, u["ways"][name]))
        for name in ("still", "rule", "own_rule")
    )

    def worse_than(name: str) -> float:
        return float(np.mean([_worse(unit, way, unit["ways"][name]) for unit, way in pairs]))

    first = column(lambda u, w: _LONGEST if w["first_rest"] is None else w["first_rest"])
    moves, seconds = column(lambda u, w: w["moves"]), column(lambda u, w: w["seconds"])
    figures = {
        "share_at_best": float(np.mean(holds & (end <= best))),
        "share_at_20s": float(early.mean()),
        "share_living_at_best": float(np.mean(holds & (column(lambda u, w: w["lived"]) <= best))),
        "mean_end": float(end.mean()),
        "mean_above_best": float((end - best).mean()),
        "beats_yardstick": float(np.mean(holds & (end < column(lambda u, w: u["best"])))),
        "worse_than_start": float(np.mean(~holds | (end > start))),
        "worse_than_still": worse_than("still"),
        "worse_than_rule": worse_than("rule"),
        "worse_than_own_rule": worse_than("own_rule"),
        "gain_over_rule": float(np.mean(rule - end)),
        "gain_over_own_rule": float(np.mean(own - end)),
        "never_rests": float(np.mean(column(lambda u, w: not w["rests"]))),
        "first_rest_s": float(np.median(first)),
        "first_rest_in_20s": float(np.mean(first <= 20.0)),
        "limits_broken": float(np.sum(column(lambda u, w: w["broken"]))),
        "moves_per_minute": 60.0 * float(np.sum(moves) / np.sum(seconds)),
        "peak_above_start": float(
            np.mean(column(lambda u, w: w["peak"]) > np.maximum(start, still) + 1)
        ),
        "path_m": float(np.median(column(lambda u, w: w["path"]))),
        "power_above_3hz": float(np.mean(column(lambda u, w: w["power"]))),
        "no_rest": float(np.mean(~holds)),
        "lets_go": float(np.mean(column(lambda u, w: w["hand_mm"]) > _OFF_MM)),
        "falls_over": float(np.mean(column(lambda u, w: w["falls_over"]))),
        "unbalanced": float(np.mean(column(lambda u, w: w["unbalanced"]))),
    }
    tries = [way["tries"] for _, way in pairs if way["tries"] is not None]
    figures |= {"tries": float(np.mean(tries))} if tries else {}
    felt = [way for _, way in pairs if way["force"] is not None]
    if felt:
        forces = np.array([way["force"] for way in felt])
        figures |= {
            "force_median_n": float(np.median(forces[:, 0])),
            "force_p99_n": float(np.median(forces[:, 1])),
            "force_peak_n": float(forces[:, 2].max()),
            "force_tires": float(np.mean(forces[:, 0] > SUSTAINED_N)),
            "slips": float(np.mean([way["slips"] for way in felt])),
            "falls": float(np.mean([way["fell"] for way in felt])),
        }
    return figures


def end_of(unit: Numbers, way: Numbers) -> float:
    """Return the score that the end of a way counts by."""
    return float(way["end"] if way["holds"] else max(way["end"], unit["still"]))


def best_of(unit: Numbers) -> int:
    """Return the lowest score at rest that is known of a start: by the yardstick, or by any way."""
    ends = [way["end"] for way in unit["ways"].values() if way["holds"]]
    return min([unit["best"], *ends])


def _worse(unit: Numbers, way: Numbers, other: Numbers) -> bool:
    """Return whether a way ends worse than another: without a rest where the other has one, too."""
    if way["holds"] != other["holds"]:
        return bool(other["holds"])
    return end_of(unit, way) > end_of(unit, other)


def table_of(units: Sequence[Numbers], methods: Sequence[str]) -> list[tuple[str, ...]]:
    """Return one row per method: means and shares, as they are shown to people."""
    rows = []
    for method in methods:
        found = figures_of(units, method)
        rows.append(
            (
                method.replace("_", " "),
                f"{found['mean_end']:.2f}",
                f"{found['share_at_best']:.2f}",
                f"{found['share_at_20s']:.2f}",
                f"{found['mean_above_best']:.2f}",
                f"{found['worse_than_still']:.2f}",
                f"{found['worse_than_rule']:.2f}",
                f"{found['gain_over_rule']:+.2f}",
                f"{found['gain_over_own_rule']:+.2f}",
                f"{found['never_rests']:.2f}",
                f"{found['first_rest_s']:.1f}",
                f"{found['path_m']:.2f}",
            )
        )
    return rows
