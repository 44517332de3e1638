"""PIQP: proximal interior point (Schwan, Jiang, Kuhn, Jones, CDC 2023), by its CasADi plugin."""

from __future__ import annotations

from typing import ClassVar

import casadi as ca

from ergoqp.solvers.plugin import plugin_function

# With a relative part beside the absolute one it went on to its last iteration where slack is dear,
# 1e4 to the unit.
_SETTINGS = {
    "verbose": False,
    "eps_abs": 1e-8,
    "eps_rel": 0.0,
    "check_duality_gap": True,
    "eps_duality_gap_abs": 1e-8,
    "eps_duality_gap_rel": 0.0,
    "max_iter": 100,
}


class Piqp:
    """Interior point: some times slower than the default.

    Its time hardly depends on how many rows are active.
    """

    name: ClassVar[str] = "piqp"

    def function(self, n: int, m: int) -> ca.Function:
        """Return the solver for `n` unknowns and `m` rows; see `QpSolver`."""
        return plugin_function("piqp", n, m, {"piqp": _SETTINGS})
