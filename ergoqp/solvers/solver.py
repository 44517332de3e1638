"""What a QP solver offers to the control step."""

from __future__ import annotations

from typing import ClassVar, Protocol

import casadi as ca


class QpSolver(Protocol):
    """A solver of min 1/2 x'Hx + g'x subject to lba <= A x <= uba and lbx <= x <= ubx, all dense.

    The step never trusts a solver's own word: it checks primal, dual and gap residuals of what
    comes back, and infeasible or failed answers show there. Multipliers are positive at upper
    bounds: H x + g + A' lam_a + lam_x = 0.
    """

    name: ClassVar[str]

    def function(self, n: int, m: int) -> ca.Function:
        """Return the solver as a function for n unknowns and m rows.

        It is ``(h (n, n), g (n,), a (m, n), lba, uba (m,), lbx, ubx (n,)) -> (x, lam_a, lam_x)``.

        For finite data it never raises.
        """
        ...
