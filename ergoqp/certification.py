"""What may be sent: the wanted twist and its whole stop are judged, shortened toward braking if need be, and accounted for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import casadi as ca

from ergoqp.limits import Situation
from ergoqp.qp import FREE, TOLERANCE
from ergoqp.rest import STATES, rest_update
from ergoqp.rigid import exp_rotation
from ergoqp.step_inputs import Cause, N, Status
from ergoqp.step_objective import with_pattern
from ergoqp.step_rows import braking, driven, limit_values, patience, stop_displacement

if TYPE_CHECKING:
    from ergoqp.problem import Problem


HELD: Final = 1e-12
"""Rounding of a margin; far below what could add up over a day of steps [m, rad]."""

GIVES_WAY: Final = 1e-3
"""How much more than braking a posture row may give way that braking breaks already [rad]."""

_SHARES: Final = (1.0, 0.5, 0.25, 0.1)

STILL: Final = ca.SX(6, 1)
"""No swing: margins and rates are those of the moment."""

_JUDGED: Final = {
    "posture": (N, 1),
    "observed": (N, 1),
    "pose": (4, 4),
    "previous": (6, 1),
    "dt": (1, 1),
    "gain": (1, 1),
    "value": (1, 1),
    "xi": (6, 1),
    "S": (N, 6),
    "residual": (1, 1),
    "usable": (1, 1),
    "rest": (STATES, 1),
}


def judge_function(problem: Problem, pattern: ca.SX) -> ca.Function:
    """What the object should do by this answer, and whether all of it can be certified as it is."""
    sx = {name: ca.SX.sym(name, *size) for name, size in _JUDGED.items()}
    S = with_pattern(sx["S"], pattern)
    limits, dt = problem.row_limits, sx["dt"]
    situation = Situation(sx["posture"], sx["observed"], sx["pose"], S, STILL, ca.SX(0))
    brake = braking(problem.twist_limit, sx["previous"], dt)
    now = _margins(problem, situation, ca.SX(6, 1), dt)
    solved = sx["residual"] < TOLERANCE
    outside = ca.logic_and(now < -ca.DM(limit_values(limits, "tolerance")), _moves(problem, situation))
    must_move = ca.mmax(outside)
    counts = ca.logic_and(sx["usable"], solved)
    rest = rest_update(problem.control, sx["rest"], sx["gain"], sx["value"], must_move, dt, counts)
    wanted = ca.if_else(ca.logic_and(rest[0] > 0.5, ca.logic_not(must_move)), brake.twist, sx["xi"])
    # The answer of a failed QP may be NaN; it goes no further. And with no time left there is nothing to choose.
    in_time = patience(limits, situation, sx["previous"], dt) > 0
    wanted = ca.if_else(ca.logic_and(solved, in_time), wanted, brake.twist)
    through = _margins(problem, situation, wanted, dt)
    whole = ca.mmin(through - _floor(problem, now)) >= 0
    outputs = [wanted, brake.twist, now, solved, outside, rest, whole]
    return ca.Function("judge", list(sx.values()), ca.cse([ca.densify(part) for part in outputs]))


def shorten_function(problem: Problem, pattern: ca.SX) -> ca.Function:
    """The largest share of the way from braking to the wanted twist that can be certified; 0: only braking itself.

    What held before holds through the stop, what did not gets no worse, and nothing is asked beyond what braking does.
    """
    names = ("posture", "observed", "pose", "dt", "S", "wanted", "brake", "now")
    sizes = {**_JUDGED, "wanted": (6, 1), "brake": (6, 1), "now": (len(problem.row_names), 1)}
    sx = {name: ca.SX.sym(name, *sizes[name]) for name in names}
    situation = Situation(sx["posture"], sx["observed"], sx["pose"], with_pattern(sx["S"], pattern), STILL, ca.SX(0))
    at_braking = _margins(problem, situation, sx["brake"], sx["dt"])
    floor = _floor(problem, sx["now"], at_braking)
    share = ca.SX(0)
    for candidate in reversed(_SHARES):
        twist = sx["brake"] + candidate * (sx["wanted"] - sx["brake"])
        holds = ca.mmin(_margins(problem, situation, twist, sx["dt"]) - floor) >= 0
        share = ca.if_else(holds, candidate, share)
    return ca.Function("shorten", list(sx.values()), ca.cse([share]))


def account_function(problem: Problem, pattern: ca.SX, movable: list[int]) -> ca.Function:
    """The twist that is sent, and the account of it."""
    m, rows_in_all = len(movable), len(problem.row_names)
    sizes = {name: _JUDGED[name] for name in ("posture", "observed", "pose", "dt", "S", "residual", "usable")}
    sizes |= {"E": problem.response.sensitivity().size_out(1), "slack": (m, 1), "multipliers": (m, 1), "causes": (1, 1)}
    sizes |= {"wanted": (6, 1), "brake": (6, 1), "now": (rows_in_all, 1), "solved": (1, 1), "outside": (rows_in_all, 1)}
    sizes |= {"rest": (STATES, 1), "share": (1, 1)}
    sx = {name: ca.SX.sym(name, *size) for name, size in sizes.items()}
    limits, dt, share = problem.row_limits, sx["dt"], sx["share"]
    situation = Situation(sx["posture"], sx["observed"], sx["pose"], with_pattern(sx["S"], pattern), STILL, ca.SX(0))
    accepted = ca.logic_and(ca.logic_and(sx["usable"], sx["solved"]), share > 0)
    twist = sx["brake"] + ca.if_else(accepted, share, 0) * (sx["wanted"] - sx["brake"])
    rate = _model_rate(limits, situation, situation.sensitivity @ twist, dt)
    failed = ca.if_else(sx["solved"], 2.0**Cause.not_certified * (share <= 0), 2.0**Cause.not_solved)
    causes = sx["causes"] + ca.if_else(sx["usable"], failed, 0)

    tolerance = ca.DM(limit_values(limits, "tolerance"))
    # Slack of a row on the object side only says that the QP asked for more than needed: the certificate is exact there.
    soft = ca.DM(1 - limit_values(limits, "hard"))[movable]
    used = ca.mmax(soft * sx["slack"] * (sx["now"][movable] >= -tolerance[movable])) > 10 * TOLERANCE
    status = ca.if_else(sx["rest"][0] > 0.5, int(Status.settled), int(Status.optimal))
    status = ca.if_else(used, int(Status.relaxed), status)
    status = ca.if_else(ca.mmax(sx["outside"]), int(Status.recovering), status)
    status = ca.if_else(accepted, status, int(Status.braking))
    wrong = ca.fmod(causes, 2.0 ** (Cause.age + 1)) > 0.5
    status = ca.if_else(wrong, int(Status.invalid), status)

    full_slack, full_multipliers = ca.SX(rows_in_all, 1), ca.SX(rows_in_all, 1)
    full_slack[movable], full_multipliers[movable] = sx["slack"], sx["multipliers"]
    # Shortened toward braking, a twist may pass a rate that braking passes too: that has given way as well, and is named.
    full_slack = ca.fmax(full_slack, _rate_excess(limits, situation, twist))
    contact = ca.sqrt(ca.sumsqr(sx["E"] @ twist))
    residuals = ca.vertcat(sx["residual"], contact, ca.if_else(accepted, share, 0))
    outputs = [twist, exp_rotation(sx["pose"], twist * dt), rate, status, causes, full_slack, full_multipliers, residuals]
    return ca.Function("account", list(sx.values()), ca.cse([ca.densify(part) for part in outputs]))


def _margins(problem: Problem, situation: Situation, twist: ca.SX, dt: ca.SX) -> ca.SX:
    """Smallest margins of all rows through a period at `twist` and the stop after it."""
    displacement = stop_displacement(problem.twist_limit, twist, dt) if twist.nnz() else twist
    return ca.vertcat(*(limit.margins(situation, displacement) for limit in problem.row_limits))


def _floor(problem: Problem, now: ca.SX, at_braking: ca.SX | None = None) -> ca.SX:
    """Margins that an accepted twist must keep through its stop, given those of now and of braking.

    Hard rows: what held holds, what did not gets no worse, and nothing is asked beyond what braking does. Rows through S: what
    held holds, to the accuracy of the QP; where braking itself breaks it, it gives way by about as much; what does not hold is
    left to the QP, which never lets it further out.
    """
    hard = ca.DM(limit_values(problem.row_limits, "hard"))
    braked = now if at_braking is None else at_braking
    given_way = ca.if_else(braked < 0, braked - GIVES_WAY, -1e-7)
    soft_floor = ca.if_else(now < 0, -FREE, given_way)
    return ca.if_else(hard, ca.fmin(ca.fmin(now, braked), 0) - HELD, soft_floor)


def _moves(problem: Problem, situation: Situation) -> ca.SX:
    """Whether some twist that the object can do moves each row."""
    matrices = [driven(problem.twist_limit, limit.rows(situation).matrix) for limit in problem.row_limits]
    return ca.vertcat(*(ca.sum2(ca.fabs(ca.densify(matrix))) > 1e-6 for matrix in matrices))


def _rate_excess(limits: tuple, situation: Situation, twist: ca.SX) -> ca.SX:
    """By how much each row is faster at a twist than its rate allows, beyond the accuracy of the QP."""
    excess = []
    for limit in limits:
        rows = limit.rows(situation)
        excess.append(ca.fmax(ca.fabs(ca.densify(rows.matrix) @ twist) - ca.fmin(rows.rate, FREE), 0))
    beyond = ca.vertcat(*excess)
    return ca.if_else(beyond > 1e-7, beyond, 0)


def _model_rate(limits: tuple, situation: Situation, rate: ca.SX, dt: ca.SX) -> ca.SX:
    """The model person's joint rates: joints at their end do not go beyond it, the object or not."""
    for limit in limits:
        if not limit.yield_zone:
            continue
        rows = limit.rows(situation)
        up = ca.if_else(rows.above < limit.yield_zone, 0.0, ca.fmax(rows.above, 0) / dt)
        down = ca.if_else(rows.below < limit.yield_zone, 0.0, ca.fmax(rows.below, 0) / dt)
        rate = ca.fmax(ca.fmin(rate, up), -down)
    return rate
