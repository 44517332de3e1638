"""Certification: the margins of all rows, and whether the wanted twist and its stop keep them.

The twist is shortened if necessary. All rows are computed at once, as vectors; curved rows go
through functions of scalars: an interpreter computes a vector of forty numbers in the time of four
scalars, and the few dozen scalar operations of a curved row in the time of one vector.

A minimum drops NaN, so a limit whose margin is NaN would never be broken. The step detects NaN by
comparisons that fail with it, and `amiss` then finds which terms it came from.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final

import casadi as ca
import numpy as np

from ergoqp.expressions import call_by_name, column, is_set, largest, marked, smallest
from ergoqp.limits import Limit, LimitContext, Rows
from ergoqp.limits.limit import Expression
from ergoqp.limits.twist_and_stopping import Stop, on_surface
from ergoqp.problem.problem import Problem
from ergoqp.solvers.solver import FREE
from ergoqp.step.model import PLACE, Signals, StepModel
from ergoqp.step.qp import TOLERANCE
from ergoqp.step.rest import rest_update, trial_update
from ergoqp.step.rows import MOVES, patience

_HERE = ("posture", "observed", "readings", "pose")


_LANDED = ("posture", "observed", "readings", "landed", "way", "shift")


class Margins:
    """The rows of all limits at the present pose, and their margins from the landing pose.

    Attributes:
        context: the context of all linear limits at the present pose.
        matrices: rate of each quantity per twist, (m, 6) for each limit.
        rates: largest allowed rate, (m,) for each limit; inf if there is none.
        now: present margin of every row (r,).
    """

    def __init__(self, model: StepModel, signals: Signals) -> None:
        """Compute the rows of all limits once.

        Args:
            model: model of the step.
            signals: ``posture``, ``observed``, ``readings``, ``pose`` and ``S`` of this step; for
                `ahead` also ``landed``, ``way`` and ``shift``.
        """
        self._model, self._signals = model, signals
        here = {name: signals[name] for name in _HERE}
        self.context = model.context(here, signals["S"], numbers=signals)
        found = [
            _margins_here(model, limit, self.context)
            if _linear(limit)
            else call_by_name(_curved_here(model, limit), signals)
            for limit in model.problem.row_limits
        ]
        self.matrices = [each["matrix"] for each in found]
        self.rates = [each["rate"] for each in found]
        self.now = ca.vertcat(*(each["margins"] for each in found))

    def ahead(self, ways: ca.MX) -> ca.MX:
        """Return the smallest margin of each row (r,) on straight paths to further displacements.

        See `Stop.ways`.
        """
        contexts = contexts_of(self._model, self._signals, self._signals["S"], ways)
        found = []
        for limit in self._model.problem.row_limits:
            if _linear(limit):
                found.append(smallest_margins(limit, contexts, ways))
            else:
                curved = _curved_ahead(self._model, limit, ways.shape[1])
                found.append(call_by_name(curved, self._signals, ways=ways)["margins"])
        return ca.vertcat(*found)


def _linear(limit: Limit) -> bool:
    """Return whether rows and margins accept matrices: see `ergoqp.limits.limit.Limit`."""
    return getattr(limit, "linear", False)


def _curved_here(model: StepModel, limit: Limit) -> ca.Function:
    """``(*_HERE, S) -> (matrix, rate, present margins)`` of one limit."""
    sx = model.symbols(_HERE)
    context = model.context(sx, model.sparse(sx["S"]))
    return sx.function("curved_here", _margins_here(model, limit, context))


def _margins_here(model: StepModel, limit: Limit, context: LimitContext) -> dict[str, Expression]:
    """Return matrix, rate and present margins of one limit."""
    rows = limit.rows(context)
    straight = ca.fmin(rows.to_lower, rows.to_upper)
    margins = straight if _linear(limit) else limit.margins(context, ca.SX(6, 1))
    margins = with_nan(model, limit, rows, margins)
    return {"matrix": rows.matrix, "rate": rows.rate, "margins": margins}


def with_nan(model: StepModel, limit: Limit, rows: Rows, margins: Expression) -> Expression:
    """Return margins (m,) that are NaN where any number of a watched row is."""
    if limit.names[0] not in model.watched:
        return margins
    ends = (rows.to_lower, rows.to_upper, rows.rate, rows.curvature_margin)
    return marked(margins, *ends, *ca.horzsplit(rows.matrix))


def _curved_ahead(model: StepModel, limit: Limit, count: int) -> ca.Function:
    """``(*_LANDED, S, ways) -> margins`` of one limit; ways are (6, count)."""
    sx = model.symbols(_LANDED)
    ways = sx.inputs["ways"] = ca.SX.sym("ways", 6, count)
    contexts = contexts_of(model, sx, model.sparse(sx["S"]), ways)
    return sx.function("curved_ahead", {"margins": smallest_margins(limit, contexts, ways)})


def contexts_of(
    model: StepModel, signals: Signals, S: Expression, ways: Expression
) -> tuple[LimitContext, ...]:
    """Return the context for each of `Stop.ways`.

    A robot that holds does so either with what is under way, or with the twist.
    """
    law, there = model.problem.stop, {name: signals[name] for name in _LANDED}
    kinds = (True, False)[: 1 + bool(law.hold)]
    found = [model.context(there, S, held=held, numbers=signals) for held in kinds]
    if law.average:
        found = [
            replace(context, overshoot=ways[:, -2], overshoot_bound=ways[:, -1])
            for context in found
        ]
    return tuple(found)


def smallest_margins(
    limit: Limit, contexts: tuple[LimitContext, ...], ways: Expression
) -> Expression:
    """Return the smallest margins (m,) of a limit on `Stop.ways`.

    The hold of a robot counts for hard limits only.
    """
    margins = None
    for number, context in enumerate(contexts if limit.hard else contexts[:1]):
        on = limit.margins(context, ways[:, number])
        margins = on if margins is None else marked(ca.fmin(margins, on), margins, on)
    return margins


AHEAD: Final = "a value on the way ahead"


PARTS: Final = (
    ("response", "a sensitivity"),
    ("response", "contact motion that cannot be followed"),
    ("cost", "a value"),
    ("cost", "a slope"),
    ("cost", AHEAD),
)
"""What the first entries of the output ``amiss`` stand for; one for each row of the limits follows.

An entry is 1 if that part is NaN or, except in a row, infinite.
"""


_FINITE: Final = ("S", "E", "total", "gradient", "gain")
"""What each of `PARTS` is called in the step."""


def amiss(model: StepModel, signals: Mapping[str, ca.MX]) -> dict[str, ca.MX]:
    """Return ``amiss``, see `PARTS`, and whether the answer is ``unusable`` because of it.

    Args:
        model: model of the step.
        signals: what the step knows after its certification.
    """
    find = _amiss_function(model)
    none = ca.Function("none", find.mx_in(), [ca.MX(ca.DM.zeros(find.numel_out(0))), ca.MX(0)])
    choose = ca.Function.if_else("none_or_amiss", none, find)
    fine = ca.logic_and(signals["whole"], signals["solved"])
    flags, unusable = choose.call([fine, *(signals[name] for name in find.name_in())])
    return {"amiss": flags, "unusable": unusable}


def _amiss_function(model: StepModel) -> ca.Function:
    mx = model.symbols(kind=ca.MX)
    sums = ca.vertcat(*(ca.sumsqr(mx[name]) for name in _FINITE))
    rows = [mx["now"], mx["ahead"]]
    if model.watched:
        landed = _landed_rows(model)
        rows.append(landed(*(mx[name] for name in landed.name_in())))
    squares: Expression = sum(row**2 for row in rows)
    flags = ca.logic_not(ca.vertcat(sums < ca.inf, squares <= ca.inf))
    return mx.function("amiss", {"amiss": flags, "unusable": ca.mmax(flags)})


def _landed_rows(model: StepModel) -> ca.Function:
    """Return the function for rows (r,) at the landing pose: NaN where a watched one is, or 0."""
    sx = model.symbols((*PLACE, "shift", "S"))
    brake = model.stop(sx).braking(sx["previous"], sx["dt"])
    context = model.context(sx, model.sparse(sx["S"]), brake)
    zeros = ((limit, ca.SX.zeros(len(limit.names))) for limit in model.problem.row_limits)
    rows = [with_nan(model, limit, limit.rows(context), margins) for limit, margins in zeros]
    return sx.function("landed_rows", {"rows": ca.vertcat(*rows)})


HELD: Final = 1e-12
"""Rounding error of a margin; far below what could add up over a day of steps [m, rad]."""

GIVES_WAY: Final = 1e-3
"""How much more than braking a posture row may give way that braking already violates [rad]."""

_SHARES: Final = (1.0, 0.5, 0.25, 0.1)


def judge_function(model: StepModel) -> ca.Function:
    """Return what the object should do by this answer, and whether this is certified unchanged.

    With a guide, the trial of the place is updated too, see `ergoqp.step.guide`.

    Returns:
        Function ``(...) -> (wanted, brake, now, ahead, solved, outside, next_rest, whole,
        next_trial)``: the wanted twist and the braking twist as they can be sent, the margins now
        and through the stop, whether the QP is solved, which rows are outside, the next rest state,
        whether the wanted twist holds, and with a guide the next trial.
    """
    problem = model.problem
    signals = model.symbols(kind=ca.MX)
    margins = Margins(model, signals)
    now, count = margins.now, len(problem.row_names)
    away = ca.fmax(signals["away"][:count], signals["away"][count:]) > 0
    if problem.surface is not None:
        # A surface has no ends. A distance from it counts as outside.
        limits = (limit for limit in problem.row_limits for _ in limit.names)
        on = ca.DM([float(limit is problem.surface) for limit in limits])
        away = ca.logic_or(away, ca.logic_and(on, now < -signals["rows_tolerance"]))
    outside = ca.logic_and(away, _moves(problem, margins))
    found = call_by_name(_decide_function(model), signals, must_move=largest(outside))
    ways = found.pop("ways")
    ahead = margins.ahead(ways)
    found |= {"now": now, "ahead": ahead, "outside": outside}
    # A comparison with NaN fails, but a minimum would drop it.
    floor = _floor(model, now - signals["doubted"], numbers=signals)
    found["whole"] = is_set(smallest(ahead >= floor, 1.0))
    if watched := model.watched_rows:
        found["whole"] = ca.logic_and(found["whole"], ca.sumsqr(now[watched]) <= ca.inf)
    return signals.function("judge", found)


def _decide_function(model: StepModel) -> ca.Function:
    """Return the function for the twist that this answer asks for and for the braking twist.

    Both can be sent as they are. The stop of the first one, the rest and the trial are returned
    too.
    """
    problem, sx = model.problem, model.symbols(_LANDED)
    dt, stop, control = sx["dt"], model.stop(sx), sx.of("control")
    context = model.context(sx, model.sparse(sx["S"]))
    brake = on_surface(stop.braking(sx["previous"], dt), context, sx["usable"])
    # A cost of NaN or infinity does not reach the QP, but rest and the guide would keep it.
    finite = sx["total"] ** 2 + sx["gain"] ** 2 < ca.inf
    solved = ca.logic_and(sx["residual"] < TOLERANCE, finite)
    counts = ca.logic_and(sx["usable"], solved)
    rest = rest_update(control, sx["rest"], sx["gain"], sx["total"], sx["must_move"], dt, counts)
    trial = {}
    if model.guided:
        journey = (sx[name] for name in ("landed", "distance", "on", "promise", "value"))
        next_trial, rest = trial_update(control, sx["trial"], rest, *journey, dt=dt, counts=counts)
        trial = {"next_trial": next_trial}
    wanted = ca.if_else(
        ca.logic_and(is_set(rest[0]), ca.logic_not(sx["must_move"])), brake.twist, sx["xi"]
    )
    # The answer of a failed QP may be NaN, so it is replaced here. With no time left, only braking
    # remains.
    in_time = patience(problem.row_limits, context, sx["previous"], dt, stop) > 0
    wanted = ca.if_else(ca.logic_and(solved, in_time), wanted, brake.twist)
    wanted, slowest = (
        _kept(stop, context, twist, dt, sx["usable"]) for twist in (wanted, brake.twist)
    )
    found = {"wanted": wanted, "brake": slowest, "ways": stop.ways(wanted, dt)}
    return sx.function("decide", found | {"solved": solved, "next_rest": rest, **trial})


def shortened(model: StepModel, signals: Mapping[str, ca.MX]) -> ca.MX:
    """Return the shares (6,) of `_shorten_function`; all are one if the ``whole`` way holds."""
    shorten = _shorten_function(model)
    all_of_it = ca.Function("whole", shorten.mx_in(), [ca.MX(ca.DM.ones(6))])
    choose = ca.Function.if_else("shorten_or_not", shorten, all_of_it)
    needed = model.if_needed(ca.logic_not(signals["whole"]))
    return choose(needed, *(signals[name] for name in shorten.name_in()))


def _shorten_function(model: StepModel) -> ca.Function:
    """Return the largest certified shares (6,) of the way from braking to the wanted twist.

    A share of 0 is the braking twist.

    If no share of the whole way holds, shares of the translation or of the rotation alone are
    tried. For example, an axis that does not approach its cone must not keep the object out of its
    workspace. What held before must hold through the stop. What did not hold must not get worse. No
    more is required than braking achieves.
    """
    floor, holds = _floor_function(model), _holds_function(model)
    mx = model.symbols(kind=ca.MX)
    floor = call_by_name(floor, mx)["floor"]
    shift, turn = ca.DM([1, 1, 1, 0, 0, 0]), ca.DM([0, 0, 0, 1, 1, 1])
    candidates = [candidate * ca.DM.ones(6) for candidate in _SHARES]
    if model.problem.surface is None:
        candidates += [candidate * part for candidate in _SHARES[::2] for part in (shift, turn)]
    shares = ca.MX(ca.DM.zeros(6))
    for candidate in reversed(candidates):
        certified = call_by_name(holds, mx, floor=floor, candidate=candidate)["holds"]
        shares = ca.if_else(certified, candidate, shares)
    return mx.function("shorten", {"share": shares})


def _floor_function(model: StepModel) -> ca.Function:
    """Return the function for the margins (r,) that a shorter way has to keep, see `_floor`."""
    sx = model.symbols(_LANDED)
    at_braking = _margins(model, sx, model.sparse(sx["S"]), sx["brake"], sx["dt"])
    now = sx["now"] - sx["doubted"]
    return sx.function("floor", {"floor": _floor(model, now, at_braking, sx)})


def _holds_function(model: StepModel) -> ca.Function:
    """Return the function for whether a share of the way, `candidate` (6,), keeps a `floor` (r,).

    It is one function that is called for every share: written out, it would be half of the step.
    """
    sx = model.symbols((*_LANDED, "brake", "wanted"))
    S, count = model.sparse(sx["S"]), len(model.problem.row_names)
    floor, candidate = ca.SX.sym("floor", count), ca.SX.sym("candidate", 6)
    shorter = sx["brake"] + candidate * (sx["wanted"] - sx["brake"])
    twist = _kept(model.stop(sx), model.context(sx, S), shorter, sx["dt"])
    holds = is_set(smallest(_margins(model, sx, S, twist, sx["dt"]) >= floor, 1.0))
    sx.inputs |= {"floor": floor, "candidate": candidate}
    return sx.function("holds", {"holds": holds})


def _kept(
    stop: Stop, context: LimitContext, twist: ca.SX, dt: ca.SX, signals: ca.SX | float = 1.0
) -> ca.SX:
    """Return the twist that leads to the surface on which the state stays, see `on_surface`.

    Without a surface, return the twist unchanged.
    """
    if context.surface is None:
        return twist
    acceleration = column(stop.limit.acceleration) * signals
    return context.surface.retract(context.posture, twist, dt, acceleration)


def _margins(model: StepModel, sx: Signals, S: ca.SX, twist: ca.SX, dt: ca.SX) -> ca.SX:
    """Return the smallest margins of all rows during a period at `twist` and the stop after it."""
    ways = model.stop(sx).ways(twist, dt)
    contexts, limits = contexts_of(model, sx, S, ways), model.problem.row_limits
    return ca.vertcat(*(smallest_margins(limit, contexts, ways) for limit in limits))


def _floor(
    model: StepModel,
    now: Expression,
    at_braking: Expression = None,
    numbers: Signals | None = None,
) -> Expression:
    """Return the margins that an accepted twist must keep through its stop.

    They follow from the present margins, less what is not known of the pose, and from those of
    braking.

    Hard rows: what held must hold, what did not must not get worse, and no more is required than
    braking achieves. Where margins are lower bounds this exception does not apply: braking may be
    better than its bound, but another twist may not. In a row that bends, another twist may take
    over only little of the worsening by braking if the mean is long.

    Rows through S: what held must hold, to the accuracy of the QP. Where braking itself violates
    the row, a twist may violate it by about as much. A row that does not hold is left to the QP,
    which never moves it further out.
    """
    hard, margin_is_lower_bound = (
        ca.DM(model.values(name)) for name in ("hard", "margin_is_lower_bound")
    )
    braked = now if at_braking is None else at_braking
    given_way = ca.if_else(braked < 0, braked - GIVES_WAY, -1e-7)
    soft_floor = ca.if_else(now < 0, -FREE, given_way)
    held = ca.fmin(now, 0)
    given = model.constants if numbers is None else numbers
    inherits = column(given["rows_inherits"])
    hard_floor = held + (1 - margin_is_lower_bound) * ca.fmin(braked - held, 0)
    hard_floor = ca.fmax(hard_floor, ca.if_else(now < -inherits, -FREE, -inherits)) - HELD
    return ca.if_else(hard, hard_floor, soft_floor)


def _moves(problem: Problem, margins: Margins) -> ca.MX:
    """Return whether some twist that the object can do moves each row."""
    free = ca.DM(problem.twist_limit.speed > 0)
    return ca.vertcat(*(ca.fabs(matrix) @ free > MOVES for matrix in margins.matrices))


_SOURCE = """#include "stop.h"
int ergoqp_stop(const double* history, int planned, int sent, double average, double dt,
                const double* acceleration, double (*twists)[6], int most) {
    return ergoqp_stop_twists(history, planned, sent, average, dt, acceleration, twists, most);
}
"""


def stop_sources() -> dict[str, str]:
    """Return the C sources of the stop in closed form, by file name."""
    from ergoqp.native.compiled import c_text

    return {"stop.c": _SOURCE, "stop.h": c_text("stop.h")}


def longest_stop(problem: Problem, dt: float) -> int:
    """Return the largest number of twists of a stop, `dt` seconds each, the last one zero."""
    return int(np.floor(problem.stop.duration / dt * (1 + 1e-9))) + 2


def stop_function(model: StepModel) -> Callable[[np.ndarray, float], np.ndarray]:
    """Return ``state (n,), dt -> twists (k, 6)`` [m/s, rad/s], one per period of `dt` seconds.

    They are those of braking period by period, up to rounding. The problem must have no surface.

    Raises:
        CompilerError: if there is no C compiler, or it fails.
    """
    from ergoqp.native.compiled import loaded, shared_library
    from ergoqp.native.content import value_key
    from ergoqp.native.shipped import shipped

    sources = stop_sources()
    known = shipped("stop", value_key(sources) or "", None)
    library = known or shared_library("stop", sources, [], [])
    call = loaded(library).ergoqp_stop
    call.restype, array = ctypes.c_int, ctypes.c_void_p
    call.argtypes = [array, ctypes.c_int, ctypes.c_int, ctypes.c_double, ctypes.c_double]
    call.argtypes += [array, array, ctypes.c_int]
    problem, history = model.problem, model.history
    limits = (ctypes.c_double * 6)(*problem.twist_limit.acceleration)
    # Arrays of its own at fixed places: finding the place of an array takes as long as the call.
    given = np.zeros(sum(rows * columns for rows, columns in model.state.values()))
    usual, most = problem.dt, longest_stop(problem, problem.dt)
    found = np.empty((most, 6))
    at = given.ctypes.data, history.planned, history.sent, problem.average
    there = found.ctypes.data

    def stop(state: np.ndarray, dt: float) -> np.ndarray:
        given[:] = state
        if dt == usual:
            return found[: call(*at, dt, limits, there, most)].copy()
        count = longest_stop(problem, dt)
        twists = np.empty((count, 6))
        return twists[: call(*at, dt, limits, twists.ctypes.data, count)]

    return stop
