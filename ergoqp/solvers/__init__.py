"""QP solvers behind one protocol, `ergoqp.solvers.solver.QpSolver`.

The same names serve the control step and the comparison. Adding one is a file and a line in
`SOLVERS`; an own one is an entry point, see `ergoqp.registry`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from typing import Any, Final

from ergoqp.arguments import shown
from ergoqp.errors import InputError, MissingExtraError, in_words
from ergoqp.registry import check_free, own_term, registered
from ergoqp.solvers.session import Session
from ergoqp.solvers.solver import QpSolver as QpSolver


@dataclass(frozen=True)
class Listed:
    """Where a solver is to be found.

    Attributes:
        where: module beside this one and class in it.
        package: that must be installed.
    """

    where: str
    package: str


SOLVERS: Final = {
    "daqp": Listed("daqp:Daqp", "daqp"),
    "quadprog": Listed("from_qpsolvers:Quadprog", "quadprog"),
    "qpoases": Listed("plugins:Qpoases", "casadi"),
    "qrqp": Listed("plugins:Qrqp", "casadi"),
    "highs": Listed("plugins:Highs", "casadi"),
    "piqp": Listed("from_qpsolvers:Piqp", "piqp"),
    "hpipm": Listed("plugins:Hpipm", "casadi"),
    "clarabel": Listed("from_qpsolvers:Clarabel", "clarabel"),
    "proxqp": Listed("proxqp:Proxqp", "proxsuite"),
    "osqp": Listed("osqp:Osqp", "osqp"),
}
"""Solvers by name; whatever else qpsolvers offers where it is installed goes by its name there.

Example:
    >>> from ergoqp.solvers import SOLVERS
    >>> SOLVERS["daqp"].package
    'daqp'
"""


def installed_solvers() -> tuple[str, ...]:
    """Return the names out of `SOLVERS` whose packages are installed.

    Example:
        >>> from ergoqp.solvers import installed_solvers
        >>> "daqp" in installed_solvers()
        True
    """
    return tuple(name for name, one in SOLVERS.items() if find_spec(one.package) is not None)


def solver_named(name: str) -> QpSolver:
    """Return a solver by its name.

    Raises:
        InputError: if there is none of that name, or two.
        MissingExtraError: if it is not installed.

    Example:
        >>> from ergoqp.solvers import solver_named
        >>> solver_named("qpoases").name
        'qpoases'
    """
    own, more = registered("solver"), ()
    if isinstance(name, str):
        if name in SOLVERS:
            check_free("solver", [name])
            return _listed(name)
        if find_spec("qpsolvers") is not None:
            from qpsolvers import available_solvers as more

            if name in more:
                from ergoqp.solvers.from_qpsolvers import Offered

                check_free("solver", [name])
                return _made(Offered, name, name)
        if name in own:
            return _own(name)
    names = dict.fromkeys([*SOLVERS, *more, *own])
    raise InputError(f"solver: got {shown(name)}, allowed one of {', '.join(names)}")


@cache
def _made(make: Callable[..., Any], name: str, *given: str) -> Any:
    """Make a solver once: what it is called by stays as long as it does."""
    return make(*given)


def _own(name: str) -> QpSolver:
    make = own_term("solver", name)
    try:
        solver = _made(make, name)
    except Exception as error:  # whatever the user's package does
        raise InputError(
            f"solver {name}: got {in_words(error)} when it was made, allowed a QpSolver that is"
            " made of nothing"
        ) from None
    if not isinstance(solver, QpSolver):
        raise InputError(f"solver {name}: got {shown(solver)}, allowed a QpSolver")
    solver.name = name
    return solver


def _listed(name: str) -> QpSolver:
    one = SOLVERS[name]
    module, _, kind = one.where.partition(":")
    try:
        if find_spec(one.package) is None:
            raise ImportError(name=one.package)
        return _made(getattr(import_module(f"ergoqp.solvers.{module}"), kind), name)
    except ImportError as error:
        package = error.name or one.package
        raise MissingExtraError(f"solver {name!r}", "solvers", package) from None


def open_session(name: str, n: int, m: int, accuracy: float = 1e-6) -> Session:
    """Return a solver that stays in memory, for QPs of one size.

    Args:
        name: of the solver.
        n: number of unknowns.
        m: number of rows.
        accuracy: largest primal residual, dual residual and gap that are wanted, in the units of
            the QP. The settings of each solver aim a little lower.

    Raises:
        InputError: for an unknown name, a size or an accuracy that cannot be.
        MissingExtraError: if the solver is not installed.

    Example:
        >>> import numpy as np
        >>> from ergoqp.solvers import open_session
        >>> session = open_session("daqp", n=2, m=1)
        >>> answer = session.solve(
        ...     np.eye(2), [-1, -1], [[1, 1]], [-np.inf], [1], [-9, -9], [9, 9]
        ... )
        >>> answer.x.round(6).tolist(), answer.found
        ([0.5, 0.5], True)
    """
    solver = solver_named(name)
    if n < 1 or m < 0:
        raise InputError(f"solver: got {n} unknowns and {m} rows, allowed at least 1 and 0")
    if not 1e-9 <= accuracy <= 1.0:
        raise InputError(f"accuracy: got {accuracy!r}, allowed 1e-9 to 1")
    try:
        return Session(name, n, m, lambda: solver.workspace(n, m, accuracy))
    except Exception as error:  # an own solver's
        raise InputError(
            f"solver {name}: got {in_words(error)}, allowed a workspace for any size"
        ) from None
