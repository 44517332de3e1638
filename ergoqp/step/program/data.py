"""The data of the step's QP, for a given set of locked joints.

Every solver and every other formulation starts from these data.
"""

from __future__ import annotations

from typing import Final

import casadi as ca
import numpy as np

from ergoqp.expressions.linear import by_name, dense, marked, written_out
from ergoqp.limits import Rows
from ergoqp.limits.stop import Braking, on_surface
from ergoqp.problem.problem import Problem
from ergoqp.solvers.solver import FREE
from ergoqp.step.model import PLACE, StepModel
from ergoqp.step.program.bounds import no_further, patience, row_bounds, unhurried
from ergoqp.step.program.objective import cost_function, objective
from ergoqp.step.robot_watch.memory import ASTRAY
from ergoqp.step.under_way.landing import off_rows

QP_DATA: Final = ("H", "g", "A", "lbA", "ubA", "side", "cap", "lb", "ub")
"""Arguments of `ergoqp.step.program.qp.build_qp`, in its order."""


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
    known = given | {"landed": given["pose"], "way": ca.MX(ca.DM.zeros(*model.size("way")))}
    known |= {"asks": ca.MX(1), "astray": ca.MX(ca.DM.zeros(ASTRAY))}
    for function in (model.readings, cost_function(model), away_function(model), pass_data(model)):
        known |= by_name(function, known)
    outputs = [*QP_DATA, "S", "E"]
    parts = [known[name] for name in outputs]
    return ca.Function("qp_data", list(given.values()), parts, list(given), outputs)


def movable_names(problem: Problem) -> tuple[str, ...]:
    """Return the names of the rows in the step's QP: the rows that some twist can move."""
    return tuple(problem.row_names[i] for i in StepModel(problem).movable)


AWAY: Final = ("posture", "observed", "readings", "pose", "asks", "astray")
"""Arguments of `away_function`."""


def pass_data(model: StepModel) -> ca.Function:
    """Return the QP of one locking pass.

    The function is ``(*PLACE, away, total, gradient, stalled, locked, final) -> (*QP_DATA, S, E,
    shift)``; `away` is that of `away_function`. Geometry is written as scalars. What is the same
    for every row is written as vectors, which an interpreter runs many times faster.
    """
    problem, kept = model.problem, model.movable
    names = (*PLACE, "away", "total", "gradient", "stalled", "locked", "final")
    mx = model.symbols(names, ca.MX)
    S, E = written_out(model.response.sensitivity(), mx["posture"], mx["locked"])
    function, follows = _terms(model)
    shift = S @ mx["way"][:6]
    terms = by_name(function, mx | {"shift": shift, "S": S})
    away = mx["away"][[*kept, *(len(problem.row_names) + row for row in kept)]]
    brake = Braking(**{name: terms[name] for name in _BRAKING}, dt=mx["dt"], stop=problem.stop)
    matrix = _gathered(S, terms["own"], follows)
    rows = Rows(matrix, **{name: terms[name] for name in _VECTORS})
    bounds = row_bounds(
        problem.twist_limit, problem.row_limits, rows, kept, away, brake, mx["final"]
    )
    H, g = objective(model, mx, S, E)
    # Bounds drop the NaN of a row. In the objective it shows in the residual.
    seen = [k for k, row in enumerate(kept) if row in model.watched_rows]
    if seen:
        g = marked(g, *(ca.sumsqr(getattr(rows, part)[seen]) for part in _VECTORS))
    found = {
        "H": H,
        "g": g,
        "A": bounds.matrix,
        "lbA": bounds.lower,
        "ubA": bounds.upper,
        "side": bounds.side,
        "cap": bounds.cap,
        "lb": brake.low,
        "ub": brake.high,
        "S": S,
        "E": E,
        "shift": shift,
    }
    outputs = [ca.densify(part) for part in found.values()]
    return ca.Function("pass_data", list(mx.values()), outputs, list(mx), list(found))


_BRAKING: Final = ("twist", "low", "high", "reach")


def _terms(model: StepModel) -> tuple[ca.Function, list[int | None]]:
    """Return the parts of rows and braking, and which movable rows are rows of S.

    The function is ``(*PLACE, shift, S) -> (own, *_VECTORS, *_BRAKING)``, for the movable rows and
    the braking of this period. `own` (k, 6) holds the rows that are not rows of S.
    """
    problem, kept = model.problem, model.movable
    sx = model.symbols((*PLACE, "shift", "S"))
    S, stop = model.sparse(sx["S"]), problem.stop
    brake = stop.braking(sx["previous"], sx["dt"])
    situation = model.situation(sx, S, brake)
    brake = on_surface(brake, situation)
    brake = unhurried(
        brake, patience(problem.row_limits, situation, sx["previous"], sx["dt"], stop)
    )
    twist = problem.twist_limit
    rows = [no_further(twist, limit, limit.rows(situation), brake) for limit in problem.row_limits]
    numbered = [(each, i) for each in rows for i in range(each.matrix.shape[0])]
    moving = [numbered[k] for k in kept]
    follows = [i if each.matrix is situation.sensitivity else None for each, i in moving]
    own = [row for row, of_S in zip(moving, follows, strict=True) if of_S is None]
    matrix = ca.vertcat(ca.SX(0, 6), *(each.matrix[i, :] for each, i in own))
    ends = [_stacked([getattr(each, part)[i] for each, i in moving]) for part in _VECTORS]
    parts = [matrix, *ends, *(getattr(brake, name) for name in _BRAKING)]
    names = ["own", *_VECTORS, *_BRAKING]
    return ca.Function("terms", list(sx.values()), ca.cse(dense(parts)), list(sx), names), follows


def away_function(model: StepModel) -> ca.Function:
    """``AWAY -> (away (2 r,), doubted (r,))``: how far rows are beyond their ends.

    `away` is how far rows that ask to come back are beyond their upper ends, then their lower ones.
    It is 0 for rows that do not ask, and for rows within the tolerance, the declared noise of the
    pose, or what is not known of it. It uses the present pose, not the landing pose, so it does not
    depend on S. `asks` is 0 when rows of the posture have given up.

    `doubted` is how much smaller the present margin of a hard row may be than computed, by what is
    not known of the pose.
    """
    problem, known = model.problem, model.symbols(AWAY)
    situation = model.situation(known, model.sparse(ca.SX.ones(*model.size("S"))))
    above, below, doubted = [ca.SX(0, 1)], [ca.SX(0, 1)], [ca.SX(0, 1)]
    for limit in problem.row_limits:
        rows = limit.rows(situation)
        to_upper, to_lower = ca.fmin(rows.above, FREE), ca.fmin(rows.below, FREE)
        upper = lower = ca.SX(limit.tolerance)
        less = ca.SX.zeros(len(limit.names))
        if limit.hard:
            noise = ca.fabs(rows.matrix) @ ca.DM(problem.robot.noise)
            off = off_rows(ca.SX(rows.matrix), known["astray"], [limit])
            upper, lower = (limit.tolerance + noise + part for part in off)
            less = ca.fmin(to_upper, to_lower) - ca.fmin(to_upper - off[0], to_lower - off[1])
        doubted.append(less)
        returning = ca.DM(np.broadcast_to(limit.returns, rows.matrix.shape[0]).astype(float))
        asking = returning * (1 if limit.hard else known["asks"]) > 0.5
        for found, distance, allowed in ((above, to_upper, upper), (below, to_lower, lower)):
            found.append(ca.if_else(ca.logic_and(asking, distance < -allowed), -distance, 0))
    outputs = ca.cse(dense([ca.vertcat(*above, *below), ca.vertcat(*doubted)]))
    return ca.Function("away", list(known.values()), outputs, list(known), ["away", "doubted"])


_VECTORS: Final = ("below", "above", "rate", "reserve")


def _stacked(entries: list[ca.SX]) -> ca.SX:
    return ca.vertcat(ca.SX(0, 1), *entries)


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
