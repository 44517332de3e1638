"""A whole closed loop: a problem, a person who starts somewhere, all that a `Run` says about it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ergoqp.arguments import (
    check_called,
    check_kind,
    check_number,
    check_whole,
    sentences,
    shown,
    table_of_numbers,
    unmasked,
)
from ergoqp.errors import InputError
from ergoqp.human import Body
from ergoqp.joints import JOINTS, LOWER, UPPER, spoken
from ergoqp.problem.problem import Problem
from ergoqp.problem.robot import DeclaredRobot
from ergoqp.responses.ik import IkResponse
from ergoqp.simulation.check import Checker
from ergoqp.simulation.loop import LONGEST, Start, outside_of_range, run_loop, settle_time, start_at
from ergoqp.simulation.options import options_of
from ergoqp.simulation.people import Senses, sample_person
from ergoqp.simulation.person import Follower
from ergoqp.simulation.robot import RobotKind
from ergoqp.simulation.run import Run
from ergoqp.step.place import Guide, read_guide
from ergoqp.step.stepper import Stepper

_SOLVER = "daqp"
_AT_END = np.radians(0.01)  # a start this far beyond a joint's range is rounding

Progress = Callable[[float], None]
"""Told the share of the loop that is done, 0 to 1."""


def simulate(
    problem: Problem,
    posture: ArrayLike,
    duration: float = 20.0,
    seed: int = 0,
    *,
    person: Follower | Body | None = None,
    observed: ArrayLike | None = None,
    recording: str | Path | None = None,
    start_time: float | None = None,
    assumptions: Sequence[str] = (),
    progress: Progress | None = None,
    guide: Any = None,
    robot: RobotKind | None = None,
    senses: Senses | None = None,
) -> Run:
    """Close the loop of a problem with a simulated person built unlike the controller's model.

    Args:
        problem: the task; its response must be an `IkResponse`.
        posture: in which the person starts, holding the object (32,) [rad].
        duration: of the loop [s].
        seed: of the person, of noise and of lost frames.
        person: who follows, or their body; None: drawn with the seed.
        observed: (32,) bool, False for joints that the controller does not see; None: all are seen.
        recording: name of the recording that the posture comes from, for the report.
        start_time: when it was taken there [s].
        assumptions: sentences on what was taken as given before, for the report.
        progress: called now and then with the share that is done.
        guide: a place that the control step is drawn to where descent alone comes to rest at a
            worse one: the optimum of `ergoqp.optimise` or a pose (4, 4), see
            `ergoqp.step.place.read_guide`; None: descent alone.
        robot: how the robot really does what it is sent; None: as badly as the problem declares it.
        senses: what lies between person and controller, constant errors of angles too; None: the
            usual noise.

    Returns:
        Everything that happened, judged by the independent checker.

    Raises:
        InputError: if an argument is not usable, naming it.
    """
    check_kind("problem", problem, Problem, "a Problem, such as ergoqp.load_problem gives")
    check_numbers(problem, duration, seed)
    none = type(None)
    for what, value, kind, allowed in (
        ("person", person, (Follower, Body, none), "a Follower, a Body or None"),
        ("robot", robot, (RobotKind, none), "a RobotKind or None"),
        ("senses", senses, (Senses, none), "Senses or None"),
        ("recording", recording, (str, Path, none), "the name of a recording or None"),
    ):
        check_kind(what, value, kind, allowed)
    if start_time is not None:
        check_number("start_time", start_time, -1e9, 1e9, "s")
    check_called("progress", progress, "a function of the share that is done")
    assumptions = sentences("assumptions", assumptions)
    model = problem.response
    if not isinstance(model, IkResponse):
        raise InputError(
            f"problem {problem.name}: got a response of type {type(model).__name__}, allowed"
            " IkResponse"
        )
    start_posture, beyond = read_posture(posture)
    seen = _read_observed(observed)
    follower = person if isinstance(person, Follower) else sample_person(problem, seed, person)
    start = start_at(follower, start_posture)
    checker = _Watched(problem, progress, round(duration / problem.dt))
    place = None if guide is None else read_guide(problem, guide)
    stepper = Stepper(problem, solver=_SOLVER, guide=place)
    senses = senses or Senses()
    how = {
        "duration": duration,
        "seed": seed,
        "observed": seen,
        "checker": checker,
        "robot": robot,
        "senses": senses,
    }
    trace = run_loop(problem, follower, start, stepper=stepper, **how)
    postures = np.array(trace.postures)
    scores = problem.assess(postures).final
    settled = settle_time(trace)
    unobserved = (
        ()
        if seen is None
        else tuple(name for name, there in zip(JOINTS, seen, strict=True) if not there)
    )
    return Run(
        problem=problem.name,
        title=problem.title or problem.name,
        body=follower.response.body,
        joints=problem.joints,
        dt=problem.dt,
        seed=int(seed),
        time=np.array(trace.time),
        postures=postures,
        base_poses=np.array(trace.base_poses),
        poses=np.array(trace.poses),
        twists=np.array(trace.twists),
        reba=scores,
        cost=np.array([step.cost for step in trace.steps]),
        statuses=[step.status for step in trace.steps],
        reasons=[step.reason for step in trace.steps],
        active=[step.active for step in trace.steps],
        step_time=np.array(trace.step_time),
        assessment=problem.assess(postures[[0, -1]]),
        violations=dict(checker.violations),
        max_violation=dict(checker.max_violation),
        units=dict(checker.units),
        person_outside=outside_of_range(postures),
        let_go=trace.let_go,
        options=options_of(problem, _SOLVER),
        assumptions=[
            *assumptions,
            *beyond,
            *_assumptions(model, follower, senses, unobserved, place),
            *_robot(problem, robot),
        ],
        recording=None if recording is None else str(recording),
        start_time=start_time,
        unobserved=unobserved,
        reba_standing_still=_standing_still(problem, follower, start),
        settle=settled if math.isfinite(settled) else None,
        guide=place,
    )


class _Watched(Checker):
    """The checker sees every step, so it is what can say how far the loop is."""

    def __init__(self, problem: Problem, progress: Progress | None, steps: int) -> None:
        super().__init__(problem)
        self._progress, self._steps, self._done = progress, steps, 0
        self._every = max(1, steps // 100)

    def check(self, *args: Any, **kwargs: Any) -> list[str]:
        """Judge one step, and say how far the loop is."""
        self._done += 1
        if self._progress is not None and self._done % self._every == 0:
            self._progress(self._done / self._steps)
        return super().check(*args, **kwargs)


def _standing_still(problem: Problem, person: Follower, start: Start) -> int:
    """Return the exact score of the person's rest posture with the object left where it is."""
    posture, _ = person.settle(start.posture, start.pose, start.grasp, start.soles)
    return int(problem.assess(posture).final[0])


def check_numbers(problem: Problem, duration: float, seed: int) -> None:
    """Check what can be checked before anything is computed.

    Raises:
        InputError: for a duration or a seed that no run can have.
    """
    check_number("duration", duration, problem.dt, LONGEST, "s")
    check_whole("seed", seed, 0)


def read_posture(posture: ArrayLike) -> tuple[np.ndarray, list[str]]:
    """Return a posture (32,) [rad] within the joints' ranges, and a sentence if it was not.

    Raises:
        InputError: if it is not one.
    """
    try:
        angles = table_of_numbers("posture", posture)
    except InputError:
        raise InputError(
            f"posture: got {type(posture).__name__}, allowed {len(JOINTS)} angles in radians"
        ) from None
    if angles.shape != (len(JOINTS),):
        raise InputError(
            f"posture: got shape {angles.shape}, allowed ({len(JOINTS)},), in the order of"
            " ergoqp.JOINTS"
        )
    wrong = np.flatnonzero(~(np.abs(angles) <= np.pi))
    if wrong.size:
        raise InputError(
            f"posture: got {angles[wrong[0]]:g} for {JOINTS[wrong[0]]}, allowed radians within ±π"
            " (degrees given as radians?)"
        )
    inside = np.clip(angles, LOWER, UPPER)
    beyond = [spoken(JOINTS[i]) for i in np.flatnonzero(np.abs(angles - inside) > _AT_END)]
    if not beyond:
        return inside, []
    return inside, [
        f"The start is beyond the range of {', '.join(beyond)}; the person starts at its end."
    ]


def _read_observed(observed: ArrayLike | None) -> np.ndarray | None:
    if observed is None:
        return None
    try:
        seen = unmasked(observed)
        if seen.shape == (len(JOINTS),) and seen.dtype == bool:
            return seen
    except Exception:  # not an array, whatever it is
        pass
    raise InputError(f"observed: got {shown(observed)}, allowed bool of shape ({len(JOINTS)},)")


def _robot(problem: Problem, robot: RobotKind | None) -> list[str]:
    """What is declared of the robot, and what it does."""
    declared = _told(problem.robot)
    does = _told(robot) if robot is not None else ""
    return [
        (
            f"The controller is told of the robot: {declared}."
            if declared
            else (
                "The controller is told nothing of the robot: it reckons with one that does at once"
                " what it is sent."
            )
        ),
        "The simulated robot "
        + (
            "does exactly that."
            if robot is None and not declared
            else "is as bad as that."
            if robot is None
            else f"has {does}."
        ),
    ]


def _told(robot: DeclaredRobot | RobotKind) -> str:
    """A robot in words; what is as in a perfect one is left out."""
    perfect, words = type(robot)(), []
    for entry in fields(robot):
        value = getattr(robot, entry.name)
        if value == getattr(perfect, entry.name):
            continue
        name = entry.name.removesuffix("_deg").replace("_", " ")
        if entry.name.endswith("_deg"):
            words.append(f"{name} {value:g} deg")
        elif entry.name == "pose_noise":
            words.append(f"{name} {1e3 * value:g} mm")
        elif entry.name in ("gain_error", "speed_noise"):
            words.append(f"{name} {100 * value:g} %")
        else:
            words.append(
                f"{name} {value:g}" if entry.name == "gain" else f"{name} {1e3 * value:g} ms"
            )
    return ", ".join(words)


def _assumptions(
    model: IkResponse,
    person: Follower,
    senses: Senses,
    unobserved: tuple[str, ...],
    place: Guide | None,
) -> list[str]:
    own = person.response.body
    sentences = [
        (
            f"The person is simulated: {own.stature:.2f} m tall, with joint weights, delay"
            f" ({1e3 * senses.delay:.0f} ms) and measurement noise ({senses.noise_deg:g} deg white,"
            f" {senses.drift_deg:g} deg drift, {100 * senses.lost:g} % of the frames lost) that the"
            " controller does not know."
        ),
        f"The controller reckons with its own nominal person of {model.body.stature:.2f} m.",
        (
            "The hand holds the object at the start as the posture has it, and keeps hold of it;"
            f" {person.response.footing}."
        ),
    ]
    if place is not None:
        x, y, z = place.pose[:3, 3]
        sentences.append(
            f"The control step is given the place ({x:.2f}, {y:.2f}, {z:.2f}) m, to be drawn there"
            " where descent alone comes to rest at a worse one."
        )
    if senses.bias_deg:
        wrong = ", ".join(
            f"{spoken(name)} by {error:+g} deg" for name, error in senses.bias_deg.items()
        )
        sentences.append(
            f"The sensors read wrong all the time, and the controller does not know: {wrong}."
        )
    if unobserved:
        sentences.append(
            f"The controller does not see {', '.join(map(spoken, unobserved))}; the simulated"
            f" person starts with {'it' if len(unobserved) == 1 else 'them'} as given in the start."
        )
    return sentences
