"""DAQP: dual active-set method (Arnström, Bemporad, Axehill, IEEE TAC 67(8), 2022).

It is exact at the sizes met here.
"""

from __future__ import annotations

from typing import ClassVar

import casadi as ca

from ergoqp.solvers.plugin import plugin_function


class Daqp:
    """The default: a few microseconds per QP, answers exact to rounding."""

    name: ClassVar[str] = "daqp"

    def function(self, n: int, m: int) -> ca.Function:
        """Return the solver for `n` unknowns and `m` rows; see `QpSolver`."""
        return plugin_function(
            "daqp", n, m, {"daqp": {"primal_tol": 1e-9, "dual_tol": 1e-10, "iter_limit": 500}}
        )
