"""ProxQP, dense: proximal augmented Lagrangian (Bambade and others, RSS 2022)."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from proxsuite import proxqp

from ergoqp.solvers.session import Qp, QpAnswer, Workspace, no_answer
from ergoqp.solvers.solver import Pattern, QpSolver

# On infeasible data it uses all allowed iterations. Feasible QPs took at most 19 outer iterations.
_MOST_ITERATIONS: Final = 50
_MOST_INNER: Final = 100
_FLAGS: Final = {
    proxqp.QPSolverOutput.PROXQP_SOLVED: "solved",
    proxqp.QPSolverOutput.PROXQP_PRIMAL_INFEASIBLE: "infeasible",
    proxqp.QPSolverOutput.PROXQP_MAX_ITER_REACHED: "stopped",
}


class Proxqp(QpSolver):
    """Exact up to its accuracy in a few outer iterations."""

    name = "proxqp"
    method = "augmented Lagrangian"
    warm = True

    def workspace(self, n: int, m: int, accuracy: float) -> Workspace:
        """Return memory with a warm start from x and multipliers."""
        return _ProxqpWorkspace(n, m, accuracy)


class _ProxqpWorkspace:
    """One `proxqp.dense.QP`, set up again when other bounds are equal (its equalities)."""

    def __init__(self, n: int, m: int, accuracy: float) -> None:
        """Keep the sizes; ProxQP allocates when it is known which bounds are equal."""
        self._n, self._m, self._accuracy = n, m, accuracy / 10
        self._solver: Any = None
        self._key = b""

    def solve(self, qp: Qp, warm: bool) -> QpAnswer:
        """Solve; `warm`: start from x and multipliers of the last QP."""
        pattern = Pattern(qp)
        C, d = pattern.equalities()
        free = ~pattern.fixed_rows
        # The bounds of a fixed unknown would be a row without an interior, besides its equality.
        low = np.where(pattern.fixed, -np.inf, qp.lb)
        high = np.where(pattern.fixed, np.inf, qp.ub)
        data = (qp.H, qp.g, C, d, qp.A[free], qp.lbA[free], qp.ubA[free], low, high)
        key = np.concatenate([pattern.fixed_rows, pattern.fixed]).tobytes()
        if self._solver is None or key != self._key or not warm:
            self._solver, self._key = self._made(len(d), int(free.sum())), key
            self._solver.init(*data)
        else:
            # Continuing with the step sizes of the last QP too took hundreds of iterations instead
            # of a few.
            guess = proxqp.InitialGuess.COLD_START_WITH_PREVIOUS_RESULT
            self._solver.settings.initial_guess = guess
            self._solver.update(*data, update_preconditioner=True)
        self._solver.solve()
        results = self._solver.results
        flag = _FLAGS.get(results.info.status, "failed")
        if flag != "solved":
            self._solver = None
            return no_answer(self._n, self._m, flag, results.info.iter)
        rows, box = np.zeros(self._m), np.zeros(self._n)
        count = int(pattern.fixed_rows.sum())
        rows[pattern.fixed_rows], box[pattern.fixed] = results.y[:count], results.y[count:]
        rows[free] = results.z[: int(free.sum())]
        box[~pattern.fixed] = results.z[int(free.sum()) :][~pattern.fixed]
        return QpAnswer(np.array(results.x), rows, box, flag, results.info.iter)

    def _made(self, equalities: int, rows: int) -> Any:
        solver = proxqp.dense.QP(self._n, equalities, rows, True)
        settings = solver.settings
        settings.eps_abs = self._accuracy
        settings.eps_rel = 0.0
        settings.max_iter = _MOST_ITERATIONS
        settings.max_iter_in = _MOST_INNER
        settings.check_duality_gap = True
        settings.eps_duality_gap_abs = self._accuracy
        settings.eps_duality_gap_rel = 0.0
        # A large slack penalty makes multipliers large. A looser test takes them for a certificate
        # of infeasibility.
        settings.eps_primal_inf = 1e-12
        settings.initial_guess = proxqp.InitialGuess.NO_INITIAL_GUESS
        return solver
