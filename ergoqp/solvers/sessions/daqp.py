"""DAQP's own workspace: an exact active-set method that starts warm from the last active set.

Reference: Arnström, Bemporad, Axehill, IEEE TAC 67(8), 2022.
"""

from __future__ import annotations

from ctypes import c_int
from typing import Any, Final

import daqp
import numpy as np

from ergoqp.solvers.sequence import Qp
from ergoqp.solvers.session import QpAnswer, no_answer

# It stops at a vertex of the active constraints, so that more accuracy costs nothing. Reducing
# equalities first is meant for single solves.
_SETTINGS: Final = {"iter_limit": 1000, "eq_reduction": -1}
_FLAGS: Final = {-1: "infeasible", -4: "stopped", -7: "stopped", -6: "infeasible"}
_EQUALITY: Final = 5


class DaqpBackend:
    """One `daqp.Model`; see `ergoqp.solvers.session.Backend`."""

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
        """Solve; warm: from the active set of the last QP."""
        n = self._n
        upper, lower = np.concatenate([qp.high, qp.upper]), np.concatenate([qp.low, qp.lower])
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
        # What a failed solve leaves behind is no place to start from.
        self._model, self._solved = None, False
        return no_answer(self._n, self._m, _FLAGS.get(flag, "failed"), iterations)
