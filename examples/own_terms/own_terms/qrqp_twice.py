"""A QP solver: CasADi's own, started once more where it ended."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ergoqp.expressions import Evaluator
from ergoqp.solvers.session import Qp, QpAnswer
from ergoqp.solvers.solver import QpSolver

_SILENT = {"print_iter": False, "print_header": False, "print_info": False}


class QrqpTwice(QpSolver):
    """An active-set method by QR; the second run mends what the first left over."""

    name = "qrqp_twice"
    method = "active set"

    def workspace(self, n: int, m: int, accuracy: float) -> Twice:
        """Return what solves QPs of one size, one after the other."""
        return Twice(n, m)


class Twice:
    """CasADi's function, and where it starts."""

    def __init__(self, n: int, m: int) -> None:
        """Make the function."""
        shapes = {"h": ca.Sparsity.dense(n, n), "a": ca.Sparsity.dense(m, n)}
        options = {"error_on_fail": False, "max_iter": 100, **_SILENT}
        self._solve = Evaluator(ca.conic("qp", "qrqp", shapes, options))
        self._cold = {"x0": np.zeros(n), "lam_a0": np.zeros(m), "lam_x0": np.zeros(n)}

    def solve(self, qp: Qp, warm: bool) -> QpAnswer:
        """Solve; the flag is not looked at: the step and the comparison judge the answer."""
        bounds = {"lba": qp.lbA, "uba": qp.ubA, "lbx": qp.lb, "ubx": qp.ub}
        given = {"h": qp.H, "g": qp.g, "a": qp.A, "q": np.zeros(0), "p": np.zeros(0), **bounds}
        first = self._solve({**given, **self._cold})
        start = {"x0": first["x"], "lam_a0": first["lam_a"], "lam_x0": first["lam_x"]}
        found = self._solve({**given, **start})
        return QpAnswer(found["x"], found["lam_a"], found["lam_x"], "solved")
