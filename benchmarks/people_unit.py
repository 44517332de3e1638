"""One person, one problem, one start: every way of moving the object, judged by the person's rests.

A unit is drawn by its kind, its problem and its seed alone, and what comes out is plain numbers.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from benchmarks.people_draw import (
    Unit,
    compiles,
    draw_unit,
    judged,
    model_optimum,
    places_to_try,
    svr,
    unseeing,
    unseeing_optimum,
)
from benchmarks.people_way import (
    BY_CHANCE,
    DONE,
    PUSHED,
    STILL,
    Watch,
    apart_deg,
    at_rest,
    of_trace,
    rested,
)
from ergoqp.lab.yardstick import Drive, Gradient, Still, rule_pose
from ergoqp.problem.geometry import between, straight
from ergoqp.problem.settings import DeclaredRobot
from ergoqp.rest.model_person import person_of
from ergoqp.seeking import Seeker
from ergoqp.simulation.check import Checker
from ergoqp.simulation.loop import Controller, run_loop, with_own_robot
from ergoqp.step.stepper import Stepper

METHODS = (
    "",
    "guided",
    "descent",
    "still",
    "rule",
    "own_rule",
    "open_loop",
    "gradient",
    "gradient_smooth",
)
"""Ways of moving the object.

The first is ergoqp as ``ergoqp run --seek`` runs it: it tries the optimum of its own model and the
rule's place after its own descent, and keeps what measures best. The second is guided by that
optimum alone (``ergoqp run --guide best``), the third has no guide.
"""

TAKEN = {"looking": ("without_gaze",)}
"""And with parts of ergoqp taken away, for the kinds that they are there for."""

DURATION = 60.0
"""Longest time of a loop [s]; it ends earlier once the object goes nowhere for `STILL` seconds."""

_DELAYS = 2.0
"""For how long whoever follows is waited for at the end of a drive [s]."""
_WAITS = 10.0
"""For how long a person is waited for at a place [s]."""
_PART = 13
"""Periods of 20 ms in which a part of the way of 4 cm is gone: 0.15 m/s."""
_HELD = 0.01
"""A hand that is no further off holds the object [m]."""
APART_DEG = 2.0
"""Whose angles are this near to those of their rest, RMS, rests [deg]."""
OBJECT_SIDE = ("speed", "acceleration", "axes", "workspace", "tool axis")
"""Limits of the object's own motion, whoever holds it."""
_ROUTES = {"mass": 1}
"""Fewer places for people who take long to simulate."""


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
    return Drive(problem, start.pose, come_along(unit, goals[method]()))


def come_along(unit: Unit, goal: np.ndarray) -> np.ndarray:
    """Return where a drive to a place may end (4, 4): there, or as far as the person comes along.

    Tried in advance with the very person, by a slow hand and by the drive itself: nobody pulls the
    object out of a hand. ergoqp has nothing like it; it is a favour to the simple ways.
    """
    carried = unit.start.copy()
    # A robot of the person's own is soft: what a slow hand may do it may not, and the other way.
    if carried.carry(goal) and unit.person.robot is None:
        return goal
    driven = unit.start.copy()
    problem, robot = with_own_robot(unit.problem, unit.person, None, unit.seed)
    drive = Drive(problem, unit.start.pose, goal)
    duration = drive.duration + _DELAYS
    run_loop(problem, driven, duration=duration, seed=unit.seed, controller=drive, robot=robot)
    return goal if rested(problem, driven).holds else carried.pose


@cache
def _built(name: str, method: str, robot: DeclaredRobot | None) -> Controller:
    """Return what takes long to build: once per process; it is told of a robot of its own."""
    problem, _ = judged(name)
    problem = problem if robot is None else problem.replace(robot=robot)
    if method.startswith("gradient"):
        cost = svr() if method == "gradient" else problem.cost
        return Gradient(problem, cost, compiled=compiles())
    best = model_optimum(name)
    if method == "without_gaze":
        best = unseeing_optimum(name)
        problem = problem.replace(response=unseeing(name).response)
    elif method:
        return Stepper(problem, guide=None if method == "descent" else best)
    return Seeker(problem, places_to_try(problem, best), patient=True)


def run_unit(kind: str, name: str, seed: int, methods: tuple[str, ...] = METHODS) -> dict[str, Any]:
    """Return the numbers of a unit: of its start, and of every method from there, `TAKEN` too."""
    begin = time.process_time()
    drawn = draw_unit(kind, name, seed)
    unit = drawn.unit
    found: dict[str, Any] = {
        "kind": kind,
        "problem": name,
        "seed": seed,
        "drawn": unit is not None,
        "tries": dict(drawn.tries),
        "held_mm": drawn.held_mm,
    }
    if unit is None:
        return found | {"cpu_s": time.process_time() - begin}
    found |= {
        "stature": unit.person.body.stature,
        "still": unit.still,
        "best": unit.best,
        "anywhere": unit.anywhere,
    }
    found |= {"routes": routes_of(unit), "follows": follows_of(unit)}
    every = (*methods, *TAKEN.get(kind, ()))
    found["ways"] = {
        method or "ergoqp": way_of(unit, controller_of(unit, method)) for method in every
    }
    return found | {"cpu_s": time.process_time() - begin}


def routes_of(unit: Unit) -> list[int]:
    """Return how many places score otherwise on a detour than straight from the start, of how many.

    Only places count that both ways reach.
    """
    judge, rng = judged(unit.problem.name)[1], np.random.default_rng([unit.seed, 42])
    differ = count = 0
    for _ in range(_ROUTES.get(unit.person.kind, 2)):
        place, by = (judge.workspace.pose(rng.uniform(-1.0, 1.0, 5)) for _ in range(2))
        detour = unit.start.copy()
        scores = (judge.carried(unit.start, place).score, 0)
        if detour.carry(by):
            scores = (scores[0], judge.carried(detour, place).score)
        if all(scores):
            count += 1
            differ += scores[0] != scores[1]
    return [differ, count]


def way_of(unit: Unit, controller: Controller) -> dict[str, Any]:
    """Return the numbers of one way of moving the object."""
    person = unit.start.copy()
    person.count_from_here()
    problem, robot = with_own_robot(unit.problem, unit.person, None, unit.seed)
    checker = Checker(problem)
    watch = Watch(unit.start.pose, still_of(controller, unit.person.kind))
    trace = run_loop(
        problem,
        person,
        duration=DURATION,
        seed=unit.seed,
        controller=controller,
        checker=checker,
        beside=watch,
        robot=robot,
    )
    end = rested(unit.problem, person)
    early = end if watch.early is None else rested(unit.problem, watch.early)
    second = np.array(trace.postures)[-round(1.0 / controller.dt) :]
    return {
        "end": end.score,
        "lived": int(problem.assess(second.mean(axis=0)).final[0]),
        "early": early.score,
        "early_holds": early.holds,
        "holds": end.holds,
        "tries": len(controller.account) if isinstance(controller, Seeker) else None,
        "broken": None
        if checker is None
        else sum(checker.violations.get(name, 0) for name in OBJECT_SIDE),
        **of_trace(problem, trace, controller.dt),
        **at_rest(trace, person, end.person, controller.dt),
    }


def still_of(controller: Controller, kind: str) -> float:
    """Return how long an object goes nowhere until a loop is over [s]."""
    if isinstance(controller, Still) and kind in BY_CHANCE:
        return PUSHED
    return DONE if isinstance(controller, Still | Drive) else STILL


def follows_of(unit: Unit) -> bool | None:
    """Return, for a place drawn at random, whether the living person comes to rest there.

    None where they neither come along nor have a rest there that a slow hand leads them to. Begun
    at ease, away from rest: the object goes straight to the place at 0.15 m/s, with the person's
    delay and chance, and then stays for `_WAITS` seconds.
    """
    rng, dt = np.random.default_rng([unit.seed, 43]), 0.02
    pose = judged(unit.problem.name)[1].workspace.pose(rng.uniform(-1.0, 1.0, 5))
    person = unit.home.copy()
    here = person.pose
    for part in straight(here, pose):
        for share in np.linspace(0.0, 1.0, _PART + 1)[1:]:
            person.follow(between(here, part, share), dt)
        here = part
    lived, holds = [], []
    for _ in range(round(_WAITS / dt)):
        person.follow(pose, dt)
        lived.append(person.posture)
        holds.append(person.gap < _HELD and not person.unbalanced and not person.fallen)
    if not any(holds[-round(1.0 / dt) :]):
        return False if unit.home.copy().carry(pose) else None
    rest = person.copy()
    rest.rest(pose)
    return apart_deg(np.array(lived), rest.posture, dt, person.person.kind) < APART_DEG
