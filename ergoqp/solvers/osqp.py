"""OSQP: operator splitting (Stellato and others, Math. Prog. Comp. 12, 2020).

It is tightened to the accuracy the step asks for.
"""

from __future__ import annotations

from typing import ClassVar

import casadi as ca

from ergoqp.solvers.plugin import plugin_function

# Its own defaults (1e-3) leave bounds violated by up to 1e-3; these meet the 1e-6 that the step
# checks.
_SETTINGS = {
    "verbose": False,
    "eps_abs": 1e-9,
    "eps_rel": 1e-9,
    "max_iter": 20000,
    # Polishing would print a line of its own at every step without an active row, whatever
    # `verbose` says.
    "polishing": False,
    "check_termination": 10,
    "scaled_termination": False,
    # The units are of one size already; scaled once more, QPs whose slack is dear did not end
    # within the iterations allowed.
    "scaling": 0,
}


class Osqp:
    """First-order method: slower here, independent of the active-set path, to compare and check."""

    name: ClassVar[str] = "osqp"

    def function(self, n: int, m: int) -> ca.Function:
        """Return the solver for `n` unknowns and `m` rows; see `QpSolver`."""
        return plugin_function("osqp", n, m, {"osqp": _SETTINGS})
