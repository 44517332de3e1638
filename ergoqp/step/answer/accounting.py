"""The twist that is sent, and its account: status, causes, rates, slack, residuals."""

from __future__ import annotations

from typing import Final

import casadi as ca

from ergoqp.expressions.linear import by_name, dense, is_set, largest
from ergoqp.limits import Situation
from ergoqp.solvers.solver import FREE
from ergoqp.step.answer.causes import Cause, Status
from ergoqp.step.model import StepModel
from ergoqp.step.program.margins import Margins
from ergoqp.step.program.qp import TOLERANCE

_ACCOUNTED: Final = (
    "posture",
    "observed",
    "readings",
    "pose",
    "dt",
    "S",
    "residual",
    "usable",
    "E",
    "slack",
    "multipliers",
    "causes",
    "wanted",
    "brake",
    "now",
    "solved",
    "outside",
    "next_rest",
    "share",
    "unusable",
    "begun",
    "own",
    "sent",
)


def account_function(model: StepModel) -> ca.Function:
    """Return the twist that is sent, and its account.

    Returns:
        Function ``(...) -> (planned, twist, still, posture_rate, status, all_causes, all_slack,
        all_multipliers, residuals)``; slack and multipliers are those of all rows (r,).
    """
    problem, movable = model.problem, model.movable
    known, count = model.symbols(_ACCOUNTED, ca.MX), len(problem.row_names)
    limits, now = problem.row_limits, known["now"]
    margins = Margins(model, known)
    tolerance, soft = ca.DM(model.values("tolerance")), ca.DM(1 - model.values("hard"))
    # Slack of a row on the object side only means that the QP asked for more than needed, because
    # the certification is exact there.
    held = now[movable, 0] >= -tolerance[movable, 0]
    used = largest(soft[movable, 0] * known["slack"] * held) > 10 * TOLERANCE
    given = known | {"used": used, "any_outside": largest(known["outside"])}
    found = by_name(_close_function(model), given)
    twist = found["twist"]
    rate = _model_rate(limits, model.situation(known, known["S"]), known["S"] @ twist, known["dt"])
    slack, multipliers = (_spread(known[name], movable, count) for name in ("slack", "multipliers"))
    # A twist that is shortened toward braking may exceed a rate that braking exceeds too. This row
    # has given way as well, and is named.
    slack = ca.fmax(slack, _rate_excess(margins, twist)) if len(limits) else slack
    found |= {"posture_rate": rate, "all_slack": slack, "all_multipliers": multipliers}
    outputs = [ca.densify(part) for part in found.values()]
    return ca.Function("account", list(known.values()), outputs, list(known), list(found))


_CLOSED: Final = (
    "posture",
    "dt",
    "residual",
    "usable",
    "E",
    "causes",
    "wanted",
    "brake",
    "solved",
    "next_rest",
    "share",
    "unusable",
    "begun",
    "own",
    "sent",
    "used",
    "any_outside",
)


def _close_function(model: StepModel) -> ca.Function:
    """Return the function for the planned twist, the sent twist, and the status of the step."""
    problem, sx = model.problem, model.symbols(_CLOSED)
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
        sent = ca.fmin(
            ca.fmax(sx["begun"] + sx["own"] * planned, sx["sent"] - change), sx["sent"] + change
        )
    failed = ca.if_else(
        sx["solved"], 2.0**Cause.not_certified * (share <= 0), 2.0**Cause.not_solved
    )
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
    found = {
        "planned": planned,
        "twist": sent,
        "still": still,
        "status": status,
        "all_causes": causes,
        "residuals": residuals,
    }
    outputs = ca.cse(dense(list(found.values())))
    return ca.Function("close", list(sx.values()), outputs, list(sx), list(found))


def _spread(values: ca.MX, movable: list[int], count: int) -> ca.MX:
    """Return the values of the movable rows in their places among all rows; the others are zero."""
    places = [movable.index(row) if row in movable else len(movable) for row in range(count)]
    return ca.vertcat(values, 0)[places, 0] if count else ca.MX(0, 1)


def _rate_excess(margins: Margins, twist: ca.MX) -> ca.MX:
    """Return by how much each row exceeds its rate limit at a twist, beyond the QP's accuracy."""
    speeds = ca.vertcat(*(ca.fabs(matrix @ twist) for matrix in margins.matrices))
    beyond = ca.fmax(speeds - ca.fmin(ca.vertcat(*margins.rates), FREE), 0)
    return ca.if_else(beyond > 1e-7, beyond, 0)


def _model_rate(limits: tuple, situation: Situation, rate: ca.MX, dt: ca.MX) -> ca.MX:
    """Return the joint rates of the model person, in which joints at their end go no further."""
    for limit in limits:
        if not limit.yield_zone:
            continue
        rows = limit.rows(situation)
        up = ca.if_else(rows.above < limit.yield_zone, 0.0, ca.fmax(rows.above, 0) / dt)
        down = ca.if_else(rows.below < limit.yield_zone, 0.0, ca.fmax(rows.below, 0) / dt)
        rate = ca.fmax(ca.fmin(rate, up), -down)
    return rate
