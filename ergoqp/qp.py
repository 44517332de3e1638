"""The step's QP: bounds on the twist, rows through S, an exact L1 penalty where braking itself needs room; and its check."""

from __future__ import annotations

from typing import Final

import casadi as ca

from ergoqp.solvers import QpSolver

PENALTY: Final = 1e4
"""Weight of one unit of slack: above every multiplier that the objective can bring about, so that slack stays zero whenever
the rows allow it (exact penalty: Nocedal and Wright, section 17.2)."""

FREE: Final = 1e9
"""Stands for "no bound": large against every quantity here, and finite, so that residuals stay numbers."""

TOLERANCE: Final = 1e-6
"""Largest primal, dual and gap residual of an accepted answer."""


def build_qp(solver: QpSolver, m: int) -> ca.Function:
    """Return the QP over a twist xi (6,) and m rows, each relaxed by at most `cap` in the direction `side`.

    min 1/2 xi'H xi + g'xi + PENALTY 1's   s.t.   lower <= A xi - side s <= upper,  0 <= s <= cap,  low <= xi <= high.

    Where no row has a cap (almost always) this is a QP in six unknowns and solved as one.

    Returns:
        Function ``(H, g, A, lower, upper, side, cap, low, high) -> (xi (6,), slack (m,), multipliers (m,), residual)`` where
        the residual is the largest of primal, dual, gap and multiplier-sign residual in the infinity norm.
    """
    names = ("H", "g", "A", "lower", "upper", "side", "cap", "low", "high")
    shapes = ((6, 6), (6, 1), (m, 6), (m, 1), (m, 1), (m, 1), (m, 1), (6, 1), (6, 1))
    inputs = [ca.MX.sym(name, *shape) for name, shape in zip(names, shapes, strict=True)]
    hard = _hard(solver, m, inputs)
    relaxed = _relaxed(solver, m, inputs)
    choose = ca.Function.if_else("relaxed_or_hard", relaxed, hard)
    return ca.Function("qp", inputs, list(choose(ca.mmax(inputs[6]) > 0, *inputs)))


def _hard(solver: QpSolver, m: int, inputs: list[ca.MX]) -> ca.Function:
    H, g, A, lower, upper, _, _, low, high = inputs
    x, rows, box = solver.function(6, m)(H, g, A, lower, upper, low, high)
    residual = _residual(6, m)(H, g, A, lower, upper, low, high, x, rows, box)
    return ca.Function("hard", inputs, [x, ca.MX(ca.DM.zeros(m)), rows, residual])


def _relaxed(solver: QpSolver, m: int, inputs: list[ca.MX]) -> ca.Function:
    H, g, A, lower, upper, side, cap, low, high = inputs
    # The slack of a row without a cap touches nothing and stays at 0 by its own curvature. Between equal bounds instead, DAQP
    # was seen to lose a multiplier.
    loose = ca.if_else(cap > 0, 1.0, 0.0)
    full_H = ca.diagcat(H, ca.MX(ca.DM.eye(m)))
    full_g = ca.vertcat(g, PENALTY * loose)
    full_A = ca.horzcat(A, -ca.diag(side * loose))
    full_low, full_high = ca.vertcat(low, ca.MX(ca.DM.zeros(m))), ca.vertcat(high, ca.if_else(cap > 0, cap, 1.0))
    n = 6 + m
    data = [ca.densify(full_H), full_g, ca.densify(full_A), lower, upper, full_low, full_high]
    x, rows, box = solver.function(n, m)(*data)
    residual = _residual(n, m)(*data, x, rows, box)
    return ca.Function("relaxed", inputs, [x[:6], loose * x[6:], rows, residual])


def _residual(n: int, m: int) -> ca.Function:
    """Residuals as qpbenchmark defines them, and the signs of the multipliers, relative to the size of the dual data."""
    names = ("H", "g", "A", "lba", "uba", "lbx", "ubx", "x", "rows", "box")
    shapes = ((n, n), (n, 1), (m, n), (m, 1), (m, 1), (n, 1), (n, 1), (n, 1), (m, 1), (n, 1))
    inputs = [ca.SX.sym(name, *shape) for name, shape in zip(names, shapes, strict=True)]
    H, g, A, lba, uba, lbx, ubx, x, rows, box = inputs
    value, Hx = A @ x, H @ x
    primal = ca.fmax(ca.mmax(ca.fmax(value - uba, lba - value)), ca.mmax(ca.fmax(x - ubx, lbx - x)))
    # Multiplier of a bound that is not there must be zero: its sign residual is its size.
    scale = 1 + ca.mmax(ca.fabs(g))
    dual = ca.mmax(ca.fabs(Hx + g + A.T @ rows + box)) / scale
    at_ends = _dual_value(rows, lba, uba) + _dual_value(box, lbx, ubx)
    gap = ca.fabs(ca.dot(x, Hx) + ca.dot(g, x) + at_ends) / scale
    absent = ca.fmax(_absent(rows, lba, uba), _absent(box, lbx, ubx)) / scale
    residual = ca.fmax(ca.fmax(primal, dual), ca.fmax(gap, absent))
    # NaN compares as false everywhere: without this line a NaN answer would pass.
    residual = ca.if_else(residual >= 0, residual, FREE)
    return ca.Function("residual", inputs, [ca.if_else(ca.sumsqr(x) < FREE, residual, FREE)])


def _dual_value(multiplier: ca.SX, low: ca.SX, high: ca.SX) -> ca.SX:
    up, down = ca.fmax(multiplier, 0), ca.fmin(multiplier, 0)
    finite_high = ca.if_else(high < FREE, high, 0)
    finite_low = ca.if_else(low > -FREE, low, 0)
    return ca.dot(up, finite_high) + ca.dot(down, finite_low)


def _absent(multiplier: ca.SX, low: ca.SX, high: ca.SX) -> ca.SX:
    up, down = ca.fmax(multiplier, 0), ca.fmax(-multiplier, 0)
    return ca.mmax(ca.fmax(ca.if_else(high < FREE, 0, up), ca.if_else(low > -FREE, 0, down)))
