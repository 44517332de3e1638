"""One person, one problem, one start: every way of moving the object, judged by the person's rests.

A unit is drawn by its kind, its problem and its seed alone, and what comes out is plain numbers.
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.people_way import Watch, at_rest, of_trace, rest_score
from ergoqp.costs.cost import Cost
from ergoqp.costs.svr import Svr
from ergoqp.datasets.postures import posture_data
from ergoqp.placing.optimise import optimise
from ergoqp.placing.optimum import Optimum
from ergoqp.placing.population import person_of
from ergoqp.problem.problem import Problem
from ergoqp.problem.robot import DeclaredRobot
from ergoqp.problem_files.load import load_problem
from ergoqp.simulation.baselines import Drive, Gradient, Still, rule_pose
from ergoqp.simulation.loop import Controller, run_loop, with_own_robot
from ergoqp.simulation.people import person_of_kind
from ergoqp.simulation.people.person import Holding, Person
from ergoqp.simulation.people.way import between, straight
from ergoqp.simulation.yardstick import Judge
from ergoqp.step.stepper import Stepper

METHODS = (
    "",
    "descent",
    "still",
    "rule",
    "own_rule",
    "open_loop",
    "gradient",
    "gradient_smooth",
)
"""Ways of moving the object; the first is ergoqp as it comes."""

DURATION = 60.0
"""Longest time of a loop [s]; it ends earlier once the object goes nowhere for `STILL` seconds."""
ABOVE = 2
"""Starts at rest count from this many points above the best."""

_OF = (6, 1)
"""A start is the worst of so many places, where the seed is even, and where it is odd."""
_TRIES = 20
_WAITS = 15.0
"""For how long a person is waited for at a place [s]."""
_PART = 13
"""Periods of 20 ms in which a part of the way of 4 cm is gone: 0.15 m/s."""
APART_DEG = 2.0
"""Whose angles are this near to those of their rest, RMS, rests [deg]."""
_FIRST: dict[str, dict[str, int]] = {"mass": {"places": 8, "around": 0}}
_SEARCH: dict[str, dict[str, int]] = {"mass": {"places": 20, "around": 0}}
_ROUTES = {"mass": 1}
_FOLLOWS = {"mass": 1}
"""Smaller searches for people who take long to simulate."""
_HOLDS = {"mass": 20.0}
"""For how long people hold still at the start before it counts, who might not [s]."""
_BY_CHANCE = ("pushed", "trembling")
"""Who is disturbed now and then rests at some time of the last 5 s, others all the last second."""


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
        held_mm: how far a hand strayed at most while the start was held still [mm].
        seed: of the loops.
    """

    problem: Problem
    person: Person
    start: Holding
    home: Holding
    still: int
    best: int
    anywhere: int
    held_mm: float
    seed: int


def draw_unit(kind: str, name: str, seed: int) -> Unit | str:
    """Return the unit of a kind, a problem and a seed, or why there is none."""
    problem, judge = judged(name)
    person = person_of_kind(kind, problem, seed)
    rng = np.random.default_rng([seed, 41])
    known = [rule_pose(problem, each) for each in (person_of(problem).body, person.body)]
    known.append(model_optimum(name).pose)
    home = person.hold(person.comfort, seed=seed)
    if home.fallen:
        return "fell at ease"
    first = _FIRST.get(kind, {"places": 24, "around": 1})
    anywhere = judge.best(home, known, **first)[0].score or 15
    why = "no start bad enough"
    for _ in range(_TRIES):
        asked = [judge.workspace.pose(rng.uniform(-1.0, 1.0, 5)) for _ in range(_OF[seed % 2])]
        place = max((judge.carried(home, pose) for pose in asked), key=lambda each: each.score)
        start = home.copy()
        # Without a look at every place from there: what is not bad beside the others is not bad.
        if place.score < anywhere + ABOVE or not start.carry(place.pose):
            continue
        held = hold_still(start, _HOLDS.get(kind, 0.0))
        if start.fallen:
            why = "fell at the start"
            continue
        still = rest_score(problem, start)[0]
        best = judge.best(start, known, **_SEARCH.get(kind, {}))[0].score or 15
        if still >= best + ABOVE:
            anywhere = min(anywhere, best)
            return Unit(problem, person, start, home, still, best, anywhere, held, seed)
    return why


def hold_still(person: Holding, seconds: float) -> float:
    """Hold the object still for so long; return how far a hand strays from there at most [mm]."""
    pose, most = person.pose.copy(), 0.0
    for _ in range(round(seconds / 0.05)):
        person.follow(pose, 0.05)
        # How far the object went, and the hand on it.
        away = float(np.linalg.norm(person.pose[:3, 3] - pose[:3, 3])) + person.gap
        most = max(most, 1e3 * away)
    return most


def controller_of(unit: Unit, method: str) -> Controller:
    """Return what moves the object."""
    problem, start = unit.problem, unit.start
    if method == "still":
        return Still(problem)
    if method not in ("rule", "own_rule", "open_loop"):
        return _built(problem.name, method, unit.person.robot)
    nominal = model_optimum(problem.name)
    goals: dict[str, Callable[[], np.ndarray]] = {
        "rule": lambda: rule_pose(problem, person_of(problem).body),
        "own_rule": lambda: rule_pose(problem, unit.person.body),
        "open_loop": lambda: nominal.pose,
    }
    # As far as the person comes along, asked in advance and without noise: nobody pulls the object
    # out of a hand. ergoqp has nothing like it; it is a favour to these three.
    there = start.copy()
    there.carry(goals[method]())
    return Drive(problem, start.pose, there.pose)


@cache
def _built(name: str, method: str, robot: DeclaredRobot | None) -> Controller:
    """Return what takes long to build: once per process; it is told of a robot of its own."""
    problem, _ = judged(name)
    problem = problem if robot is None else problem.replace(robot=robot)
    if method == "gradient":
        return Gradient(problem, svr())
    if method == "gradient_smooth":
        return Gradient(problem, problem.cost)
    return Stepper(problem, guide=None if method == "descent" else model_optimum(name))


@cache
def judged(name: str) -> tuple[Problem, Judge]:
    """Return a problem and who scores its places: once per process."""
    problem = load_problem(name)
    return problem, Judge(problem)


def run_unit(kind: str, name: str, seed: int, methods: tuple[str, ...] = METHODS) -> dict[str, Any]:
    """Return the numbers of a unit: of its start, and of every method from there."""
    begin = time.process_time()
    unit = draw_unit(kind, name, seed)
    found: dict[str, Any] = {"kind": kind, "problem": name, "seed": seed}
    if isinstance(unit, str):
        return found | {"drawn": False, "why": unit, "cpu_s": time.process_time() - begin}
    found |= {
        "drawn": True,
        "stature": unit.person.body.stature,
        "still": unit.still,
        "best": unit.best,
        "anywhere": unit.anywhere,
        "held_mm": unit.held_mm,
    }
    found |= {"routes": routes_of(unit), "follows": follows_of(unit)}
    found["ways"] = {method or "ergoqp": way_of(unit, method) for method in methods}
    return found | {"cpu_s": time.process_time() - begin}


def routes_of(unit: Unit) -> list[int]:
    """Return how many places score otherwise on a detour than straight from the start, of how many.

    Only places count that both ways reach.
    """
    judge, rng = judged(unit.problem.name)[1], np.random.default_rng([unit.seed, 42])
    differ = count = 0
    for _ in range(_ROUTES.get(unit.person.kind, 4)):
        place, by = (judge.workspace.pose(rng.uniform(-1.0, 1.0, 5)) for _ in range(2))
        detour = unit.start.copy()
        scores = (judge.carried(unit.start, place).score, 0)
        if detour.carry(by):
            scores = (scores[0], judge.carried(detour, place).score)
        if all(scores):
            count += 1
            differ += scores[0] != scores[1]
    return [differ, count]


def way_of(unit: Unit, method: str) -> dict[str, Any]:
    """Return the numbers of one method."""
    person, watch = unit.start.copy(), Watch(unit.start.pose)
    person.count_from_here()
    problem, robot = with_own_robot(unit.problem, unit.person, None, unit.seed)
    controller = controller_of(unit, method)
    trace = run_loop(
        problem,
        person,
        duration=DURATION,
        seed=unit.seed,
        controller=controller,
        beside=watch,
        robot=robot,
    )
    end, holds = rest_score(unit.problem, person)
    early = (end, holds) if watch.early is None else rest_score(unit.problem, watch.early)
    second = np.array(trace.postures)[-round(1.0 / controller.dt) :]
    return {
        "end": end,
        "lived": int(problem.assess(second.mean(axis=0)).final[0]),
        "early": early[0],
        "early_holds": early[1],
        "holds": holds,
        **of_trace(problem, trace, controller.dt),
        **at_rest(trace, person),
    }


def follows_of(unit: Unit) -> list[bool]:
    """Return, for places that are reached, whether the living person comes to rest there.

    Begun at ease, away from rest: the object goes straight to the place at 0.15 m/s, with the
    person's delay and chance, and then stays for `_WAITS` seconds.
    """
    _, judge = judged(unit.problem.name)
    rng, rests = np.random.default_rng([unit.seed, 43]), []
    for _ in range(_FOLLOWS.get(unit.person.kind, 2)):
        pose = judge.workspace.pose(rng.uniform(-1.0, 1.0, 5))
        if not judge.carried(unit.home, pose).score:
            continue
        person, dt = unit.home.copy(), 0.02
        here = person.pose
        for part in straight(here, pose):
            for share in np.linspace(0.0, 1.0, _PART + 1)[1:]:
                person.follow(between(here, part, share), dt)
            here = part
        lived = []
        for _ in range(round(_WAITS / dt)):
            person.follow(pose, dt)
            lived.append(person.posture)
        rest = person.copy()
        reached = rest.rest(pose)
        last = np.array(lived[-round(5.0 / dt) :])
        apart = np.sqrt(np.mean((last - rest.posture) ** 2, axis=1))
        by_chance = person.person.kind in _BY_CHANCE
        far = apart.min() if by_chance else apart[-round(1.0 / dt) :].max()
        rests.append(bool(reached and np.degrees(far) < APART_DEG))
    return rests


def model_optimum(name: str) -> Optimum:
    """Return the best place for the controller's own model of the person."""
    return _made(name)


def svr() -> Cost:
    """Return the report's surrogate, fitted as well as it can be."""
    return _made("svr")


def make(what: str) -> Any:
    """Return what takes long: ``svr``, or the optimum of the model of a problem of this name."""
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
