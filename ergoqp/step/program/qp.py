"""The step's QP with bounds on the twist and rows through S, and its check.

Where braking itself needs the room, an exact L1 penalty is added.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import casadi as ca

from ergoqp.expressions.linear import Shape, vectors, written_out
from ergoqp.solvers.solver import FREE, QpSolver

PENALTY: Final = 1e4
"""Weight of one unit of slack, above every multiplier that the objective can cause.

So slack stays zero whenever the rows allow it (exact penalty: Nocedal and Wright, section 17.2).
"""

ELBOW: Final = 1e-6
"""Part of every cap that no row needs, so that the feasible set has an interior.

It has one even where only braking is left.
"""

_FAR: Final = 1e3

TOLERANCE: Final = 1e-6
"""Largest primal, dual and gap residual of an accepted answer."""


def build_qp(
    solver: QpSolver,
    m: int,
    shape: Shape = vectors,
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
        shape: how the check of the answer is written, see `ergoqp.expressions.linear`.
        exact: rows that must not use `ELBOW`: xi is moved back across them by at most this much.
        if_needed: gives the condition under which slack is solved for.

    Returns:
        Function ``(H, g, A, lbA, ubA, side, cap, lb, ub) -> (xi (6,), slack (m,), multipliers (m,),
        residual)``. The residual is the largest of primal, dual, gap and multiplier-sign residual
        in the infinity norm.
    """
    names = ("H", "g", "A", "lbA", "ubA", "side", "cap", "lb", "ub")
    shapes = ((6, 6), (6, 1), (m, 6), (m, 1), (m, 1), (m, 1), (m, 1), (6, 1), (6, 1))
    inputs = [ca.MX.sym(name, *shape) for name, shape in zip(names, shapes, strict=True)]
    hard = _hard(solver, m, inputs, shape)
    if m == 0:
        return hard
    relaxed = _relaxed(solver, m, inputs, shape, list(exact))
    choose = ca.Function.if_else("relaxed_or_hard", relaxed, hard)
    return ca.Function("qp", inputs, list(choose(if_needed(ca.mmax(inputs[6]) > 0), *inputs)))


def _hard(solver: QpSolver, m: int, inputs: list[ca.MX], shape: Shape) -> ca.Function:
    H, g, A, lbA, ubA, _, _, lb, ub = inputs
    x, rows, box = solver.function(6, m)(H, g, A, lbA, ubA, lb, ub)
    residual = written_out(shape(_residual(6, m)), H, g, A, lbA, ubA, lb, ub, x, rows, box)[0]
    return ca.Function("hard", inputs, [x, ca.MX(ca.DM.zeros(m)), rows, residual])


def _relaxed(
    solver: QpSolver, m: int, inputs: list[ca.MX], shape: Shape, exact: list[int]
) -> ca.Function:
    H, g, A, lbA, ubA, side, cap, lb, ub = inputs
    # The slack of a row without a cap has no effect and stays at 0 by its own curvature. With equal
    # bounds instead, DAQP was seen to lose a multiplier.
    loose = ca.if_else(cap > 0, 1.0, 0.0)
    full_H = ca.diagcat(H, ca.MX(ca.DM.eye(m)))
    full_g = ca.vertcat(g, PENALTY * loose)
    full_A = ca.horzcat(A, -ca.diag(side * loose))
    full_lb, full_ub = (
        ca.vertcat(lb, ca.MX(ca.DM.zeros(m))),
        ca.vertcat(ub, ca.if_else(cap > 0, cap, 1.0)),
    )
    n = 6 + m
    data = [ca.densify(full_H), full_g, ca.densify(full_A), lbA, ubA, full_lb, full_ub]
    x, rows, box = solver.function(n, m)(*data)
    residual = written_out(shape(_residual(n, m)), *data, x, rows, box)[0]
    xi, slack = x[:6], loose * x[6:]
    if exact:
        used = ca.fmax(0, slack[exact] - (cap[exact] - ELBOW)) * loose[exact]
        across = A[exact, :]
        xi -= across.T @ (side[exact] * used / ca.fmax(ca.sum2(across**2), ELBOW))
    return ca.Function("relaxed", inputs, [xi, slack, rows, residual])


def _residual(n: int, m: int) -> ca.Function:
    """Return the function for the largest of primal residual, dual residual and gap.

    It includes multipliers of the wrong sign or of absent bounds.

    The residuals are those of qpbenchmark, but the gap is written as complementarity: the sum of
    multiplier times distance to its bound. This is the same number if the dual residual is zero,
    and a multiplier of an absent bound is not lost in it. Dual quantities are relative to the size
    of the objective.
    """
    names = ("H", "g", "A", "lbA", "ubA", "lb", "ub", "x", "rows", "box")
    shapes = ((n, n), (n, 1), (m, n), (m, 1), (m, 1), (n, 1), (n, 1), (n, 1), (m, 1), (n, 1))
    inputs = [ca.MX.sym(name, *shape) for name, shape in zip(names, shapes, strict=True)]
    H, g, A, lbA, ubA, lb, ub, x, rows, box = inputs
    value = A @ x
    below, above = ca.vertcat(value - lbA, x - lb), ca.vertcat(ubA - value, ub - x)
    primal = -ca.fmin(ca.mmin(below), ca.mmin(above))
    stationary = H @ x + g + (rows.T @ A).T + box
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
    return ca.Function("residual", inputs, [ca.if_else(sound, residual, FREE)])
