"""Whether the kinds of people are other people: their rests at the same places, with one body.

``differ_deg.KIND``: least of the other kinds' mean RMS difference of the 32 angles to this kind's
rests; ``differ_deg``: the least of all. ``differ_deg.same_kind``: two people of one kind, for
comparison: what habits alone make. ``differ_deg.KIND.same_habits``: to a follower with the same
habits, so what the kind alone makes at rest. It is nothing for those whose kind is what they do on
the way or how they are seen, and for the stubborn, whose habits are their kind.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from concurrent.futures import Executor
from itertools import combinations, product

import numpy as np

from benchmarks.people_unit import judged
from benchmarks.report import Report
from ergoqp.human import Body
from ergoqp.lab.people.soft import SoftPerson
from ergoqp.simulation.people import person_of_kind

_PLACES = 4
_SEEDS = (1000, 1001)


def print_difference(
    report: Report, kinds: Sequence[str], problems: Sequence[str], pool: Executor
) -> None:
    """Print how far the kinds' rests are apart."""
    jobs = [*product(problems, kinds, _SEEDS, (False,)), *product(problems, kinds, _SEEDS, (True,))]
    found = dict(zip(jobs, pool.map(rests, *zip(*jobs, strict=True)), strict=True))
    apart: dict[tuple[str, str], list[float]] = {}
    for name in problems:
        people = list(product(kinds, _SEEDS))
        for one, other in combinations(people, 2):
            if one[0] != other[0] and one[1] != other[1]:
                continue
            pair = (one[0], other[0]) if one[0] != other[0] else ("same_kind", "same_kind")
            difference = found[name, *one, False] - found[name, *other, False]
            apart.setdefault(pair, []).extend(_rms(difference))
    means = {pair: float(np.mean(values)) for pair, values in apart.items() if values}
    report.figure("differ_deg.same_kind", means.pop(("same_kind", "same_kind"), 0.0))
    for kind in kinds if means else ():
        report.figure(f"differ_deg.{kind}", min(v for pair, v in means.items() if kind in pair))
    if means:
        report.figure("differ_deg", min(means.values()), "least of all pairs of kinds")
    if "follower" not in kinds:
        return
    for kind in kinds:
        both = list(product(problems, _SEEDS))
        pairs = [(found[n, kind, s, True], found[n, "follower", s, True]) for n, s in both]
        values = [value for one, other in pairs for value in _rms(one - other)]
        if values and kind != "follower":
            report.figure(f"differ_deg.{kind}.same_habits", float(np.mean(values)))


def rests(name: str, kind: str, seed: int, as_follower: bool) -> np.ndarray:
    """Return rests (n, 32) [deg] at the same places for all; not finite where not reached.

    Args:
        name: of the problem.
        kind: of the person, whose body is the same for all.
        seed: of the person.
        as_follower: with the habits that a follower of this seed has, where the kind has any.
    """
    problem, judge = judged(name)
    person = person_of_kind(kind, problem, seed, Body())
    if as_follower:
        habits = person_of_kind("follower", problem, seed, Body())
        if not (isinstance(person, SoftPerson) and isinstance(habits, SoftPerson)):
            return np.full((_PLACES, 32), np.nan)
        person = type(person)(habits.body, habits.work, habits.habits, habits.senses)
    found = []
    for point in judge.workspace.spread(_PLACES):
        posture, reached = person.reach(judge.workspace.pose(point))
        found.append(np.degrees(posture) if reached else np.full(32, np.nan))
    return np.array(found)


def _rms(differences: np.ndarray) -> Iterable[float]:
    """Return the finite RMS differences of postures (n, 32)."""
    rms = np.sqrt(np.mean(differences**2, axis=1))
    return rms[np.isfinite(rms)]
