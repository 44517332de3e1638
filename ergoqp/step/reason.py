"""The reason of a step in words: why it brakes, what is outside, what gives way."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from ergoqp.joints import JOINTS, spoken
from ergoqp.limits import Limit
from ergoqp.problem.problem import Problem
from ergoqp.problem.settings import DeclaredRobot
from ergoqp.step.causes import Cause, Status, fault_sentence
from ergoqp.step.certification import AHEAD, PARTS
from ergoqp.step.frames_check import frames_sentence
from ergoqp.step.layout import CLOCK_ROUNDING, LONGEST_DT, SHORTEST_DT
from ergoqp.step.rest import BACK, LOOK, THERE
from ergoqp.step.rows import limit_values

_DRAWN: Final = {
    THERE: "drawn toward the given place",
    LOOK: "at the given place, waiting for the person",
    BACK: "drawn back to where it was better than at the given place",
}


def reason_of(
    problem: Problem,
    account: Callable[[str], np.ndarray],
    status: Status,
    drawn: int,
    seen: tuple[np.ndarray, float, float],
    notes: Mapping[str, str],
) -> str:
    """Return the reason of a step; empty for a plain optimal step.

    Args:
        problem: the problem of the step.
        account: returns an output of the step function, by its name.
        status: status of the step.
        drawn: phase of `ergoqp.step.rest` in which the guide leads; else 0.
        seen: posture, period and age that the step was given.
        notes: what was wrong with inputs before they became numbers, by their name.
    """
    log = [notes[name] for name in ("late", "log") if name in notes]
    margins = account("margins")
    causes = [cause for cause in Cause if int(account("causes")[0]) >> cause & 1]
    if Cause.asked in causes:
        causes = [cause for cause in causes if cause is not Cause.no_frame]
    if status >= Status.braking:
        return "; ".join(
            [*(_cause(problem, account, seen, cause, notes) for cause in causes), *log]
        )
    parts = []
    names = problem.row_names
    limits = [limit for limit in problem.row_limits for _ in limit.names]

    def beyond(row: int) -> str:
        return _beyond(limits[row], names[row], margins[row])

    outside = np.flatnonzero(account("outside") > 0.5).tolist()
    if usual := [beyond(i) for i in outside if not hasattr(limits[i], "violation_label")]:
        parts.append("outside, coming back: " + ", ".join(usual))
    if called := [beyond(i) for i in outside if hasattr(limits[i], "violation_label")]:
        parts.append(", ".join(called) + ", coming back")
    if status == Status.relaxed:
        # Those of the object do not: the certification is exact there.
        soft = [not limit.hard for limit in limits]
        used = [names[i] for i in np.flatnonzero((account("slack") > 1e-6) & soft)]
        names_used = ", ".join(map(spoken, used))
        parts.append(f"braking alone would pass these limits, so they give way: {names_used}")
    if drawn:
        parts.append(_DRAWN[drawn])
    if "guide" in notes:
        parts.append(notes["guide"])
    if status == Status.settled and not drawn:
        parts.append("at rest: moving would gain too little")
    tolerance, recovers, hard = (
        limit_values(problem.row_limits, name) for name in ("tolerance", "recovers", "hard")
    )
    for i in np.flatnonzero(margins < -tolerance).tolist():
        if i in outside:
            continue
        if hard[i]:
            beside, noise = -margins[i] - tolerance[i], _noise(problem, names[i])
            astray = account("astray")[6 if limits[i].unit == "rad" else slice(0, 6)].max()
            if beside <= noise:
                why = "within the declared noise of the pose"
            elif beside <= noise + astray:
                why = "within what is not known of the pose"
            else:
                why = "and the object cannot move it"
        elif recovers[i]:
            why = "and did not come back in twice the time that this should take: given up"
        else:
            parts.append(_held(names[i], margins[i]))
            continue
        parts.append(f"{beyond(i)}, {why}")
    if doubt := frames_sentence(problem, account("frames")):
        parts.append(doubt)
    return "; ".join([*parts, *log])


def _noise(problem: Problem, name: str) -> float:
    """Declared noise of the pose for a row of the object."""
    robot = problem.robot
    return float(np.radians(robot.pose_noise_deg)) if name == "tool axis" else robot.pose_noise


def _cause(
    problem: Problem,
    account: Callable[[str], np.ndarray],
    seen: tuple[np.ndarray, float, float],
    cause: Cause,
    notes: Mapping[str, str],
) -> str:
    posture, dt, age = seen
    noted = {Cause.disabled: "enable", Cause.asked: "deadline"}.get(cause, cause.name)
    if cause is Cause.posture and "posture" not in notes:
        noted = "observed"
    if noted in notes:
        return notes[noted]
    kind, amount = account("fault").tolist()
    return {
        Cause.posture: _bad_posture(problem, posture),
        Cause.pose: "pose is not finite, over 100 m away or not a rigid motion: is it in m?",
        Cause.twist: "twist is not finite or huge",
        Cause.disabled: "not enabled",
        Cause.frames: frames_sentence(problem, account("frames")),
        Cause.robot: fault_sentence(int(kind), amount),
        Cause.asked: "asked to brake",
        Cause.term: _no_number(problem, account),
        Cause.dt: f"dt is {dt:g} s, allowed {SHORTEST_DT:g} to {LONGEST_DT:g} s",
        Cause.age: (
            f"age is {age:g} s, allowed at least 0 (a stamp up to {1e3 * CLOCK_ROUNDING:g} ms ahead"
            " counts as 0)"
        ),
        Cause.no_frame: "no posture arrived",
        Cause.too_old: f"the posture is {age:.4g} s old, allowed {problem.control.max_age:.3f} s",
        Cause.not_solved: f"the QP was not solved: residual {account('residuals')[0]:.1e}",
        Cause.not_certified: "no twist but braking keeps every limit through the stop",
        Cause.unmeasured: f"no pose, and the robot is declared to {_unmeasured(problem.robot)}",
        Cause.halted: "comes to rest before it moves again",
        Cause.latched: (
            "at rest after a fault of the robot, until a pose is measured or try_again() is called"
        ),
        Cause.long_period: (
            f"dt is {dt:g} s, allowed {problem.longest_period:g} s: three periods, or "
            "the longest hold of the robot"
        ),
        Cause.no_way_out: _no_way_out(problem, account("margins")),
        Cause.short_periods: (
            f"the last periods were much shorter than the loop's {problem.dt:g} s: "
            "give the stepper its own dt"
        ),
    }[cause]


def _no_way_out(problem: Problem, margins: np.ndarray) -> str:
    """Return where the object is that no straight way leads out of."""
    limits = (limit for limit in problem.row_limits for _ in limit.names)
    found = [
        f"{getattr(limit, 'violation_label', 'outside')} {name}"
        for limit, name, margin in zip(limits, problem.row_names, margins, strict=True)
        if limit.hard and margin < -limit.tolerance
    ]
    return (
        f"the object is {' and '.join(found)}, and none of the straight ways that are tried leads"
        " from there to a place where all limits hold: it rests until it is moved by hand"
    )


def _no_number(problem: Problem, account: Callable[[str], np.ndarray]) -> str:
    """Return which terms gave no usable number."""
    if not account("pose_used")[-1]:
        return "response: got a contact that is no rigid pose, allowed one within 100 m"
    flags = account("amiss") > 0.5
    said: dict[str, str] = {}
    for (term, part), wrong in zip(PARTS, flags, strict=False):
        # Without a sensitivity, nothing that follows from it is a number either.
        if wrong and not ("response" in said and part == AHEAD):
            of = f" of {problem.cost.name}" if term == "cost" else ""
            found = f"{term}: got {part}{of} that is NaN or infinite, allowed finite numbers"
            said.setdefault(term, found)
    rows = np.flatnonzero(flags[len(PARTS) :]).tolist()
    if rows and "response" not in said:
        names = ", ".join(spoken(problem.row_names[row]) for row in rows)
        said["limits"] = f"limits: got NaN in rows or margins of {names}, allowed numbers"
    return "; ".join(said.values())


def _unmeasured(robot: DeclaredRobot) -> str:
    """Return what a robot may do that only a measured pose shows."""
    said = []
    if robot.gain_error:
        share = f"{100 * robot.gain_error:g}"
        said.append(f"move by up to {share} % more or less than what it is sent")
    if robot.longest_hold:
        said.append(f"hold on for up to {robot.longest_hold:g} s")
    return ", and to ".join(said)


def _bad_posture(problem: Problem, posture: np.ndarray) -> str:
    largest = problem.response.largest
    wrong = np.flatnonzero(~(np.abs(posture) <= largest))
    if not wrong.size:
        return "posture is not usable"
    first = int(wrong[0])
    others = f" and {wrong.size - 1} more" if wrong.size > 1 else ""
    unit = "radians" if problem.coordinates == JOINTS else "numbers"
    name = spoken(problem.coordinates[first])
    return (
        f"posture: {name}{others} is {posture[first]:g}, allowed finite {unit} within"
        f" +-{largest:.5g}"
    )


def _beyond(limit: Limit, name: str, margin: float) -> str:
    if called := getattr(limit, "violation_label", ""):
        return f"{called} {name} by {-margin:.3g} {limit.unit}"
    if name in JOINTS:
        return f"{spoken(name)} by {np.degrees(-margin):.1f} deg"
    return f"{name} by {-margin:.3g}"


def _held(name: str, margin: float) -> str:
    """Return that a row was measured beyond its limit and is held there."""
    if name in JOINTS:
        beyond = f"{np.degrees(-margin):.1f} deg beyond its range"
        return f"{spoken(name)} measured {beyond}, held at the end of the range"
    return f"{name} measured {-margin:.3g} beyond its limit, held at the limit"
