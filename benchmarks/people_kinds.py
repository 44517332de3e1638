"""Whether the kinds of people are other people: their rests at the same places, with one body.

``differ_deg.KIND``: least of the other kinds' mean RMS difference of the 32 angles to this kind's
rests; ``differ_deg``: the least of all. ``differ_deg.same_kind``: two people of one kind, for
comparison: what habits alone make.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from benchmarks.people_unit import judged
from benchmarks.report import Report
from ergoqp.human import Body
from ergoqp.simulation.people import person_of_kind

_PLACES = 4
_SEEDS = (1000, 1001)


def print_difference(report: Report, kinds: Sequence[str], problems: Sequence[str]) -> None:
    """Print how far the kinds' rests are apart."""
    apart: dict[tuple[str, str], list[float]] = {}
    for name in problems:
        rests = {(kind, seed): _rests(name, kind, seed) for kind in kinds for seed in _SEEDS}
        for one, other in combinations(rests, 2):
            if one[0] != other[0] and one[1] != other[1]:
                continue
            pair = (one[0], other[0]) if one[0] != other[0] else ("same_kind", "same_kind")
            difference = np.degrees(rests[one] - rests[other])
            rms = np.sqrt(np.mean(difference**2, axis=1))
            apart.setdefault(pair, []).extend(rms[np.isfinite(rms)])
    means = {pair: float(np.mean(values)) for pair, values in apart.items() if values}
    report.figure("differ_deg.same_kind", means.pop(("same_kind", "same_kind"), 0.0))
    for kind in kinds if means else ():
        report.figure(f"differ_deg.{kind}", min(v for pair, v in means.items() if kind in pair))
    if means:
        report.figure("differ_deg", min(means.values()), "least of all pairs of kinds")


def _rests(name: str, kind: str, seed: int) -> np.ndarray:
    """Return rests (n, 32) [rad] at the same places for all; not finite where not reached."""
    problem, judge = judged(name)
    person = person_of_kind(kind, problem, seed, Body())
    found = []
    for point in judge.workspace.spread(_PLACES):
        posture, reached = person.reach(judge.workspace.pose(point))
        found.append(posture if reached else np.full(32, np.nan))
    return np.array(found)
