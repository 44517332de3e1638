"""PIQP's dense workspace (Schwan and others, CDC 2023): proximal interior point.

It cannot start warm.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import piqp

from ergoqp.solvers.equalities import pattern_of
from ergoqp.solvers.sequence import Qp
from ergoqp.solvers.session import QpAnswer, no_answer

_FLAGS: Final = {
    piqp.PIQP_SOLVED: "solved",
    piqp.PIQP_PRIMAL_INFEASIBLE: "infeasible",
    piqp.PIQP_MAX_ITER_REACHED: "stopped",
}


class PiqpBackend:
    """One `piqp.DenseSolver`; set up anew when other bounds meet or vanish, and after a failure."""

    def __init__(self, n: int, m: int, accuracy: float) -> None:
        """Keep the sizes; PIQP allocates when it is known which bounds meet."""
        # It stops at the tolerance in the sum of many small multipliers; each of them must be
        # within the accuracy.
        self._n, self._m, self._accuracy = n, m, max(accuracy / 100, 1e-10)
        self._solver: Any = None
        self._key = b""

    def solve(self, qp: Qp, warm: bool) -> QpAnswer:
        """Solve; memory is kept, `warm` makes no difference."""
        pattern = pattern_of(qp)
        C, d = pattern.equalities(qp)
        kept = pattern.above | pattern.below
        low, high = np.where(pattern.low, qp.low, -np.inf), np.where(pattern.high, qp.high, np.inf)
        data = (qp.H, qp.g, C, d, qp.A[kept], qp.lower[kept], qp.upper[kept], low, high)
        if self._solver is None or pattern.key != self._key:
            self._solver, self._key = self._made(), pattern.key
            self._solver.setup(*map(np.asfortranarray, data))
        else:
            self._solver.update(*map(np.asfortranarray, data))
        flag = _FLAGS.get(self._solver.solve(), "failed")
        result = self._solver.result
        if flag != "solved":
            self._solver = None
            return no_answer(self._n, self._m, flag, result.info.iter)
        rows, box = np.zeros(self._m), result.z_bu - result.z_bl
        count = int(pattern.fixed_rows.sum())
        rows[pattern.fixed_rows], box[pattern.fixed] = result.y[:count], result.y[count:]
        rows[kept] = result.z_u - result.z_l
        return QpAnswer(np.array(result.x), rows, box, flag, result.info.iter)

    def _made(self) -> Any:
        solver = piqp.DenseSolver()
        settings = solver.settings
        settings.eps_abs, settings.eps_rel = self._accuracy, 0.0
        settings.check_duality_gap, settings.eps_duality_gap_abs, settings.eps_duality_gap_rel = (
            True,
            self._accuracy,
            0.0,
        )
        settings.verbose = False
        return solver
