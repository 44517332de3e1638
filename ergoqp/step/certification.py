"""What may be sent: the wanted twist and its whole stop are judged and accounted for.

If need be the twist is shortened toward braking.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import casadi as ca
import numpy as np

from ergoqp.expressions.linear import dense, is_set, largest, smallest
from ergoqp.limits import Situation
from ergoqp.limits.limit import Expression
from ergoqp.limits.stop import on_surface
from ergoqp.problem.problem import Problem
from ergoqp.step.bounds import MOVES, bends, limit_values, patience
from ergoqp.step.causes import Cause, Status
from ergoqp.step.counted import way_size
from ergoqp.step.guide import TRIAL, trial_update
from ergoqp.step.margins import StepRows, situations_of, smallest_margins
from ergoqp.step.objective import with_pattern
from ergoqp.step.qp import FREE, TOLERANCE
from ergoqp.step.readings import readings_size, situation_of
from ergoqp.step.rest import STATES, rest_update

HELD: Final = 1e-12
"""Rounding of a margin; far below what could add up over a day of steps [m, rad]."""

_INHERITS: Final = 1e-5
"""How much of what braking might do to a row that bends may be inherited [rad].

It applies inside such a row, with a long mean.
"""

_LONG: Final = 0.1
"""A mean over more seconds than this turns so far that unknowns of a row that bends add up."""

GIVES_WAY: Final = 1e-3
"""How much more than braking a posture row may give way that braking breaks already [rad]."""

_SHARES: Final = (1.0, 0.5, 0.25, 0.1)

_JUDGED: Final = (
    "posture",
    "observed",
    "readings",
    "pose",
    "landed",
    "way",
    "shift",
    "previous",
    "dt",
    "away",
    "gain",
    "value",
    "xi",
    "S",
    "residual",
    "usable",
    "rest",
)
_JOURNEY: Final = ("promise", "points", "trial", "distance", "on")


def _symbols(problem: Problem, names: tuple[str, ...], kind: type = ca.SX) -> dict[str, Any]:
    """Inputs of the functions of this file, by name; what has no size here is one number."""
    n, rows = len(problem.coordinates), len(problem.row_names)
    sizes = {
        "posture": (n, 1),
        "observed": (n, 1),
        "readings": (readings_size(problem), 1),
        "pose": (4, 4),
        "S": (n, 6),
    }
    sizes |= {
        "landed": (4, 4),
        "way": (way_size(problem), 1),
        "shift": (n, 1),
        "begun": (6, 1),
        "away": (2 * rows, 1),
    }
    sizes |= {
        "previous": (6, 1),
        "xi": (6, 1),
        "wanted": (6, 1),
        "brake": (6, 1),
        "last": (6, 1),
        "rest": (STATES, 1),
    }
    sizes |= {"share": (6, 1)}
    sizes |= {
        "trial": (TRIAL, 1),
        "now": (rows, 1),
        "outside": (rows, 1),
        "E": problem.response.sensitivity().size_out(1),
    }
    return {name: kind.sym(name, *sizes.get(name, (1, 1))) for name in names}


def judge_function(problem: Problem, pattern: ca.SX, guided: bool = False) -> ca.Function:
    """What the object should do by this answer, and whether all of it can be certified as it is.

    Guided, what is known of the trial of the given place is judged too, see `ergoqp.step.guide`.
    """
    names = (*_JUDGED, *(_JOURNEY if guided else ()))
    known = _symbols(problem, names, ca.MX)
    rows = StepRows(problem, known, known["S"])
    now = rows.now
    count = len(problem.row_names)
    away = ca.fmax(known["away"][:count], known["away"][count:]) > 0
    if problem.surface is not None:
        # A surface has no ends to be beyond, only a distance from it.
        on = ca.DM(
            [float(limit is problem.surface) for limit in problem.row_limits for _ in limit.names]
        )
        away = ca.logic_or(away, ca.logic_and(on, now < -problem.surface.tolerance))
    outside = ca.logic_and(away, _moves(problem, rows))
    decide = _decide_function(problem, pattern, guided)
    given = known | {"must_move": largest(outside)}
    wanted, slowest, ways, solved, rest, *trial = decide(
        *(given[decide.name_in(i)] for i in range(decide.n_in()))
    )
    whole = smallest(rows.margins(ways) - _floor(problem, now)) >= 0
    outputs = [wanted, slowest, now, solved, outside, rest, whole, *trial]
    return ca.Function("judge", list(known.values()), [ca.densify(part) for part in outputs])


def _decide_function(problem: Problem, pattern: ca.SX, guided: bool) -> ca.Function:
    """The twist that this answer asks for and the braking one, as they can be sent.

    With them come the first one's stop, rest and trial.
    """
    names = (*_JUDGED, "must_move", *(_JOURNEY if guided else ()))
    sx = _symbols(problem, names)
    limits, dt, stop = problem.row_limits, sx["dt"], problem.stop
    situation = situation_of(problem, sx, with_pattern(sx["S"], pattern))
    brake = on_surface(stop.braking(sx["previous"], dt), situation, sx["usable"])
    solved = sx["residual"] < TOLERANCE
    counts = ca.logic_and(sx["usable"], solved)
    rest = rest_update(
        problem.control, sx["rest"], sx["gain"], sx["value"], sx["must_move"], dt, counts
    )
    trial = []
    if guided:
        journey = (sx["landed"], sx["distance"], sx["on"], sx["promise"], sx["points"])
        next_trial, rest = trial_update(problem.control, sx["trial"], rest, *journey, dt, counts)
        trial = [next_trial]
    wanted = ca.if_else(
        ca.logic_and(is_set(rest[0]), ca.logic_not(sx["must_move"])), brake.twist, sx["xi"]
    )
    # The answer of a failed QP may be NaN; it goes no further. And with no time left there is
    # nothing to choose.
    in_time = patience(limits, situation, sx["previous"], dt, stop) > 0
    wanted = ca.if_else(ca.logic_and(solved, in_time), wanted, brake.twist)
    wanted, slowest = (
        _kept(problem, situation, twist, dt, sx["usable"]) for twist in (wanted, brake.twist)
    )
    outputs = [wanted, slowest, stop.ways(wanted, dt), solved, rest, *trial]
    return ca.Function(
        "decide",
        list(sx.values()),
        ca.cse(dense(outputs)),
        list(names),
        [f"o{i}" for i in range(len(outputs))],
    )


def shorten_function(problem: Problem, pattern: ca.SX) -> ca.Function:
    """The largest shares (6,) of the way from braking to the wanted twist that can be certified.

    A share of 0 is only braking itself.

    Where the way is not to be had at all, shifting or turning alone may be: an axis that comes no
    nearer to its cone does not keep the object out of its workspace. What held before holds through
    the stop, what did not gets no worse, and nothing is asked beyond what braking does.
    """
    sx = _symbols(
        problem,
        (
            "posture",
            "observed",
            "readings",
            "landed",
            "way",
            "shift",
            "dt",
            "S",
            "wanted",
            "brake",
            "now",
        ),
    )
    S = with_pattern(sx["S"], pattern)
    situation = situation_of(problem, sx, S)
    at_braking = _margins(problem, sx, S, sx["brake"], sx["dt"])
    floor = _floor(problem, sx["now"], at_braking)
    shift, turn = ca.DM([1, 1, 1, 0, 0, 0]), ca.DM([0, 0, 0, 1, 1, 1])
    candidates = [candidate * ca.DM.ones(6) for candidate in _SHARES]
    if problem.surface is None:
        candidates += [candidate * part for candidate in _SHARES[::2] for part in (shift, turn)]
    shares = ca.SX(6, 1)
    for candidate in reversed(candidates):
        twist = _kept(
            problem, situation, sx["brake"] + candidate * (sx["wanted"] - sx["brake"]), sx["dt"]
        )
        holds = smallest(_margins(problem, sx, S, twist, sx["dt"]) - floor) >= 0
        shares = ca.if_else(holds, candidate, shares)
    return ca.Function("shorten", list(sx.values()), ca.cse([ca.densify(shares)]))


def account_function(problem: Problem, pattern: ca.SX, movable: list[int]) -> ca.Function:
    """The twist that is sent, and the account of it."""
    m = len(movable)
    known = _symbols(
        problem,
        ("posture", "observed", "readings", "pose", "dt", "S", "residual", "usable", "E"),
        ca.MX,
    )
    known |= {name: ca.MX.sym(name, m) for name in ("slack", "multipliers")}
    known |= _symbols(
        problem, ("causes", "wanted", "brake", "now", "solved", "outside", "rest", "share"), ca.MX
    )
    known |= _symbols(problem, ("begun", "own", "last"), ca.MX)
    limits, now = problem.row_limits, known["now"]
    rows = StepRows(problem, known, known["S"])
    tolerance, soft = (
        ca.DM(limit_values(limits, "tolerance")),
        ca.DM(1 - limit_values(limits, "hard")),
    )
    # Slack of a row on the object side only says that the QP asked for more than needed: the
    # certificate is exact there.
    held = now[movable] >= -tolerance[movable] if m else now
    used = largest(soft[movable] * known["slack"] * held) > 10 * TOLERANCE
    close = _close_function(problem)
    given = known | {"used": used, "any_outside": largest(known["outside"])}
    planned, sent, still, status, causes, residuals = close(
        *(given[close.name_in(i)] for i in range(close.n_in()))
    )
    rate = _model_rate(
        limits, situation_of(problem, known, known["S"]), known["S"] @ sent, known["dt"]
    )
    slack, multipliers = (
        _spread(known[name], movable, len(problem.row_names)) for name in ("slack", "multipliers")
    )
    # Shortened toward braking, a twist may pass a rate that braking passes too: that has given way
    # as well, and is named.
    slack = ca.fmax(slack, _rate_excess(rows, sent)) if len(limits) else slack
    outputs = [planned, sent, still, rate, status, causes, slack, multipliers, residuals]
    return ca.Function("account", list(known.values()), [ca.densify(part) for part in outputs])


def _close_function(problem: Problem) -> ca.Function:
    """The twist that is planned, the one that is sent with it, and what to call the step."""
    names = (
        "posture",
        "dt",
        "residual",
        "usable",
        "E",
        "causes",
        "wanted",
        "brake",
        "solved",
        "rest",
        "share",
    )
    sx = _symbols(problem, (*names, "begun", "own", "last", "used", "any_outside"))
    share = largest(sx["share"])
    accepted = ca.logic_and(ca.logic_and(sx["usable"], sx["solved"]), share > 0)
    planned = sx["brake"] + ca.if_else(accepted, sx["share"], 0) * (sx["wanted"] - sx["brake"])
    if problem.surface is not None:
        mending = ca.DM(problem.twist_limit.acceleration) * sx["usable"]
        planned = problem.surface.retract(sx["posture"], planned, sx["dt"], mending)
    sent = planned
    if problem.average:
        # A mean keeps the acceleration by itself, as long as the history holds all of its seconds.
        change = ca.DM(problem.twist_limit.acceleration) * sx["dt"]
        sent = ca.fmin(
            ca.fmax(sx["begun"] + sx["own"] * planned, sx["last"] - change), sx["last"] + change
        )
    failed = ca.if_else(
        sx["solved"], 2.0**Cause.not_certified * (share <= 0), 2.0**Cause.not_solved
    )
    causes = sx["causes"] + ca.if_else(sx["usable"], failed, 0)
    status = ca.if_else(is_set(sx["rest"][0]), int(Status.settled), int(Status.optimal))
    status = ca.if_else(sx["used"], int(Status.relaxed), status)
    status = ca.if_else(sx["any_outside"], int(Status.recovering), status)
    status = ca.if_else(accepted, status, int(Status.braking))
    wrong = ca.fmod(causes, 2.0 ** (Cause.age + 1)) > 0.5
    status = ca.if_else(wrong, int(Status.invalid), status)
    contact = ca.sqrt(ca.sumsqr(sx["E"] @ sent))
    residuals = ca.vertcat(sx["residual"], contact, ca.if_else(accepted, share, 0))
    still = ca.sumsqr(planned) + ca.sumsqr(sent) <= 0
    outputs = [planned, sent, still, status, causes, residuals]
    named = ["planned", "sent_twist", "still", "status", "all_causes", "residuals"]
    return ca.Function("close", list(sx.values()), ca.cse(dense(outputs)), list(sx), named)


def _spread(values: ca.MX, movable: list[int], count: int) -> ca.MX:
    """Values of the movable rows in their places among all rows; zero elsewhere."""
    places = [movable.index(row) if row in movable else len(movable) for row in range(count)]
    return ca.vertcat(values, 0)[places] if count else ca.MX(0, 1)


def _kept(
    problem: Problem, situation: Situation, twist: ca.SX, dt: ca.SX, known: ca.SX | float = 1.0
) -> ca.SX:
    """The twist that leads to the surface which the state has to stay on, see `on_surface`.

    Without a surface it is the twist itself.
    """
    if problem.surface is None:
        return twist
    return problem.surface.retract(
        situation.posture, twist, dt, ca.DM(problem.twist_limit.acceleration) * known
    )


def _margins(problem: Problem, sx: Mapping[str, ca.SX], S: ca.SX, twist: ca.SX, dt: ca.SX) -> ca.SX:
    """Smallest margins of all rows through a period at `twist` and the stop after it."""
    ways = problem.stop.ways(twist, dt)
    situations = situations_of(problem, sx, S, ways)
    return ca.vertcat(*(smallest_margins(limit, situations, ways) for limit in problem.row_limits))


def _floor(problem: Problem, now: Expression, at_braking: Expression = None) -> Expression:
    """Margins that an accepted twist must keep through its stop, given those of now and of braking.

    Hard rows: what held holds, what did not gets no worse, and nothing is asked beyond what braking
    does, except where margins are lower bounds: braking may be better than its bound says, and no
    other twist inherits that; inside a row that bends it inherits hardly anything of a long mean.
    Rows through S: what held holds, to the accuracy of the QP; where braking itself breaks it, it
    gives way by about as much; what does not hold is left to the QP, which never lets it further
    out.
    """
    hard, proven = (ca.DM(limit_values(problem.row_limits, name)) for name in ("hard", "proven"))
    braked = now if at_braking is None else at_braking
    given_way = ca.if_else(braked < 0, braked - GIVES_WAY, -1e-7)
    soft_floor = ca.if_else(now < 0, -FREE, given_way)
    held = ca.fmin(now, 0)
    capped = (bends(problem.row_limits) > 0) & (problem.average > _LONG)
    inherits = ca.DM(
        np.where(capped, _INHERITS + 3 * float(np.linalg.norm(problem.robot.noise[3:])), FREE)
    )
    hard_floor = held + (1 - proven) * ca.fmin(braked - held, 0)
    hard_floor = ca.fmax(hard_floor, ca.if_else(now < -inherits, -FREE, -inherits)) - HELD
    return ca.if_else(hard, hard_floor, soft_floor)


def _moves(problem: Problem, rows: StepRows) -> ca.MX:
    """Whether some twist that the object can do moves each row."""
    free = ca.DM(problem.twist_limit.speed > 0)
    return ca.vertcat(*(ca.fabs(matrix) @ free > MOVES for matrix in rows.matrices))


def _rate_excess(rows: StepRows, twist: ca.MX) -> ca.MX:
    """By how much each row is faster at a twist than its rate allows, beyond the QP's accuracy."""
    speeds = ca.vertcat(*(ca.fabs(matrix @ twist) for matrix in rows.matrices))
    beyond = ca.fmax(speeds - ca.fmin(ca.vertcat(*rows.rates), FREE), 0)
    return ca.if_else(beyond > 1e-7, beyond, 0)


def _model_rate(limits: tuple, situation: Situation, rate: ca.MX, dt: ca.MX) -> ca.MX:
    """The model person's joint rates: joints at their end go no further, the object or not."""
    for limit in limits:
        if not limit.yield_zone:
            continue
        rows = limit.rows(situation)
        up = ca.if_else(rows.above < limit.yield_zone, 0.0, ca.fmax(rows.above, 0) / dt)
        down = ca.if_else(rows.below < limit.yield_zone, 0.0, ca.fmax(rows.below, 0) / dt)
        rate = ca.fmax(ca.fmin(rate, up), -down)
    return rate
