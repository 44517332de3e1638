"""DAQP: dual active-set method (Arnström, Bemporad, Axehill, IEEE TAC 67(8), 2022).

It is exact for QPs of the sizes used here.
"""

from __future__ import annotations

from ctypes import c_int
from typing import Any, Final

import casadi as ca
import daqp
import numpy as np

from ergoqp.expressions import ldl, ldl_solve, smallest
from ergoqp.solvers.session import Qp, QpAnswer, Workspace, no_answer
from ergoqp.solvers.solver import QpSolver, shapes_of

# The control step uses CasADi's plugin, which is compiled code like the rest of the step.
_IN_STEP: Final = {"primal_tol": 1e-9, "dual_tol": 1e-10}
ITERATIONS: Final = 500
"""Largest number of iterations for one QP of the control step."""

_FEW: Final = 6
"""Number of unknowns up to which Newton's step is worth a try: those of a twist."""

# It stops at a vertex of the active constraints, so more accuracy costs nothing. Reducing
# equalities first is meant for single solves.
_SETTINGS: Final = {"iter_limit": 1000, "eq_reduction": -1}
_FLAGS: Final = {-1: "infeasible", -4: "stopped", -7: "stopped", -6: "infeasible"}
_EQUALITY: Final = 5


class Daqp(QpSolver):
    """The default solver: a few microseconds per QP, answers exact up to rounding."""

    name = "daqp"
    method = "active set"
    warm = True

    def workspace(self, n: int, m: int, accuracy: float) -> Workspace:
        """Return memory with a warm start from the last active set."""
        return _DaqpWorkspace(n, m, accuracy)

    def function(self, n: int, m: int) -> ca.Function:
        """Return the solver for `n` unknowns and `m` rows, without Python code.

        For few unknowns Newton's step comes first: it is the answer if it is within all bounds, as
        in most steps of a loop.
        """
        active_set = self.active_set(n, m)
        return active_set if n > _FEW else _newton_first(active_set, n, m)

    def active_set(self, n: int, m: int) -> ca.Function:
        """Return DAQP itself, as `function`."""
        qp = in_step(n, m, ITERATIONS)
        names = ["h", "g", "a", "lba", "uba", "lbx", "ubx"]
        shapes = shapes_of(n, m)[0]
        inputs = [ca.MX.sym(name, *shape) for name, shape in zip(names, shapes, strict=True)]
        answer = qp(**dict(zip(names, inputs, strict=True)))
        return ca.Function("daqp", inputs, [answer["x"], answer["lam_a"], answer["lam_x"]])


def _newton_first(active_set: ca.Function, n: int, m: int) -> ca.Function:
    inputs = active_set.mx_in()
    H, g, A, lba, uba, lbx, ubx = inputs
    matrix, right = ca.SX.sym("H", n, n), ca.SX.sym("g", n)
    factors = ldl(matrix)
    newton = ca.Function(
        "newton",
        [matrix, right],
        [ca.densify(-ldl_solve(factors, right)), smallest(factors[1]) > 0],
    )
    x, definite = newton(H, g)
    value = A @ x
    # A comparison with NaN fails.
    within = [lbx <= x, x <= ubx, lba <= value, value <= uba]
    free = ca.logic_and(definite, smallest(ca.vertcat(*within)) > 0)
    none = [ca.MX(ca.DM.zeros(count)) for count in (m, n)]
    unbounded = ca.Function("unbounded", [x_ := ca.MX.sym("x", n), *inputs], [x_, *none])
    bounded = ca.Function("bounded", [x_, *inputs], list(active_set(*inputs)))
    choose = ca.Function.if_else("free_or_not", unbounded, bounded)
    return ca.Function("daqp", inputs, list(choose(free, x, *inputs)))


def in_step(n: int, m: int, iterations: int) -> ca.Function:
    """Return CasADi's plugin with the settings of the control step.

    Args:
        n: number of unknowns.
        m: number of rows.
        iterations: largest number of iterations.
    """
    shapes = {"h": ca.Sparsity.dense(n, n), "a": ca.Sparsity.dense(m, n)}
    settings = {**_IN_STEP, "iter_limit": iterations}
    return ca.conic("qp", "daqp", shapes, {"error_on_fail": False, "daqp": settings})


class _DaqpWorkspace:
    """Memory of one `daqp.Model`."""

    def __init__(self, n: int, m: int, accuracy: float) -> None:
        """Make the workspace; DAQP allocates with the first data."""
        self._n, self._m = n, m
        self._settings = _SETTINGS | {
            "primal_tol": min(1e-9, accuracy),
            "dual_tol": min(1e-10, accuracy),
        }
        self._model: Any = None
        self._sense = np.zeros(n + m, dtype=c_int)
        self._solved = False

    def solve(self, qp: Qp, warm: bool) -> QpAnswer:
        """Solve; `warm`: start from the active set of the last QP."""
        n = self._n
        upper, lower = np.concatenate([qp.ub, qp.ubA]), np.concatenate([qp.lb, qp.lbA])
        sense = np.where(upper == lower, _EQUALITY, 0).astype(c_int)
        same = self._solved and np.array_equal(sense, self._sense)
        self._sense = sense
        if self._model is None:
            self._model = daqp.Model()
            self._model.settings = self._settings
            flag = self._model.setup(qp.H, qp.g, qp.A, upper, lower, sense)[0]
        elif warm and same:
            # Without `sense` the active set stays.
            flag = self._model.update(qp.H, qp.g, qp.A, upper, lower)
        else:
            flag = self._model.update(qp.H, qp.g, qp.A, upper, lower, sense.copy())
        if flag < 0:
            return self._forget(flag, None)
        x, _, flag, info = self._model.solve()
        if flag != 1:
            return self._forget(flag, info["iterations"])
        self._solved = True
        both = np.array(info["lam"])
        return QpAnswer(np.array(x), both[n:], both[:n], "solved", info["iterations"])

    def _forget(self, flag: int, iterations: int | None) -> QpAnswer:
        # Do not start from the state of a failed solve.
        self._model, self._solved = None, False
        return no_answer(self._n, self._m, _FLAGS.get(flag, "failed"), iterations)
