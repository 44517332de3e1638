"""Whether the kinds of people are other people: their rests at the same places, with one body.

``differ_deg.KIND``: least of the other kinds' mean RMS difference of the 32 angles to this kind's
rests; ``differ_deg``: the least of all. ``differ_deg.same_kind``: two people of one kind, for
comparison: what habits alone make. ``differ_deg.KIND.same_habits``: to a follower with the same
habits, so what the kind alone makes at rest. It is nothing for those whose kind is what they do on
the way or how they are seen, and for the stubborn, whose habits are their kind.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, product

import numpy as np

from benchmarks.people_unit import judged
from benchmarks.report import Report
from ergoqp.human import Body
from ergoqp.simulation.people import person_of_kind
from ergoqp.simulation.people.person import Person
from ergoqp.simulation.people.soft_person import SoftPerson

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
    _print_same_habits(report, kinds, problems)


def _print_same_habits(report: Report, kinds: Sequence[str], problems: Sequence[str]) -> None:
    apart: dict[str, list[float]] = {kind: [] for kind in kinds if kind != "follower"}
    for name, seed in product(problems, _SEEDS):
        problem, _ = judged(name)
        follower = person_of_kind("follower", problem, seed, Body())
        for kind in apart:
            person = person_of_kind(kind, problem, seed, Body())
            if not (isinstance(person, SoftPerson) and isinstance(follower, SoftPerson)):
                continue
            same = type(person)(follower.body, follower.work, follower.habits, follower.senses)
            difference = np.degrees(_at_places(name, same) - _at_places(name, follower))
            rms = np.sqrt(np.mean(difference**2, axis=1))
            apart[kind].extend(rms[np.isfinite(rms)])
    for kind, values in apart.items():
        if values:
            report.figure(f"differ_deg.{kind}.same_habits", float(np.mean(values)))


def _rests(name: str, kind: str, seed: int) -> np.ndarray:
    """Return rests (n, 32) [rad] at the same places for all; not finite where not reached."""
    return _at_places(name, person_of_kind(kind, judged(name)[0], seed, Body()))


def _at_places(name: str, person: Person) -> np.ndarray:
    _, judge = judged(name)
    found = []
    for point in judge.workspace.spread(_PLACES):
        posture, reached = person.reach(judge.workspace.pose(point))
        found.append(posture if reached else np.full(32, np.nan))
    return np.array(found)
