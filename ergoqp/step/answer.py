"""The answer of a step: the twist and its account."""

from __future__ import annotations

import time
from collections.abc import Mapping
from functools import cached_property

import casadi as ca
import numpy as np

from ergoqp.expressions import call_by_name, is_set, largest
from ergoqp.problem.problem import Problem
from ergoqp.solvers.solver import FREE
from ergoqp.step.causes import Cause, Status
from ergoqp.step.certification import Margins
from ergoqp.step.model import StepModel
from ergoqp.step.qp import TOLERANCE
from ergoqp.step.reason import reason_of


class Step:
    """The answer of one control step.

    Attributes:
        twist: twist to send: velocity of the object at the contact frame, world-aligned, linear
            first (6,) [m/s, rad/s].
        status: ``optimal``, ``settled``, ``relaxed``, ``recovering``, ``braking`` or ``invalid``.
        solve_time: duration of the call [s].
        values: all outputs of the step function, one after the other; `account` gives one by name.

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
        self.values = account
        self._problem, self._parts = problem, parts
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
        return self.values[self._parts[name]]

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
        status = Status[self.status]
        return reason_of(self._problem, self.account, status, self.drawn, self._seen, notes)

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
        Function ``(...) -> (planned, twist, still, status, all_causes, all_slack, all_multipliers,
        residuals)``; slack and multipliers are those of all rows (r,).
    """
    problem, movable = model.problem, model.movable
    signals, count = model.symbols(kind=ca.MX), len(problem.row_names)
    limits, now = problem.row_limits, signals["now"]
    margins = Margins(model, signals)
    tolerance, soft = signals["rows_tolerance"], ca.DM(1 - model.values("hard"))
    # Slack of a row on the object side only means that the QP asked for more than needed, because
    # the certification is exact there.
    held = now[movable, 0] >= -tolerance[movable, 0]
    used = largest(soft[movable, 0] * signals["slack"] * held) > 10 * TOLERANCE
    any_outside = largest(signals["outside"])
    found = call_by_name(_close_function(model), signals, used=used, any_outside=any_outside)
    twist = found["twist"]
    slack, multipliers = (
        _spread(signals[name], movable, count) for name in ("slack", "multipliers")
    )
    # A twist that is shortened toward braking may exceed a rate that braking exceeds too. This row
    # has given way as well, and is named.
    slack = ca.fmax(slack, _rate_excess(margins, twist)) if len(limits) else slack
    found |= {"all_slack": slack, "all_multipliers": multipliers}
    return signals.function("account", found)


def rate_function(model: StepModel) -> ca.Function:
    """``(...) -> posture_rate``: how the model person follows the twist that is sent.

    Joints at their end go no further.
    """
    signals = model.symbols(kind=ca.MX)
    rate, dt = signals["S"] @ signals["twist"], signals["dt"]
    context = Margins(model, signals).context
    for limit in model.problem.row_limits:
        if not limit.yield_zone:
            continue
        rows = limit.rows(context)
        zone = model.of_rows(signals, "yield_zone", limit)
        up = ca.if_else(rows.to_upper < zone, 0.0, ca.fmax(rows.to_upper, 0) / dt)
        down = ca.if_else(rows.to_lower < zone, 0.0, ca.fmax(rows.to_lower, 0) / dt)
        rate = ca.fmax(ca.fmin(rate, up), -down)
    return signals.function("rate", {"posture_rate": rate})


def _close_function(model: StepModel) -> ca.Function:
    """Return the function for the planned twist, the sent twist, and the status of the step."""
    problem, sx = model.problem, model.symbols()
    share = largest(sx["share"])
    fits = ca.logic_and(sx["solved"], ca.logic_not(sx["unusable"]))
    accepted = ca.logic_and(ca.logic_and(sx["usable"], fits), share > 0)
    planned = sx["brake"] + ca.if_else(accepted, sx["share"], 0) * (sx["wanted"] - sx["brake"])
    if problem.surface is not None:
        mending = sx["stop_acceleration"] * sx["usable"]
        planned = model.surface(sx).retract(sx["posture"], planned, sx["dt"], mending)
    sent = planned
    if problem.average:
        # A mean keeps the acceleration by itself while the history is long enough.
        change = sx["stop_acceleration"] * sx["dt"]
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
