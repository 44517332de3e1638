"""The reason of a step: one sentence that names the cause."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from ergoqp.joints import JOINTS, spoken
from ergoqp.limits import Limit
from ergoqp.problem.problem import Problem
from ergoqp.problem.robot import DeclaredRobot
from ergoqp.step.answer.account import Account
from ergoqp.step.answer.amiss import AHEAD, PARTS
from ergoqp.step.answer.causes import Cause, Status
from ergoqp.step.frames_check import frames_sentence
from ergoqp.step.guide.trial import BACK, LOOK, THERE
from ergoqp.step.program.bounds import limit_values
from ergoqp.step.robot_watch.faults import fault_sentence
from ergoqp.step.under_way.history import CLOCK_ROUNDING, LONGEST_DT, SHORTEST_DT

_DRAWN: Final = {
    THERE: "drawn toward the given place",
    LOOK: "at the given place, waiting for the person",
    BACK: "drawn back to where it was better than at the given place",
}


def reason_of(
    problem: Problem,
    account: Account,
    posture: np.ndarray,
    dt: float,
    age: float,
    notes: Mapping[str, str],
) -> str:
    """Return the reason of a step; empty for a plain optimal step.

    Args:
        problem: the task.
        account: account of the step.
        posture: posture as given (32,) [rad].
        dt: period as given [s].
        age: age as given [s].
        notes: what was wrong with inputs before they became numbers, by their name.
    """
    log = [notes[name] for name in ("late", "log") if name in notes]
    status, margins = Status[account.status], account("margins")
    causes = [cause for cause in Cause if int(account("causes")[0]) >> cause & 1]
    if Cause.asked in causes:
        causes = [cause for cause in causes if cause is not Cause.no_frame]
    if status >= Status.braking:
        said = [_cause(problem, cause, account, posture, dt, age, notes) for cause in causes]
        return "; ".join([*said, *log])
    parts = []
    names = problem.row_names
    limits = [limit for limit in problem.row_limits for _ in limit.names]

    def beyond(row: int) -> str:
        return _beyond(limits[row], names[row], margins[row])

    outside = np.flatnonzero(account("outside") > 0.5).tolist()
    if usual := [beyond(i) for i in outside if not hasattr(limits[i], "breach")]:
        parts.append("outside, coming back: " + ", ".join(usual))
    if called := [beyond(i) for i in outside if hasattr(limits[i], "breach")]:
        parts.append(", ".join(called) + ", coming back")
    if status == Status.relaxed:
        # Those of the object do not: the certification is exact there.
        soft = [not limit.hard for limit in limits]
        used = [names[i] for i in np.flatnonzero((account("slack") > 1e-6) & soft)]
        parts.append(
            "braking alone would pass these limits, so they give way: "
            + ", ".join(map(spoken, used))
        )
    if account.drawn:
        parts.append(_DRAWN[account.drawn])
    if "guide" in notes:
        parts.append(notes["guide"])
    if status == Status.settled and not account.drawn:
        parts.append("at rest: moving would gain too little")
    tolerance, returns = (
        limit_values(problem.row_limits, name) for name in ("tolerance", "returns")
    )
    hard = limit_values(problem.row_limits, "hard")
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
        elif returns[i]:
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
    cause: Cause,
    account: Account,
    posture: np.ndarray,
    dt: float,
    age: float,
    notes: Mapping[str, str],
) -> str:
    if cause is Cause.posture:
        return notes.get("posture") or notes.get("observed") or _bad_posture(problem, posture)
    if cause is Cause.pose:
        return notes.get(
            "pose", "pose is not finite, over 100 m away or not a rigid motion: is it in m?"
        )
    if cause is Cause.twist:
        return notes.get("twist", "twist is not finite or huge")
    if cause is Cause.disabled:
        return notes.get("enable", "not enabled")
    if cause is Cause.frames:
        return frames_sentence(problem, account("frames"))
    if cause is Cause.robot:
        kind, amount = account("fault").tolist()
        return fault_sentence(int(kind), amount)
    if cause is Cause.asked:
        return notes.get("deadline", "asked to brake")
    if cause is Cause.term:
        return notes.get("term") or _no_number(problem, account)
    if cause is Cause.dt and "dt" in notes:
        return notes["dt"]
    if cause is Cause.age and "age" in notes:
        return notes["age"]
    return {
        Cause.dt: f"dt is {dt:g} s, allowed {SHORTEST_DT:g} to {LONGEST_DT:g} s",
        Cause.age: (
            f"age is {age:g} s, allowed at least 0 (a stamp up to {1e3 * CLOCK_ROUNDING:g} ms ahead"
            " counts as 0)"
        ),
        Cause.no_frame: "no posture arrived",
        Cause.too_old: f"the posture is {age:.4g} s old, allowed {problem.control.max_age:.3f} s",
        Cause.not_solved: f"the QP was not solved: residual {account.residuals['qp']:.1e}",
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
    found = [
        f"{getattr(limit, 'breach', 'outside')} {name}"
        for limit, name, margin in zip(
            (limit for limit in problem.row_limits for _ in limit.names),
            problem.row_names,
            margins,
            strict=True,
        )
        if limit.hard and margin < -limit.tolerance
    ]
    return (
        f"the object is {' and '.join(found)}, and none of the straight ways that are tried leads"
        " from there to a place where all limits hold: it rests until it is moved by hand"
    )


def _no_number(problem: Problem, account: Account) -> str:
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
    if called := getattr(limit, "breach", ""):
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
