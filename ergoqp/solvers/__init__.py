"""QP solvers behind one protocol, one file each; adding one is a file and a line in `SOLVERS`.

An own one is an entry point, see `ergoqp.registry`.
"""

from __future__ import annotations

from typing import Final

from ergoqp.arguments import shown
from ergoqp.errors import InputError
from ergoqp.registry import own_term, registered
from ergoqp.solvers.daqp import Daqp
from ergoqp.solvers.osqp import Osqp
from ergoqp.solvers.piqp import Piqp
from ergoqp.solvers.solver import QpSolver as QpSolver

SOLVERS: Final[dict[str, type[QpSolver]]] = {solver.name: solver for solver in (Daqp, Piqp, Osqp)}
"""Solver classes by name, for the control step.

`ergoqp.solvers.sessions` has more, for sequences of QPs outside it.
"""


def solver_named(name: str) -> QpSolver:
    """Return a solver by its name.

    Raises:
        InputError: if there is none of that name.
    """
    if isinstance(name, str) and name in SOLVERS:
        return SOLVERS[name]()
    own = registered("solver")
    if name in own:
        return own_term("solver", name)()
    raise InputError(f"solver: got {shown(name)}, allowed one of {', '.join([*SOLVERS, *own])}")
