"""Where a loop with a person starts: who, which start, and the best that there is from there."""

from __future__ import annotations

import importlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.people_way import rested
from ergoqp.costs.cost import Cost
from ergoqp.costs.svr import Svr
from ergoqp.datasets.postures import posture_data
from ergoqp.lab.yardstick import Judge, rule_pose
from ergoqp.native.compiled import CompilerError, compiler
from ergoqp.placing.optimise import optimise
from ergoqp.placing.optimum import Optimum
from ergoqp.problem.load import load_problem
from ergoqp.problem.problem import Problem
from ergoqp.responses.ik import IkResponse
from ergoqp.rest.model_person import person_of
from ergoqp.rest.person_protocol import Holding, Person
from ergoqp.seeking import Place
from ergoqp.simulation.people import person_of_kind

ABOVE = 2
"""Starts at rest count from this many points above the best."""
_OF = (6, 1)
"""A start is the worst of so many places, where the seed is even, and where it is odd."""
_TRIES = 20
_FIRST: dict[str, dict[str, int]] = {"mass": {"places": 8, "around": 0}}
_SEARCH: dict[str, dict[str, int]] = {"mass": {"places": 20, "around": 0}}
"""Smaller searches for people who take long to simulate."""
_HOLDS = {"mass": 20.0}
"""For how long people hold still at the start before it counts, who might not [s]."""


@cache
def judged(name: str) -> tuple[Problem, Judge]:
    """Return a problem and who scores its places: once per process."""
    problem = load_problem(name)
    return problem, Judge(problem)


@cache
def unseeing(name: str) -> Problem:
    """Return a problem whose model of the person does not look at the work: the gaze taken away."""
    problem, _ = judged(name)
    assert isinstance(problem.response, IkResponse)
    return problem.replace(response=replace(problem.response, looks=False))


@dataclass(frozen=True)
class Unit:
    """What one unit starts from.

    Attributes:
        problem: the task.
        person: who follows.
        start: the person at rest with the object at the start.
        home: the person at ease with the object.
        still: exact score there.
        best: lowest exact score of places reached straight from there.
        anywhere: the same, or what a smaller search finds on ways from comfort if that is lower.
        seed: of the loops.
    """

    problem: Problem
    person: Person
    start: Holding
    home: Holding
    still: int
    best: int
    anywhere: int
    seed: int


@dataclass
class Draw:
    """What came of drawing a unit.

    Attributes:
        unit: None where no start was found.
        tries: how often which start was not taken: ``not_bad_enough``, ``fell_at_start``,
            ``fell_at_ease``; and ``places``, how many were looked at, of which ``without_rest`` are
            such where the person has none: out of reach, out of balance, or in motion for ever.
        held_mm: how far a hand strayed at most while a start was held still, taken or not [mm].
    """

    unit: Unit | None
    tries: Counter[str]
    held_mm: float


def draw_unit(kind: str, name: str, seed: int) -> Draw:
    """Return the unit of a kind, a problem and a seed, or why there is none."""
    problem, judge = judged(name)
    person = person_of_kind(kind, problem, seed)
    rng = np.random.default_rng([seed, 41])
    known = [rule_pose(problem, each) for each in (person_of(problem).body, person.body)]
    known.append(model_optimum(name).pose)
    home = person.hold(person.comfort, seed=seed)
    drawn = Draw(None, Counter(places=0, without_rest=0, fell_at_start=0), 0.0)
    if home.fallen:
        drawn.tries["fell_at_ease"] += 1
        return drawn
    first = _FIRST.get(kind, {"places": 24, "around": 1})
    anywhere = judge.best(home, known, **first)[0].score or 15
    for _ in range(_TRIES):
        asked = [judge.workspace.pose(rng.uniform(-1.0, 1.0, 5)) for _ in range(_OF[seed % 2])]
        places = [judge.carried(home, pose) for pose in asked]
        drawn.tries["places"] += len(places)
        drawn.tries["without_rest"] += sum(not each.score for each in places)
        place = max(places, key=lambda each: each.score)
        start = home.copy()
        # Without a look at every place from there: what is not bad beside the others is not bad.
        if place.score < anywhere + ABOVE or not start.carry(place.pose):
            drawn.tries["not_bad_enough"] += 1
            continue
        drawn.held_mm = max(drawn.held_mm, hold_still(start, _HOLDS.get(kind, 0.0)))
        if start.fallen:
            drawn.tries["fell_at_start"] += 1
            continue
        still = rested(problem, start).score
        best = judge.best(start, known, **_SEARCH.get(kind, {}))[0].score or 15
        if still >= best + ABOVE:
            anywhere = min(anywhere, best)
            drawn.unit = Unit(problem, person, start, home, still, best, anywhere, seed)
            return drawn
        drawn.tries["not_bad_enough"] += 1
    return drawn


def hold_still(person: Holding, seconds: float) -> float:
    """Hold the object still for so long; return how far a hand strays from there at most [mm]."""
    pose, most = person.pose.copy(), 0.0
    for _ in range(round(seconds / 0.05)):
        person.follow(pose, 0.05)
        # How far the object went, and the hand on it.
        away = float(np.linalg.norm(person.pose[:3, 3] - pose[:3, 3])) + person.gap
        most = max(most, 1e3 * away)
    return most


def model_optimum(name: str) -> Optimum:
    """Return the best place for the controller's own model of the person."""
    return _made(name)


def places_to_try(problem: Problem, best: Optimum) -> list[Place]:
    """Return the places that ``ergoqp run --seek`` tries: the model's best one, and the rule's."""
    rule = rule_pose(problem, person_of(problem).body)
    return [Place("model's best", best.pose), Place("rule", rule)]


@cache
def unseeing_optimum(name: str) -> Optimum:
    """Return the best place for the same model when it does not look at the work."""
    problem = unseeing(name)
    return optimise(problem, person_of(problem).comfort)


def svr() -> Cost:
    """Return the report's surrogate, fitted as well as it can be."""
    return _made("svr")


def compiles() -> bool:
    """Return whether there is a C compiler, and so much to run that it is worth it."""
    return bool(_made("compiled"))


def make(what: str) -> Any:
    """Return what takes long: ``svr``, or the optimum of the model of a problem of this name.

    Or whether there is a C compiler: ``compiled``.
    """
    if what == "compiled":
        try:
            compiler()
        except CompilerError:
            return False
        return True
    if what == "svr":
        # Which the fit would choose by itself, in twice the time.
        return Svr.fit(posture_data(150), features="steps")
    problem, _ = judged(what)
    return optimise(problem, person_of(problem).comfort)


def begin(made: Mapping[str, Any]) -> None:
    """Begin a process that has all this already, see `make`."""
    # Small matrices: threads of their own would only be in each other's way. A limit holds for the
    # libraries that are loaded, and the SVR's fit brings another.
    importlib.import_module("scipy.linalg")
    threadpool_limits(1)
    _MADE.update(made)


_MADE: dict[str, Any] = {}


def _made(what: str) -> Any:
    if what not in _MADE:
        _MADE[what] = make(what)
    return _MADE[what]
