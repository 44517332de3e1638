"""OSQP: operator splitting (Stellato and others, Math. Prog. Comp. 12, 2020)."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import osqp

from ergoqp.solvers.session import Qp, QpAnswer, Workspace, no_answer
from ergoqp.solvers.solver import GrowingPattern, QpSolver

_SETTINGS: Final = {
    "verbose": False,
    "eps_rel": 0.0,
    "max_iter": 20000,
    "check_termination": 10,
    # Stop by the residuals of the given data, not of its scaled copy.
    "scaled_termination": False,
    # The units are already of one size. With scaling, QPs with a large slack penalty take ten times
    # as many iterations.
    "scaling": 0,
    # Polishing prints a line when no row is active, even without `verbose`.
    "polishing": False,
    # A large slack penalty makes multipliers large. A looser test takes them for a certificate of
    # infeasibility.
    "eps_prim_inf": 1e-9,
}
_RHO: Final = 0.1
_FLAGS: Final = {
    "solved": "solved",
    "primal infeasible": "infeasible",
    "primal infeasible inaccurate": "infeasible",
    "maximum iterations reached": "stopped",
    "solved inaccurate": "stopped",
}


class Osqp(QpSolver):
    """First-order method: slower here, but independent of active sets, for comparison."""

    name = "osqp"
    method = "operator splitting"
    warm = True

    def workspace(self, n: int, m: int, accuracy: float) -> Workspace:
        """Return memory with a warm start from x and multipliers."""
        return _OsqpWorkspace(n, m, accuracy)


class _OsqpWorkspace:
    """One `osqp.OSQP` that is updated with new values.

    It is set up again when an entry becomes nonzero that was always zero before.
    """

    def __init__(self, n: int, m: int, accuracy: float) -> None:
        """Keep the sizes; OSQP allocates with the first data."""
        self._n, self._m = n, m
        self._settings = _SETTINGS | {"eps_abs": accuracy / 10}
        self._forget()

    def solve(self, qp: Qp, warm: bool) -> QpAnswer:
        """Solve; `warm`: start from x, multipliers and step size of the last QP."""
        P, A = np.triu(qp.H), np.concatenate([qp.A, np.eye(self._n)])
        lower, upper = np.concatenate([qp.lbA, qp.lb]), np.concatenate([qp.ubA, qp.ub])
        if not warm and not (self._P.holds_only(P) and self._A.holds_only(A)):
            # Nonzero entries of earlier QPs must not have an effect.
            self._forget()
        grown = [self._P.grow(P), self._A.grow(A)]
        if self._solver is None or any(grown):
            made = osqp.OSQP()
            made.setup(
                self._P.csc(P), qp.g, self._A.csc(A), lower, upper, rho=_RHO, **self._settings
            )
            self._solver = made
        else:
            if not warm:
                self._solver.update_settings(rho=_RHO)
                self._solver.warm_start(x=np.zeros(self._n), y=np.zeros(self._m + self._n))
            self._solver.update(
                q=qp.g, l=lower, u=upper, Px=self._P.values(P), Ax=self._A.values(A)
            )
        result = self._solver.solve(raise_error=False)
        if "interrupt" in result.info.status:
            # OSQP catches the user's interrupt itself.
            raise KeyboardInterrupt
        flag = _FLAGS.get(result.info.status, "failed")
        if flag != "solved":
            # Do not start from the state of a failed solve.
            self._forget()
            return no_answer(self._n, self._m, flag, result.info.iter)
        x, both = np.array(result.x), np.array(result.y)
        return QpAnswer(x, both[: self._m], both[self._m :], flag, result.info.iter)

    def _forget(self) -> None:
        self._P, self._A = GrowingPattern(), GrowingPattern()
        self._solver: Any = None
