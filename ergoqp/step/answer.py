"""The answer of a step: the twist, its account, and the reason in words."""

from __future__ import annotations

import time
from collections.abc import Mapping
from functools import cached_property
from typing import Final

import casadi as ca
import numpy as np

from ergoqp.expressions import call_by_name, is_set, largest
from ergoqp.joints import JOINTS, spoken
from ergoqp.limits import Limit, LimitContext
from ergoqp.problem.problem import Problem
from ergoqp.problem.settings import DeclaredRobot
from ergoqp.solvers.solver import FREE
from ergoqp.step.causes import Cause, Status, fault_sentence
from ergoqp.step.certification import AHEAD, PARTS, Margins
from ergoqp.step.frames_check import frames_sentence
from ergoqp.step.layout import CLOCK_ROUNDING, LONGEST_DT, SHORTEST_DT
from ergoqp.step.model import StepModel
from ergoqp.step.qp import TOLERANCE
from ergoqp.step.rest import BACK, LOOK, THERE
from ergoqp.step.rows import limit_values

_DRAWN: Final = {
    THERE: "drawn toward the given place",
    LOOK: "at the given place, waiting for the person",
    BACK: "drawn back to where it was better than at the given place",
}


def reason_of(step: Step, notes: Mapping[str, str]) -> str:
    """Return the reason of a step; empty for a plain optimal step.

    Args:
        step: the step.
        notes: what was wrong with inputs before they became numbers, by their name.
    """
    problem, account = step._problem, step.account
    log = [notes[name] for name in ("late", "log") if name in notes]
    status, margins = Status[step.status], account("margins")
    causes = [cause for cause in Cause if int(account("causes")[0]) >> cause & 1]
    if Cause.asked in causes:
        causes = [cause for cause in causes if cause is not Cause.no_frame]
    if status >= Status.braking:
        return "; ".join([*(_cause(step, cause, notes) for cause in causes), *log])
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
    if step.drawn:
        parts.append(_DRAWN[step.drawn])
    if "guide" in notes:
        parts.append(notes["guide"])
    if status == Status.settled and not step.drawn:
        parts.append("at rest: moving would gain too little")
    tolerance, recovers = (
        limit_values(problem.row_limits, name) for name in ("tolerance", "recovers")
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


def _cause(step: Step, cause: Cause, notes: Mapping[str, str]) -> str:
    problem, (posture, dt, age) = step._problem, step._seen
    noted = {Cause.disabled: "enable", Cause.asked: "deadline"}.get(cause, cause.name)
    if cause is Cause.posture and "posture" not in notes:
        noted = "observed"
    if noted in notes:
        return notes[noted]
    kind, amount = step.account("fault").tolist()
    return {
        Cause.posture: _bad_posture(problem, posture),
        Cause.pose: "pose is not finite, over 100 m away or not a rigid motion: is it in m?",
        Cause.twist: "twist is not finite or huge",
        Cause.disabled: "not enabled",
        Cause.frames: frames_sentence(problem, step.account("frames")),
        Cause.robot: fault_sentence(int(kind), amount),
        Cause.asked: "asked to brake",
        Cause.term: _no_number(step),
        Cause.dt: f"dt is {dt:g} s, allowed {SHORTEST_DT:g} to {LONGEST_DT:g} s",
        Cause.age: (
            f"age is {age:g} s, allowed at least 0 (a stamp up to {1e3 * CLOCK_ROUNDING:g} ms ahead"
            " counts as 0)"
        ),
        Cause.no_frame: "no posture arrived",
        Cause.too_old: f"the posture is {age:.4g} s old, allowed {problem.control.max_age:.3f} s",
        Cause.not_solved: f"the QP was not solved: residual {step.residuals['qp']:.1e}",
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
        Cause.no_way_out: _no_way_out(problem, step.account("margins")),
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


def _no_number(step: Step) -> str:
    """Return which terms gave no usable number."""
    problem, account = step._problem, step.account
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


class Step:
    """The answer of one control step.

    Attributes:
        twist: twist to send: velocity of the object at the contact frame, world-aligned, linear
            first (6,) [m/s, rad/s].
        status: ``optimal``, ``settled``, ``relaxed``, ``recovering``, ``braking`` or ``invalid``.
        solve_time: duration of the call [s].

    Example:
        >>> import ergoqp
        >>> problem = ergoqp.load_problem("screwing")
        >>> step = ergoqp.Stepper(problem).step(problem.response.comfort)
        >>> step.status, step.posture_rate.shape
        ('optimal', (32,))
        >>> round(step.margins["workspace z"], 2)
        0.37
        >>> step.reason
        ''
    """

    def __init__(
        self,
        twist: np.ndarray,
        status: str,
        problem: Problem,
        account: np.ndarray,
        parts: Mapping[str, slice],
        seen: tuple[np.ndarray, float, float],
        notes: Mapping[str, str],
        start: float,
    ) -> None:
        """Keep the outputs of the step function; the members are read from them on demand."""
        self.twist, self.status = twist, status
        self._problem, self._values, self._parts = problem, account, parts
        self._seen, self._notes = seen, notes
        self.solve_time = time.perf_counter() - start

    def __repr__(self) -> str:
        """Show twist, status and reason."""
        twist = np.array2string(self.twist, precision=4, suppress_small=True)
        return f"Step(twist={twist}, status={self.status!r}, reason={self.reason!r})"

    def account(self, name: str) -> np.ndarray:
        """Return an output (k,) of the step function, by its name.

        The names are those of `ergoqp.step.function.OUTPUTS`.
        """
        return self._values[self._parts[name]]

    @property
    def pose(self) -> np.ndarray:
        """Contact frame in the world that the step used (4, 4) [m]."""
        return self.account("pose_used").reshape(4, 4).T

    @property
    def posture_rate(self) -> np.ndarray:
        """How the model person follows (32,) [rad/s], or the rate of another state."""
        return self.account("posture_rate")

    @property
    def cost(self) -> float:
        """V of the posture [points]."""
        return float(self.account("cost")[0])

    @property
    def gain(self) -> float:
        """Predicted improvement within one second at full speed, comfort included [points]."""
        return float(self.account("gain")[0])

    @property
    def residuals(self) -> dict[str, float]:
        """Residuals of the step by name: ``qp``, ``contact`` and ``accepted``.

        ``qp`` is the largest KKT residual. ``contact`` is the contact motion that the posture
        cannot follow [m/s, rad/s]. ``accepted`` is the certified share of the way from braking to
        the QP's answer.
        """
        qp, contact, accepted = self.account("residuals").tolist()
        return {"qp": qp, "contact": contact, "accepted": accepted}

    @property
    def drawn(self) -> int:
        """Phase of `ergoqp.step.rest` in which the guide leads; else 0.

        The guide leads on the way to the place, during the wait there, and on the way back.
        """
        return int(self.account("drawn")[0]) if "drawn" in self._parts else 0

    @cached_property
    def reason(self) -> str:
        """One sentence that names the cause; empty for a plain optimal step."""
        _, dt, _ = self._seen
        notes = self._notes
        if "slow" in notes and self.solve_time > dt:
            late = f"the step took {1e3 * self.solve_time:.3g} ms of its period of {1e3 * dt:g} ms"
            notes = {**notes, "late": f"{late}; the slowest term is {notes['slow']}"}
        return reason_of(self, notes)

    @cached_property
    def margins(self) -> dict[str, float]:
        """Distance of every row to its nearer end, negative outside, in the unit of the row."""
        return dict(zip(self._problem.row_names, self.account("margins").tolist(), strict=True))

    @cached_property
    def slack(self) -> dict[str, float]:
        """By how much the QP missed a row, in its unit per second; only missed rows.

        Of a row of the object it only means that coming back was asked for faster than possible.
        """
        values = self.account("slack").tolist()
        return {
            name: value
            for name, value in zip(self._problem.row_names, values, strict=True)
            if value > 1e-7
        }

    @cached_property
    def active(self) -> tuple[str, ...]:
        """Names of the rows that hold the object back, and of the joints that yield."""
        pushing = np.abs(self.account("multipliers")) > 1e-6
        rows = [name for name, push in zip(self._problem.row_names, pushing, strict=True) if push]
        return (*rows, *(joint for joint in self.locked if joint not in rows))

    @cached_property
    def locked(self) -> tuple[str, ...]:
        """Joints at their end that the model person holds still while the others follow."""
        return tuple(
            self._problem.coordinates[i] for i in np.flatnonzero(self.account("locked") > 0.5)
        )


def account_function(model: StepModel) -> ca.Function:
    """Return the twist that is sent, and its account.

    Returns:
        Function ``(...) -> (planned, twist, still, posture_rate, status, all_causes, all_slack,
        all_multipliers, residuals)``; slack and multipliers are those of all rows (r,).
    """
    problem, movable = model.problem, model.movable
    signals, count = model.symbols(kind=ca.MX), len(problem.row_names)
    limits, now = problem.row_limits, signals["now"]
    margins = Margins(model, signals)
    tolerance, soft = ca.DM(model.values("tolerance")), ca.DM(1 - model.values("hard"))
    # Slack of a row on the object side only means that the QP asked for more than needed, because
    # the certification is exact there.
    held = now[movable, 0] >= -tolerance[movable, 0]
    used = largest(soft[movable, 0] * signals["slack"] * held) > 10 * TOLERANCE
    any_outside = largest(signals["outside"])
    found = call_by_name(_close_function(model), signals, used=used, any_outside=any_outside)
    twist = found["twist"]
    rate = _model_rate(limits, margins.context, signals["S"] @ twist, signals["dt"])
    slack, multipliers = (
        _spread(signals[name], movable, count) for name in ("slack", "multipliers")
    )
    # A twist that is shortened toward braking may exceed a rate that braking exceeds too. This row
    # has given way as well, and is named.
    slack = ca.fmax(slack, _rate_excess(margins, twist)) if len(limits) else slack
    found |= {"posture_rate": rate, "all_slack": slack, "all_multipliers": multipliers}
    return signals.function("account", found)


def _close_function(model: StepModel) -> ca.Function:
    """Return the function for the planned twist, the sent twist, and the status of the step."""
    problem, sx = model.problem, model.symbols()
    share = largest(sx["share"])
    fits = ca.logic_and(sx["solved"], ca.logic_not(sx["unusable"]))
    accepted = ca.logic_and(ca.logic_and(sx["usable"], fits), share > 0)
    planned = sx["brake"] + ca.if_else(accepted, sx["share"], 0) * (sx["wanted"] - sx["brake"])
    if problem.surface is not None:
        mending = ca.DM(problem.twist_limit.acceleration) * sx["usable"]
        planned = problem.surface.retract(sx["posture"], planned, sx["dt"], mending)
    sent = planned
    if problem.average:
        # A mean keeps the acceleration by itself while the history is long enough.
        change = ca.DM(problem.twist_limit.acceleration) * sx["dt"]
        mean = sx["begun"] + sx["own"] * planned
        sent = ca.fmin(ca.fmax(mean, sx["sent"] - change), sx["sent"] + change)
    certified = 2.0**Cause.not_certified * (share <= 0)
    failed = ca.if_else(sx["solved"], certified, 2.0**Cause.not_solved)
    failed = ca.if_else(sx["unusable"], 2.0**Cause.term, failed)
    causes = sx["causes"] + ca.if_else(sx["usable"], failed, 0)
    status = ca.if_else(is_set(sx["next_rest"][0]), int(Status.settled), int(Status.optimal))
    status = ca.if_else(sx["used"], int(Status.relaxed), status)
    status = ca.if_else(sx["any_outside"], int(Status.recovering), status)
    status = ca.if_else(accepted, status, int(Status.braking))
    wrong = ca.fmod(causes, 2.0 ** (Cause.age + 1)) > 0.5
    status = ca.if_else(wrong, int(Status.invalid), status)
    contact = ca.sqrt(ca.sumsqr(sx["E"] @ sent))
    residuals = ca.vertcat(sx["residual"], contact, ca.if_else(accepted, share, 0))
    still = ca.sumsqr(planned) + ca.sumsqr(sent) <= 0
    found = {"planned": planned, "twist": sent, "still": still, "status": status}
    return sx.function("close", found | {"all_causes": causes, "residuals": residuals})


def _spread(values: ca.MX, movable: list[int], count: int) -> ca.MX:
    """Return the values of the movable rows in their places among all rows; the others are zero."""
    places = [movable.index(row) if row in movable else len(movable) for row in range(count)]
    return ca.vertcat(values, 0)[places, 0] if count else ca.MX(0, 1)


def _rate_excess(margins: Margins, twist: ca.MX) -> ca.MX:
    """Return by how much each row exceeds its rate limit at a twist, beyond the QP's accuracy."""
    speeds = ca.vertcat(*(ca.fabs(matrix @ twist) for matrix in margins.matrices))
    beyond = ca.fmax(speeds - ca.fmin(ca.vertcat(*margins.rates), FREE), 0)
    return ca.if_else(beyond > 1e-7, beyond, 0)


def _model_rate(limits: tuple, context: LimitContext, rate: ca.MX, dt: ca.MX) -> ca.MX:
    """Return the joint rates of the model person, in which joints at their end go no further."""
    for limit in limits:
        if not limit.yield_zone:
            continue
        rows = limit.rows(context)
        up = ca.if_else(rows.to_upper < limit.yield_zone, 0.0, ca.fmax(rows.to_upper, 0) / dt)
        down = ca.if_else(rows.to_lower < limit.yield_zone, 0.0, ca.fmax(rows.to_lower, 0) / dt)
        rate = ca.fmax(ca.fmin(rate, up), -down)
    return rate
