"""The QP of a step: its data for a set of locked joints, its check, and its answer in passes.

It has bounds on the twist and rows through S. Where braking itself needs the room, an exact L1
penalty is added. Every solver and every other formulation starts from its data. Each pass solves,
locks joints that would leave their range, and solves again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final

import casadi as ca
import numpy as np

from ergoqp.expressions import Shape, call_by_name, is_set, marked, vectors, written_out
from ergoqp.limits import Rows
from ergoqp.limits.twist_and_stopping import Braking, on_surface
from ergoqp.problem.problem import Problem
from ergoqp.solvers.solver import FREE, QpSolver
from ergoqp.step.delay import off_rows
from ergoqp.step.layout import ASTRAY
from ergoqp.step.model import PLACE, StepModel
from ergoqp.step.objective import cost_function, objective
from ergoqp.step.rows import ELBOW, no_further, patience, row_bounds, unhurried

PENALTY: Final = 1e4
"""Weight of one unit of slack, above every multiplier that the objective can cause.

So slack stays zero whenever the rows allow it (exact penalty: Nocedal and Wright, section 17.2).
"""

_FAR: Final = 1e3

TOLERANCE: Final = 1e-6
"""Largest primal, dual and gap residual of an accepted answer."""


def build_qp(
    solver: QpSolver,
    m: int,
    exact: Sequence[int] = (),
    if_needed: Callable[[ca.MX], ca.MX] = lambda needed: needed,
) -> ca.Function:
    """Return the QP over a twist xi (6,) and m rows.

    Each row is relaxed by at most `cap` in the direction `side`.

    min 1/2 xi'H xi + g'xi + PENALTY 1's   s.t.   lbA <= A xi - side s <= ubA,  0 <= s <= cap,
    lb <= xi <= ub.

    If no row has a cap (almost always) this is a QP in six unknowns, and it is solved as one.

    Args:
        solver: solver of the QP.
        m: number of rows.
        exact: rows that must not use `ELBOW`: xi is moved back across them by at most this much.
        if_needed: gives the condition under which slack is solved for.

    Returns:
        Function ``(H, g, A, lbA, ubA, side, cap, lb, ub) -> (xi (6,), slack (m,), multipliers (m,),
        residual)``. The residual is the largest of primal, dual, gap and multiplier-sign residual
        in the infinity norm.
    """
    inputs = _qp_inputs(m)
    hard = _hard(solver, m, inputs)
    if m == 0:
        return hard
    relaxed = _relaxed(solver, m, inputs, list(exact))
    choose = ca.Function.if_else("relaxed_or_hard", relaxed, hard)
    return ca.Function("qp", inputs, list(choose(if_needed(ca.mmax(inputs[6]) > 0), *inputs)))


def _hard(solver: QpSolver, m: int, inputs: list[ca.MX]) -> ca.Function:
    H, g, A, lbA, ubA, _, _, lb, ub = inputs
    x, rows, box = solver.function(6, m)(H, g, A, lbA, ubA, lb, ub)
    residual = written_out(_judge(m, relaxed=False), *inputs, x, rows, box)[0]
    return ca.Function("hard", inputs, [x, ca.MX(ca.DM.zeros(m)), rows, residual])


def _relaxed(solver: QpSolver, m: int, inputs: list[ca.MX], exact: list[int]) -> ca.Function:
    _, _, A, _, _, side, cap, _, _ = inputs
    loose = ca.if_else(cap > 0, 1.0, 0.0)
    x, rows, box = solver.function(6 + m, m)(*_with_slack(m, inputs, loose))
    residual = written_out(_judge(m, relaxed=True), *inputs, x, rows, box)[0]
    xi, slack = x[:6], loose * x[6:]
    if exact:
        used = ca.fmax(0, slack[exact] - (cap[exact] - ELBOW)) * loose[exact]
        across = A[exact, :]
        xi -= across.T @ (side[exact] * used / ca.fmax(ca.sum2(across**2), ELBOW))
    return ca.Function("relaxed", inputs, [xi, slack, rows, residual])


def _with_slack(m: int, inputs: list[ca.MX], loose: ca.MX) -> list[ca.MX]:
    """Return the QP over twist and slack, of the twist's QP and which rows have a cap (m,)."""
    H, g, A, lbA, ubA, side, cap, lb, ub = inputs
    # The slack of a row without a cap has no effect and stays at 0 by its own curvature. With equal
    # bounds instead, DAQP was seen to lose a multiplier.
    full_H = ca.diagcat(H, ca.MX(ca.DM.eye(m)))
    full_g = ca.vertcat(g, PENALTY * loose)
    full_A = ca.horzcat(A, -ca.diag(side * loose))
    full_lb = ca.vertcat(lb, ca.MX(ca.DM.zeros(m)))
    full_ub = ca.vertcat(ub, ca.if_else(cap > 0, cap, 1.0))
    return [ca.densify(full_H), full_g, ca.densify(full_A), lbA, ubA, full_lb, full_ub]


def slack_function(m: int) -> ca.Function:
    """Return ``QP_DATA -> (full_H, full_g, full_A, full_lb, full_ub)``: twist and slack (6 + m,).

    The slack of a row without a cap is 0 in its answer.
    """
    inputs = _qp_inputs(m)
    H, g, A, _, _, lb, ub = _with_slack(m, inputs, ca.if_else(inputs[6] > 0, 1.0, 0.0))
    found = {"full_H": H, "full_g": g, "full_A": A, "full_lb": lb, "full_ub": ub}
    return ca.Function("with_slack", inputs, list(found.values()), list(QP_DATA), list(found))


def _qp_inputs(m: int) -> list[ca.MX]:
    shapes = ((6, 6), (6, 1), (m, 6), (m, 1), (m, 1), (m, 1), (m, 1), (6, 1), (6, 1))
    return [ca.MX.sym(name, *shape) for name, shape in zip(QP_DATA, shapes, strict=True)]


def _judge(m: int, relaxed: bool) -> ca.Function:
    """``(*QP_DATA, x, rows, box) -> residual`` of an answer, over twist and slack if `relaxed`.

    It is the largest of primal residual, dual residual and gap. It includes multipliers of the
    wrong sign or of absent bounds.

    The residuals are those of qpbenchmark, but the gap is written as complementarity: the sum of
    multiplier times distance to its bound. This is the same number if the dual residual is zero,
    and a multiplier of an absent bound is not lost in it. Dual quantities are relative to the size
    of the objective.
    """
    n, inputs = 6 + m * relaxed, _qp_inputs(m)
    H, g, A, lbA, ubA, side, cap, lb, ub = inputs
    answer = [ca.MX.sym("x", n), ca.MX.sym("rows", m), ca.MX.sym("box", n)]
    x, rows, box = answer
    value, stationary = A @ x[:6], H @ x[:6] + g + (rows.T @ A).T + box[:6]
    if relaxed:
        # What `_with_slack` adds, without its matrices, which are almost empty.
        loose, slack = ca.if_else(cap > 0, 1.0, 0.0), x[6:]
        own, price = side * loose, PENALTY * loose
        value -= own * slack
        stationary = ca.vertcat(stationary, slack + price - own * rows + box[6:])
        g = ca.vertcat(g, price)
        lb, ub = ca.vertcat(lb, ca.MX.zeros(m)), ca.vertcat(ub, ca.if_else(cap > 0, cap, 1.0))
    below, above = ca.vertcat(value - lbA, x - lb), ca.vertcat(ubA - value, ub - x)
    primal = -ca.fmin(ca.mmin(below), ca.mmin(above))
    dual = ca.mmax(ca.fabs(stationary))
    multiplier = ca.vertcat(rows, box)
    up, down = ca.fmax(multiplier, 0), ca.fmax(-multiplier, 0)
    # A larger distance counts as `_FAR`. That is enough to show a multiplier that should be zero,
    # but not the rounding of a solver.
    gap = ca.fabs(ca.dot(up, ca.fmin(above, _FAR)) + ca.dot(down, ca.fmin(below, _FAR)))
    residual = ca.fmax(0, ca.fmax(primal, ca.fmax(dual, gap) / (1 + ca.mmax(ca.fabs(g)))))
    # fmax and mmax drop NaN. A sum of squares keeps it, and the comparison with infinity fails.
    everything = ca.sumsqr(stationary) + ca.sumsqr(below) + ca.sumsqr(above)
    sound = ca.logic_and(ca.sumsqr(x) < FREE, everything <= ca.inf)
    return ca.Function("judge", [*inputs, *answer], [ca.if_else(sound, residual, FREE)])


QP_DATA: Final = ("H", "g", "A", "lbA", "ubA", "side", "cap", "lb", "ub")
"""Arguments of `ergoqp.step.qp.build_qp`, in its order."""


def qp_data(problem: Problem) -> ca.Function:
    """Return the QP of a step with nothing under way, as a function of what the step knows.

    Nothing is under way if every twist is sent as planned (`Control.average` 0) and no robot is
    declared.

    Returns:
        Function ``(posture (n,), observed (n,), pose (4, 4), previous (6,), dt, stalled, locked
        (n,), final) -> (*QP_DATA, S, E)``, by these names. `stalled` is the time without an
        improvement [s]. `locked` is 1 for joints that do not follow. `final` 1 treats joints close
        to their end like all other rows (the last locking pass); 0 lets them be locked instead. The
        rows of `A` are those of `movable_names`.
    """
    model = StepModel(problem)
    names = ("posture", "observed", "pose", "previous", "dt", "stalled", "locked", "final")
    given = model.symbols(names, ca.MX)
    signals = given | {"landed": given["pose"], "way": ca.MX(ca.DM.zeros(*model.size("way")))}
    signals |= {"asks": ca.MX(1), "astray": ca.MX(ca.DM.zeros(ASTRAY))}
    for function in (model.readings, cost_function(model), away_function(model), pass_data(model)):
        signals |= call_by_name(function, signals)
    outputs = [*QP_DATA, "S", "E"]
    parts = [signals[name] for name in outputs]
    return ca.Function("qp_data", list(given.values()), parts, list(given), outputs)


def movable_names(problem: Problem) -> tuple[str, ...]:
    """Return the names of the rows in the step's QP: the rows that some twist can move."""
    return tuple(problem.row_names[i] for i in StepModel(problem).movable)


AWAY: Final = ("posture", "observed", "readings", "pose", "asks", "astray")
"""Arguments of `away_function`."""


def pass_data(model: StepModel, shape: Shape = vectors) -> ca.Function:
    """Return the QP of one locking pass, its largest parts in the given shape.

    The function is ``(*PLACE, away, total, gradient, stalled, locked, final) -> (*QP_DATA, S, E,
    shift)``; `away` is that of `away_function`. Geometry is written as scalars. What is the same
    for every row is written as vectors, which an interpreter runs many times faster, and which a
    compiler turns into fewer instructions.
    """
    problem, kept = model.problem, model.movable
    names = (*PLACE, "away", "total", "gradient", "stalled", "locked", "final")
    mx = model.symbols(names, ca.MX)
    S, E = model.sensitivity(mx, mx["posture"], mx["locked"], shape)
    function, follows = _terms(model)
    shift = S @ mx["way"][:6]
    terms = call_by_name(function, mx, shift=shift, S=S)
    away = mx["away"][[*kept, *(len(problem.row_names) + row for row in kept)]]
    brake = Braking(**{name: terms[name] for name in _BRAKING}, dt=mx["dt"], stop=model.stop(mx))
    matrix = _gathered(S, terms["own"], follows)
    rows = Rows(matrix, **{name: terms[name] for name in _VECTORS})
    twist, limits = problem.twist_limit, problem.row_limits
    numbers = mx.pick(("rows_yield_zone", "rows_recovery_time"))
    bounds = row_bounds(twist, limits, rows, kept, away, brake, mx["final"], numbers)
    parts = model.symbols(kind=ca.MX)
    terms = parts.function("objective", objective(model, parts))
    terms = call_by_name(shape(terms), mx, written=True, S=S, E=E)
    H, g = terms["H"], terms["g"]
    # Bounds drop the NaN of a row. In the objective it shows in the residual.
    seen = [k for k, row in enumerate(kept) if row in model.watched_rows]
    if seen:
        g = marked(g, *(ca.sumsqr(getattr(rows, part)[seen]) for part in _VECTORS))
    found = {"H": H, "g": g, **bounds, "lb": brake.low, "ub": brake.high}
    return mx.function("pass_data", found | {"S": S, "E": E, "shift": shift})


_BRAKING: Final = ("twist", "low", "high", "reach")


def _terms(model: StepModel) -> tuple[ca.Function, list[int | None]]:
    """Return the parts of rows and braking, and which movable rows are rows of S.

    The function is ``(*PLACE, shift, S) -> (own, *_VECTORS, *_BRAKING)``, for the movable rows and
    the braking of this period. `own` (k, 6) holds the rows that are not rows of S.
    """
    problem, kept = model.problem, model.movable
    sx = model.symbols((*PLACE, "shift", "S"))
    S, stop = model.sparse(sx["S"]), model.stop(sx)
    brake = stop.braking(sx["previous"], sx["dt"])
    context = model.context(sx, S, brake)
    brake = on_surface(brake, context)
    brake = unhurried(brake, patience(problem.row_limits, context, sx["previous"], sx["dt"], stop))
    twist = problem.twist_limit
    rows = [no_further(twist, limit, limit.rows(context), brake) for limit in problem.row_limits]
    numbered = [(each, i) for each in rows for i in range(each.matrix.shape[0])]
    moving = [numbered[k] for k in kept]
    follows = [i if each.matrix is context.sensitivity else None for each, i in moving]
    own = [row for row, of_S in zip(moving, follows, strict=True) if of_S is None]
    matrix = ca.vertcat(ca.SX(0, 6), *(each.matrix[i, :] for each, i in own))
    found = {"own": matrix}
    for part in _VECTORS:
        found[part] = ca.vertcat(ca.SX(0, 1), *(getattr(each, part)[i] for each, i in moving))
    found |= {name: getattr(brake, name) for name in _BRAKING}
    return sx.function("terms", found), follows


def away_function(model: StepModel) -> ca.Function:
    """``AWAY -> (away (2 r,), doubted (r,))``: how far rows are beyond their ends.

    `away` is how far rows that ask to come back are beyond their upper ends, then their lower ones.
    It is 0 for rows that do not ask, and for rows within the tolerance, the declared noise of the
    pose, or what is not known of it. It uses the present pose, not the landing pose, so it does not
    depend on S. `asks` is 0 when rows of the posture have given up.

    `doubted` is how much smaller the present margin of a hard row may be than computed, by what is
    not known of the pose.
    """
    problem, signals = model.problem, model.symbols(AWAY)
    context = model.context(signals, model.sparse(ca.SX.ones(*model.size("S"))))
    above, below, doubted = [ca.SX(0, 1)], [ca.SX(0, 1)], [ca.SX(0, 1)]
    for limit in problem.row_limits:
        rows = limit.rows(context)
        tolerance = model.of_rows(signals, "tolerance", limit)
        to_upper, to_lower = ca.fmin(rows.to_upper, FREE), ca.fmin(rows.to_lower, FREE)
        upper = lower = tolerance
        less = ca.SX.zeros(len(limit.names))
        if limit.hard:
            noise = ca.fabs(rows.matrix) @ model.robot(signals).noise
            off = off_rows(ca.SX(rows.matrix), signals["astray"], [limit])
            upper, lower = (tolerance + noise + part for part in off)
            less = ca.fmin(to_upper, to_lower) - ca.fmin(to_upper - off[0], to_lower - off[1])
        doubted.append(less)
        returning = ca.DM(np.broadcast_to(limit.recovers, rows.matrix.shape[0]).astype(float))
        asking = returning * (1 if limit.hard else signals["asks"]) > 0.5
        for found, distance, allowed in ((above, to_upper, upper), (below, to_lower, lower)):
            found.append(ca.if_else(ca.logic_and(asking, distance < -allowed), -distance, 0))
    found = {"away": ca.vertcat(*above, *below), "doubted": ca.vertcat(*doubted)}
    return signals.function("away", found)


_VECTORS: Final = ("to_lower", "to_upper", "rate", "curvature_margin")


def _gathered(S: ca.MX, own: ca.MX, follows: list[int | None]) -> ca.MX:
    """Return the rows of the QP, those of S and the others in order, by one copy of numbers."""
    n, k = S.shape[0], own.shape[0]
    in_S, in_own = np.arange(6 * n).reshape(6, n).T, S.numel() + np.arange(6 * k).reshape(6, k).T
    others = iter(in_own)
    places = [in_S[row] if row is not None else next(others) for row in follows]
    everything = ca.vertcat(ca.vec(S), ca.vec(own)) if k else ca.vec(S)
    return (
        ca.reshape(everything[np.ravel(places, order="F").tolist()], len(follows), 6)
        if places
        else ca.MX(0, 6)
    )


PASSES: Final = 3
"""Largest number of locking passes."""

_PULL: Final = ("pull_H", "pull_g")


def solve_passes(
    model: StepModel,
    solver: QpSolver,
    signals: Mapping[str, ca.MX],
    shape: Shape,
    with_data: bool = False,
) -> dict[str, ca.MX]:
    """Return the answer of the QP after as many passes as there are joints to lock.

    Args:
        model: model of the step.
        solver: solver of the QP.
        signals: the inputs of `ergoqp.step.qp.pass_data` except the lock; with a guide also
            ``pull_H`` and ``pull_g``, which are added to the objective.
        shape: how functions are written, see `ergoqp.expressions`.
        with_data: whether the QP of the last pass is returned too.

    Returns:
        ``xi`` (6,), ``S`` and ``E`` of the last pass, ``slack`` and ``multipliers`` of the movable
        rows, the largest ``residual`` of the QP, which joints are ``locked``, whether there are
        more to lock, and ``shift``, see `ergoqp.limits.LimitContext`. ``with_data`` also `QP_DATA`.
    """
    one_pass = _one_pass(model, solver, shape, with_data)
    unlocked = {"locked": ca.MX(ca.DM.zeros(*model.size("locked"))), "final": ca.MX(0)}
    first = call_by_name(one_pass, {**signals, **unlocked}, written=True)
    fixed = [signals[name] for name in one_pass.name_in() if name not in unlocked]
    found = written_out(_further_passes(model, one_pass, 1), *fixed, *first.values())
    result = dict(zip(first, found, strict=True))
    return result | {"locked": result.pop("next_locked")}


def _further_passes(model: StepModel, one_pass: ca.Function, number: int) -> ca.Function:
    """``(inputs of a pass, its result) -> result`` after the passes that joints to lock require.

    Each pass is inside the branch of the one before. So a step without such a joint checks only
    once.
    """
    names = one_pass.name_in()
    symbols = {name: ca.MX.sym("i", one_pass.sparsity_in(name)) for name in names}
    inputs = [symbols[name] for name in names if name not in _LOCK]
    result = [ca.MX.sym("r", one_pass.sparsity_out(i)) for i in range(one_pass.n_out())]
    named = dict(zip(one_pass.name_out(), result, strict=True))
    last = number == PASSES - 1
    lock = {"locked": named["next_locked"], "final": ca.MX(float(last))}
    next_one = list(call_by_name(one_pass, symbols | lock).values())
    if last:
        after = next_one
    else:
        after = list(_further_passes(model, one_pass, number + 1)(*inputs, *next_one))
    again = ca.Function("again", [*inputs, *result], after)
    enough = ca.Function("enough", [*inputs, *result], result)
    choose = ca.Function.if_else("next_pass", again, enough)
    everything = list(choose(model.if_needed(named["newly"]), *inputs, *result))
    return ca.Function("further_passes", [*inputs, *result], everything)


def _one_pass(model: StepModel, solver: QpSolver, shape: Shape, with_data: bool) -> ca.Function:
    """Return one QP with a given lock set, by the inputs ``locked`` and ``final``."""
    data = pass_data(model, shape)
    names = [*data.name_in(), *(_PULL if model.guided else ())]
    mx = model.symbols(names, ca.MX)
    found = call_by_name(data, mx, written=True)
    if model.guided:
        found |= {"H": found["H"] + mx["pull_H"], "g": found["g"] + mx["pull_g"]}
    exact = np.flatnonzero(model.values("hard")[model.movable])
    qp = build_qp(solver, len(model.movable), exact.tolist(), model.if_needed)
    answer = dict(zip(_ANSWER, written_out(qp, *(found[name] for name in QP_DATA)), strict=True))
    # Solvers keep bounds up to their tolerance. The twist bounds must hold exactly.
    xi = ca.fmin(ca.fmax(answer["xi"], found["lb"]), found["ub"])
    lock = _newly_locked(model)
    known = {**answer, "xi": xi, "S": found["S"]}
    newly = call_by_name(lock, mx, written=True, **known)["newly_locked"]
    kept = ("S", "E", "shift", *(QP_DATA if with_data else ()))
    result = {**answer, "xi": xi, **{name: found[name] for name in kept}}
    result |= {"next_locked": ca.fmax(mx["locked"], newly), "newly": ca.mmax(newly)}
    return mx.function("one_pass", result)


_LOCK: Final = ("locked", "final")

_ANSWER: Final = ("xi", "slack", "multipliers", "residual")


def _newly_locked(model: StepModel) -> ca.Function:
    """Return the function for unlocked joints at their end that would move outward."""
    mx = model.symbols(("posture", "observed", "readings", "locked", "S", "xi", "residual"), ca.MX)
    where = mx.pick(("posture", "observed", "readings"))
    context = model.context(where, mx["S"], numbers=mx)
    outward = ca.MX(ca.DM.zeros(*model.size("locked")))
    for limit in model.problem.row_limits:
        if not limit.yield_zone:
            continue
        rows = limit.rows(context)
        rate = rows.matrix @ mx["xi"]
        zone = model.of_rows(mx, "yield_zone", limit)
        up = ca.logic_and(rows.to_upper < zone, rate > 1e-6)
        down = ca.logic_and(rows.to_lower < zone, rate < -1e-6)
        outward = ca.logic_or(outward, ca.logic_or(up, down))
    free = ca.logic_and(outward, ca.logic_not(is_set(mx["locked"])))
    newly = ca.logic_and(free, mx["residual"] < TOLERANCE)
    return mx.function("newly_locked", {"newly_locked": newly})
