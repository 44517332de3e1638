"""quadprog: the dual method of Goldfarb and Idnani (Math. Programming 27, 1983).

It keeps nothing and cannot start warm.
"""

from __future__ import annotations

import numpy as np
import quadprog

from ergoqp.solvers.equalities import pattern_of
from ergoqp.solvers.sequence import Qp
from ergoqp.solvers.session import QpAnswer, no_answer


class QuadprogBackend:
    """A call per QP; exact, so there is no accuracy to set."""

    def __init__(self, n: int, m: int, accuracy: float) -> None:
        """Keep the sizes."""
        self._n, self._m = n, m

    def solve(self, qp: Qp, warm: bool) -> QpAnswer:
        """Solve; `warm` makes no difference."""
        pattern = pattern_of(qp)
        (C, d), (G, h) = pattern.equalities(qp), pattern.inequalities(qp)
        # Its form is rows x >= bounds, equalities first.
        rows, bounds = np.concatenate([C, -G]), np.concatenate([d, -h])
        try:
            x, _, _, iterations, found, _ = quadprog.solve_qp(
                qp.H, -qp.g, *((rows.T, bounds, len(d)) if len(bounds) else ())
            )
        except ValueError as error:
            return no_answer(
                self._n, self._m, "infeasible" if "inconsistent" in str(error) else "failed"
            )
        lam_rows, lam_box = pattern.multipliers(-found[: len(d)], found[len(d) :])
        return QpAnswer(x, lam_rows, lam_box, "solved", int(iterations[0]))
