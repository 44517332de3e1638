"""Clarabel (Goulart and Chen, 2024): interior point, homogeneous embedding, no warm start."""

from __future__ import annotations

from typing import Any, Final

import clarabel as clarabel_package
import numpy as np

from ergoqp.solvers.equalities import pattern_of
from ergoqp.solvers.patterns import GrowingPattern
from ergoqp.solvers.sequence import Qp
from ergoqp.solvers.session import QpAnswer, no_answer

# Made of compiled classes only, which type checkers do not see.
clarabel: Any = clarabel_package

_FLAGS: Final = {
    clarabel.SolverStatus.Solved: "solved",
    clarabel.SolverStatus.PrimalInfeasible: "infeasible",
    clarabel.SolverStatus.AlmostPrimalInfeasible: "infeasible",
    clarabel.SolverStatus.MaxIterations: "stopped",
    clarabel.SolverStatus.AlmostSolved: "stopped",
}


class ClarabelBackend:
    """One `clarabel.DefaultSolver` that is updated with new values.

    It is set up anew when other bounds meet or vanish.
    """

    def __init__(self, n: int, m: int, accuracy: float) -> None:
        """Keep the sizes; Clarabel allocates when it is known which bounds meet."""
        self._n, self._m = n, m
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        # They are relative to the size of the data where that is above one; with slack that is 1e4.
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = accuracy / 100
        # By default the linear systems are solved less exactly than that needs, and it stops short.
        settings.static_regularization_constant = 1e-12
        settings.iterative_refinement_abstol = settings.iterative_refinement_reltol = 1e-14
        # Both would take rows out, and then new data could not be put in.
        settings.presolve_enable = settings.input_sparse_dropzeros = False
        self._settings = settings
        self._solver: Any = None
        self._P, self._A = GrowingPattern(), GrowingPattern()
        self._key = b""

    def solve(self, qp: Qp, warm: bool) -> QpAnswer:
        """Solve; memory is kept, `warm` makes no difference."""
        pattern = pattern_of(qp)
        (C, d), (G, h) = pattern.equalities(qp), pattern.inequalities(qp)
        P, A, b = np.triu(qp.H), np.concatenate([C, G]), np.concatenate([d, h])
        grown = [self._P.grow(P), self._A.grow(A)]
        if self._solver is None or any(grown) or pattern.key != self._key:
            cones = [clarabel.ZeroConeT(len(d)), clarabel.NonnegativeConeT(len(h))]
            self._solver = clarabel.DefaultSolver(
                self._P.csc(P), qp.g, self._A.csc(A), b, cones, self._settings
            )
            self._key = pattern.key
        else:
            self._solver.update(P=self._P.values(P), q=qp.g, A=self._A.values(A), b=b)
        found = self._solver.solve()
        flag = _FLAGS.get(found.status, "failed")
        if flag != "solved":
            self._solver = None
            return no_answer(self._n, self._m, flag, found.iterations)
        z = np.array(found.z)
        rows, box = pattern.multipliers(z[: len(d)], z[len(d) :])
        return QpAnswer(np.array(found.x), rows, box, flag, found.iterations)
