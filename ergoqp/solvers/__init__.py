"""QP solvers with one interface, `ergoqp.solvers.solver.QpSolver`.

The control step and the comparison use the same names. A new solver needs a file and a line in
`SOLVERS`. A user's solver is an entry point, see `ergoqp.registry`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
    """Where to find a solver.

    Attributes:
        where: module in this folder and class in it.
        package: package that must be installed.
    """

    where: str
    package: str


SOLVERS: Final = {
    "daqp": Listed("daqp:Daqp", "daqp"),
    "quadprog": Listed("from_qpsolvers:Quadprog", "quadprog"),
    "qpoases": Listed("casadi_solvers:Qpoases", "casadi"),
    "qrqp": Listed("casadi_solvers:Qrqp", "casadi"),
    "highs": Listed("casadi_solvers:Highs", "casadi"),
    "piqp": Listed("from_qpsolvers:Piqp", "piqp"),
    "hpipm": Listed("casadi_solvers:Hpipm", "casadi"),
    "clarabel": Listed("from_qpsolvers:Clarabel", "clarabel"),
    "proxqp": Listed("proxqp:Proxqp", "proxsuite"),
    "osqp": Listed("osqp:Osqp", "osqp"),
}
"""Solvers by name. If qpsolvers is installed, its other solvers are available by their names there.

Example:
    >>> from ergoqp.solvers import SOLVERS
    >>> SOLVERS["daqp"].package
    'daqp'
"""


def installed_solvers() -> tuple[str, ...]:
    """Return the names in `SOLVERS` whose packages are installed.

    Example:
        >>> from ergoqp.solvers import installed_solvers
        >>> "daqp" in installed_solvers()
        True
    """
    return tuple(name for name, one in SOLVERS.items() if find_spec(one.package) is not None)


def solver_named(name: str) -> QpSolver:
    """Return a solver by its name.

    Raises:
        InputError: if there is no solver of that name, or two.
        MissingExtraError: if it is not installed.

    Example:
        >>> from ergoqp.solvers import solver_named
        >>> solver_named("qpoases").name
        'qpoases'
    """
    more: Sequence[str] = ()
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
        if name in registered("solver"):
            return _own(name)
    names = dict.fromkeys([*SOLVERS, *more, *registered("solver")])
    raise InputError(f"solver: got {shown(name)}, allowed one of {', '.join(names)}")


def read_solver(solver: str | QpSolver) -> QpSolver:
    """Return a solver by its name, or the user's object after a trial.

    Raises:
        InputError: if there is no solver of that name, or two, or the object is not a `QpSolver`
            that gives workspaces.
        MissingExtraError: if it is not installed.

    Example:
        >>> from ergoqp.solvers import read_solver
        >>> read_solver("daqp").name
        'daqp'
    """
    if isinstance(solver, str):
        return solver_named(solver)
    if not isinstance(solver, QpSolver):
        raise InputError(
            f"solver: got {shown(solver)}, allowed a name, or an object of a class that is derived"
            " from ergoqp.solvers.QpSolver"
        )
    try:
        usable = callable(getattr(solver.workspace(6, 1, 1e-7), "solve", None))
        got = "a workspace without solve"
    except Exception as error:  # any error of a user's solver
        usable, got = False, in_words(error)
    if not usable:
        raise InputError(
            f"solver {solver.name}: got {got}, allowed a workspace with solve(qp, warm) for any"
            " size"
        )
    return solver


@cache
def _made(make: Callable[..., Any], name: str, *given: str) -> Any:
    """Make a solver once, and keep it with its name."""
    return make(*given)


def _own(name: str) -> QpSolver:
    make = own_term("solver", name)
    try:
        solver = _made(make, name)
    except Exception as error:  # any error in the user's package
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
        name: name of the solver.
        n: number of unknowns.
        m: number of rows.
        accuracy: requested bound of primal residual, dual residual and gap, in the units of the QP.
            The settings of each solver are slightly tighter.

    Raises:
        InputError: if the name is unknown, or the size or the accuracy is out of range.
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
    except Exception as error:  # any error of a user's solver
        raise InputError(
            f"solver {name}: got {in_words(error)}, allowed a workspace for any size"
        ) from None
