"""What may be sent: the wanted twist and its whole stop are judged, shortened toward braking if need be, and accounted for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import casadi as ca

from ergoqp.linear import largest, smallest
from ergoqp.qp import FREE, TOLERANCE
from ergoqp.rest import STATES, rest_update
from ergoqp.rigid import exp_rotation
from ergoqp.step_guide import TRIAL, trial_update
from ergoqp.step_inputs import Cause, Status
from ergoqp.step_objective import with_pattern
from ergoqp.step_readings import readings_size, situation_of
from ergoqp.step_rows import braking, driven, limit_values, on_surface, patience, stop_displacement

if TYPE_CHECKING:
    from ergoqp.limits import Situation
    from ergoqp.problem import Problem


HELD: Final = 1e-12
"""Rounding of a margin; far below what could add up over a day of steps [m, rad]."""

GIVES_WAY: Final = 1e-3
"""How much more than braking a posture row may give way that braking breaks already [rad]."""

_SHARES: Final = (1.0, 0.5, 0.25, 0.1)


def _symbols(problem: Problem, names: tuple[str, ...]) -> dict[str, ca.SX]:
    """Inputs of the functions of this file, by name; what has no size here is one number."""
    n, rows = len(problem.coordinates), len(problem.row_names)
    sizes = {"posture": (n, 1), "observed": (n, 1), "readings": (readings_size(problem), 1), "pose": (4, 4), "S": (n, 6)}
    sizes |= {"previous": (6, 1), "xi": (6, 1), "wanted": (6, 1), "brake": (6, 1), "rest": (STATES, 1)}
    sizes |= {"trial": (TRIAL, 1), "now": (rows, 1), "outside": (rows, 1), "E": problem.response.sensitivity().size_out(1)}
    return {name: ca.SX.sym(name, *sizes.get(name, (1, 1))) for name in names}


def judge_function(problem: Problem, pattern: ca.SX, guided: bool = False) -> ca.Function:
    """What the object should do by this answer, and whether all of it can be certified as it is.

    Guided, what is known of the trial of the given place is judged too, see `ergoqp.step_guide`.
    """
    names = (
        "posture",
        "observed",
        "readings",
        "pose",
        "previous",
        "dt",
        "gain",
        "value",
        "xi",
        "S",
        "residual",
        "usable",
        "rest",
    )
    sx = _symbols(problem, (*names, "promise", "points", "trial", "distance", "on") if guided else names)
    limits, dt = problem.row_limits, sx["dt"]
    situation = situation_of(problem, sx, with_pattern(sx["S"], pattern))
    brake = on_surface(braking(problem.twist_limit, sx["previous"], dt), situation)
    now = _margins(problem, situation, ca.SX(6, 1), dt)
    solved = sx["residual"] < TOLERANCE
    outside = ca.logic_and(now < -ca.DM(limit_values(limits, "tolerance")), _moves(problem, situation))
    must_move = largest(outside)
    counts = ca.logic_and(sx["usable"], solved)
    rest = rest_update(problem.control, sx["rest"], sx["gain"], sx["value"], must_move, dt, counts)
    trial = []
    if guided:
        known = (sx["pose"], sx["distance"], sx["on"], sx["promise"], sx["points"])
        next_trial, rest = trial_update(problem.control, sx["trial"], rest, *known, dt, counts)
        trial = [next_trial]
    wanted = ca.if_else(ca.logic_and(rest[0] > 0.5, ca.logic_not(must_move)), brake.twist, sx["xi"])
    # The answer of a failed QP may be NaN; it goes no further. And with no time left there is nothing to choose.
    in_time = patience(limits, situation, sx["previous"], dt) > 0
    wanted = ca.if_else(ca.logic_and(solved, in_time), wanted, brake.twist)
    wanted, slowest = (_kept(problem, situation, twist, dt) for twist in (wanted, brake.twist))
    through = _margins(problem, situation, wanted, dt)
    whole = smallest(through - _floor(problem, now)) >= 0
    outputs = [wanted, slowest, now, solved, outside, rest, whole, *trial]
    return ca.Function("judge", list(sx.values()), ca.cse([ca.densify(part) for part in outputs]))


def shorten_function(problem: Problem, pattern: ca.SX) -> ca.Function:
    """The largest share of the way from braking to the wanted twist that can be certified; 0: only braking itself.

    What held before holds through the stop, what did not gets no worse, and nothing is asked beyond what braking does.
    """
    sx = _symbols(problem, ("posture", "observed", "readings", "pose", "dt", "S", "wanted", "brake", "now"))
    situation = situation_of(problem, sx, with_pattern(sx["S"], pattern))
    at_braking = _margins(problem, situation, sx["brake"], sx["dt"])
    floor = _floor(problem, sx["now"], at_braking)
    share = ca.SX(0)
    for candidate in reversed(_SHARES):
        twist = _kept(problem, situation, sx["brake"] + candidate * (sx["wanted"] - sx["brake"]), sx["dt"])
        holds = smallest(_margins(problem, situation, twist, sx["dt"]) - floor) >= 0
        share = ca.if_else(holds, candidate, share)
    return ca.Function("shorten", list(sx.values()), ca.cse([share]))


def account_function(problem: Problem, pattern: ca.SX, movable: list[int]) -> ca.Function:
    """The twist that is sent, and the account of it."""
    m, rows_in_all = len(movable), len(problem.row_names)
    sx = _symbols(problem, ("posture", "observed", "readings", "pose", "dt", "S", "residual", "usable", "E"))
    sx |= {name: ca.SX.sym(name, m) for name in ("slack", "multipliers")}
    sx |= _symbols(problem, ("causes", "wanted", "brake", "now", "solved", "outside", "rest", "share"))
    limits, dt, share = problem.row_limits, sx["dt"], sx["share"]
    situation = situation_of(problem, sx, with_pattern(sx["S"], pattern))
    accepted = ca.logic_and(ca.logic_and(sx["usable"], sx["solved"]), share > 0)
    twist = sx["brake"] + ca.if_else(accepted, share, 0) * (sx["wanted"] - sx["brake"])
    twist = _kept(problem, situation, twist, dt)
    rate = _model_rate(limits, situation, situation.sensitivity @ twist, dt)
    failed = ca.if_else(sx["solved"], 2.0**Cause.not_certified * (share <= 0), 2.0**Cause.not_solved)
    causes = sx["causes"] + ca.if_else(sx["usable"], failed, 0)

    tolerance = ca.DM(limit_values(limits, "tolerance"))
    # Slack of a row on the object side only says that the QP asked for more than needed: the certificate is exact there.
    soft = ca.DM(1 - limit_values(limits, "hard"))[movable]
    used = largest(soft * sx["slack"] * (sx["now"][movable] >= -tolerance[movable])) > 10 * TOLERANCE
    status = ca.if_else(sx["rest"][0] > 0.5, int(Status.settled), int(Status.optimal))
    status = ca.if_else(used, int(Status.relaxed), status)
    status = ca.if_else(largest(sx["outside"]), int(Status.recovering), status)
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


def _kept(problem: Problem, situation: Situation, twist: ca.SX, dt: ca.SX) -> ca.SX:
    """The twist that leads to the surface which the state has to stay on; without one, the twist itself."""
    if problem.surface is None:
        return twist
    return problem.surface.retract(situation.posture, twist, dt, ca.DM(problem.twist_limit.acceleration))


def _margins(problem: Problem, situation: Situation, twist: ca.SX, dt: ca.SX) -> ca.SX:
    """Smallest margins of all rows through a period at `twist` and the stop after it."""
    displacement = stop_displacement(problem.twist_limit, twist, dt) if twist.nnz() else twist
    return ca.vertcat(*(limit.margins(situation, displacement) for limit in problem.row_limits))


def _floor(problem: Problem, now: ca.SX, at_braking: ca.SX | None = None) -> ca.SX:
    """Margins that an accepted twist must keep through its stop, given those of now and of braking.

    Hard rows: what held holds, what did not gets no worse, and nothing is asked beyond what braking does, except where
    margins are lower bounds: braking may be better than its bound says, and no other twist inherits that. Rows through S:
    what held holds, to the accuracy of the QP; where braking itself breaks it, it gives way by about as much; what does not
    hold is left to the QP, which never lets it further out.
    """
    hard, proven = (ca.DM(limit_values(problem.row_limits, name)) for name in ("hard", "proven"))
    braked = now if at_braking is None else at_braking
    given_way = ca.if_else(braked < 0, braked - GIVES_WAY, -1e-7)
    soft_floor = ca.if_else(now < 0, -FREE, given_way)
    hard_floor = ca.fmin(now, 0) + (1 - proven) * ca.fmin(braked - ca.fmin(now, 0), 0) - HELD
    return ca.if_else(hard, hard_floor, soft_floor)


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
