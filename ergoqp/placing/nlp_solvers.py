"""Nonlinear solvers by name, their settings for the required residual, and the program's modes."""

from __future__ import annotations

from typing import Any, Final

import casadi as ca

from ergoqp.arguments import shown
from ergoqp.errors import InputError

MODES: Final = ("stackelberg", "cooperative")
"""Who chooses the posture: the person alone, by coming to rest; or the optimiser too.

The second mode is an optimistic bound.
"""

SETTINGS: Final[dict[str, dict[str, Any]]] = {
    "ipopt": {
        "ipopt": {
            "print_level": 0,
            "sb": "yes",
            "tol": 1e-9,
            "max_iter": 60,
            "mu_strategy": "adaptive",
        },
        "print_time": False,
    },
    "fatrop": {
        "fatrop": {"print_level": 0, "tol": 1e-9, "max_iter": 100},
        "structure_detection": "none",
        "print_time": False,
    },
    "sqpmethod": {
        "qpsol": "qrqp",
        "qpsol_options": {
            "print_iter": False,
            "print_header": False,
            "print_info": False,
            "error_on_fail": False,
        },
        "convexify_strategy": "regularize",
        "max_iter": 60,
        "tol_pr": 1e-9,
        "tol_du": 1e-8,
        "print_header": False,
        "print_iteration": False,
        "print_status": False,
        "print_time": False,
    },
}

SOLVERS: Final = tuple(SETTINGS)
"""Nonlinear solvers by name."""


def check_names(mode: str, solver: str) -> None:
    """Check the names of mode and solver.

    Raises:
        InputError: if one of them is unknown, or CasADi was built without the solver.
    """
    for what, value, allowed in (("mode", mode, MODES), ("solver", solver, SOLVERS)):
        if not isinstance(value, str) or value not in allowed:
            raise InputError(f"{what}: got {shown(value)}, allowed {', '.join(allowed)}")
    if not ca.has_nlpsol(solver):
        others = ", ".join(name for name in SOLVERS if ca.has_nlpsol(name))
        raise InputError(
            f"solver: got {solver!r}, which this build of CasADi does not have, allowed {others}"
        )
