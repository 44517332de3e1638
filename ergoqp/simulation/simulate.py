"""A complete closed loop: a problem and a simulated person; the result is a `Run`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ergoqp.arguments import Progress, check_called, check_kind, check_number, check_word, sentences
from ergoqp.errors import InputError
from ergoqp.human import Body
from ergoqp.joints import JOINTS
from ergoqp.problem.problem import Problem
from ergoqp.rest.model_person import person_of
from ergoqp.rest.person_protocol import (
    Holding,
    Person,
    SensorModel,
    read_observed,
    read_posture,
    stood_otherwise,
)
from ergoqp.seeking.seeker import Seeker
from ergoqp.simulation.check import Checker
from ergoqp.simulation.description import about_person, about_robot, options_of
from ergoqp.simulation.loop import (
    check_numbers,
    in_world,
    outside_of_range,
    run_loop,
    settle_time,
    with_own_robot,
)
from ergoqp.simulation.people import kinds, person_of_kind
from ergoqp.simulation.robot import RobotKind
from ergoqp.simulation.run import Run
from ergoqp.step.guide import read_guide
from ergoqp.step.stepper import Stepper

_SOLVER = "daqp"


def simulate(
    problem: Problem,
    posture: ArrayLike | Holding,
    duration: float = 20.0,
    seed: int = 0,
    *,
    person: Person | Body | None = None,
    follower: str | None = None,
    observed: ArrayLike | None = None,
    recording: str | Path | None = None,
    start_time: float | None = None,
    assumptions: Sequence[str] = (),
    progress: Progress | None = None,
    guide: Any = None,
    seek: Sequence[Any] | None = None,
    robot: RobotKind | None = None,
    senses: SensorModel | None = None,
) -> Run:
    """Run a closed loop of a problem with a simulated person unlike the controller's model.

    Args:
        problem: the task; its response must be an `IkResponse`.
        posture: posture in which the person starts, holding the object (32,) [rad]; or a
            person who holds it already. The latter is not changed.
        duration: duration of the loop [s].
        seed: seed of the person, of noise and of lost frames.
        person: who follows, or their body; None: drawn with the seed.
        follower: kind of the person who is drawn, one of `ergoqp.simulation.people.kinds`;
            None: ``"alike"``.
        observed: (32,) bool, False for joints that the controller does not see; None: all are
            seen.
        recording: name of the recording of the posture, for the report.
        start_time: time of the posture in the recording [s].
        assumptions: sentences on earlier assumptions, for the report.
        progress: called from time to time with the share that is done.
        guide: a better place, to which the object travels where descent comes to rest: the
            optimum of `ergoqp.optimise` or a pose (4, 4), see
            `ergoqp.step.guide.read_guide`; None: descent only.
        seek: places that the loop tries after descent; it keeps the one with the lowest
            measured score, see `ergoqp.Seeker`; None: no places are tried. It cannot be
            combined with a guide.
        robot: how the robot executes the sent twist; None: with the errors that the problem
            declares. If the simulation of the person has a robot of its own, it comes after.
        senses: sensors between person and controller, including constant errors of angles;
            None: those of the person.

    Returns:
        Everything that happened, checked by the independent checker.

    Raises:
        InputError: if an argument is not usable; the message names it.

    Example:
        >>> import ergoqp
        >>> problem = ergoqp.load_problem("screwing")
        >>> posture = problem.response.comfort
        >>> run = ergoqp.simulate(problem, posture, duration=0.2)
        >>> run.twists.shape, sum(run.violations.values())
        ((20, 6), 0)
    """
    check_kind("problem", problem, Problem, "a Problem, such as ergoqp.load_problem gives")
    check_numbers(problem, duration, seed)
    none = type(None)
    for what, value, kind, allowed in (
        ("person", person, (Person, Body, none), "a Person, a Body or None"),
        ("robot", robot, (RobotKind, none), "a RobotKind or None"),
        ("senses", senses, (SensorModel, none), "SensorModel or None"),
        ("recording", recording, (str, Path, none), "the name of a recording or None"),
    ):
        check_kind(what, value, kind, allowed)
    if start_time is not None:
        check_number("start_time", start_time, -1e9, 1e9, "s")
    check_called("progress", progress, "a function of the share that is done")
    assumptions = sentences("assumptions", assumptions)
    model = person_of(problem)
    seen = read_observed(observed)
    if follower is not None:
        check_word("follower", follower, kinds())
    if isinstance(posture, Holding):
        for what, value in (("person", person), ("follower", follower), ("senses", senses)):
            if value is not None:
                raise InputError(
                    f"{what}: got one beside a person who holds the object already, allowed none"
                )
        start, beyond = posture.copy(), []
    else:
        start_posture, beyond = read_posture(posture)
        if not isinstance(person, Person):
            person = person_of_kind(follower or "alike", problem, seed, person)
        elif follower not in (None, person.kind):
            raise InputError(f"follower: got {follower!r}, but the person given is {person.kind!r}")
        start = person.hold(start_posture, senses, seed)
        beyond += stood_otherwise(start_posture, start.posture)
    who = start.person
    problem, robot = with_own_robot(in_world(problem), who, robot, seed)
    unmoved = start.copy()
    unmoved.rest(unmoved.pose)
    checker, steps = Checker(problem), round(duration / problem.dt)

    def tell(now: float, _: Holding) -> bool:
        done = round(now / problem.dt)
        if progress is not None and done % max(1, steps // 100) == 0:
            progress(done / steps)
        return False

    place = None if guide is None else read_guide(problem, guide)
    if seek is not None and place is not None:
        raise InputError("seek: got places beside a guide, allowed one of the two")
    terms: dict[str, Any] = {"solver": _SOLVER, "compiled": "auto"}
    stepper = Stepper(problem, guide=place, **terms) if seek is None else None
    seeker = None if seek is None else Seeker(problem, seek, patient=True, **terms)
    trace = run_loop(
        problem,
        start,
        duration=duration,
        seed=seed,
        controller=stepper or seeker,
        observed=seen,
        checker=checker,
        robot=robot,
        beside=tell,
    )
    postures = np.array(trace.postures)
    scores = problem.assess(postures).final
    settled = settle_time(trace)
    unobserved = () if seen is None else tuple(JOINTS[j] for j in np.flatnonzero(~seen))
    return Run(
        problem=problem.name,
        title=problem.title or problem.name,
        body=who.body,
        follower=who.kind,
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
        forces=np.array(trace.forces),
        slips=trace.slips[-1],
        fell=trace.fell,
        unbalanced=float(np.mean(trace.unbalanced)),
        options=options_of(problem, _SOLVER),
        assumptions=[
            *assumptions,
            *beyond,
            *about_person(model, who, start.senses, unobserved, place),
            *about_robot(problem, robot, who),
        ],
        recording=None if recording is None else str(recording),
        start_time=start_time,
        unobserved=unobserved,
        reba_standing_still=int(problem.assess(unmoved.posture).final[0]),
        settle=settled if math.isfinite(settled) else None,
        guide=place,
        tries=() if seeker is None else tuple(seeker.account),
    )
