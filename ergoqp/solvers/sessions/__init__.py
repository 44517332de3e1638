"""The numeric solvers, one file per package; adding one is a file and a line in `SESSIONS`."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from typing import Final

from ergoqp.errors import InputError, MissingExtraError
from ergoqp.solvers.session import Session


@dataclass(frozen=True)
class Solver:
    """Where a solver is to be found.

    Attributes:
        backend: module beside this one and the class in it.
        package: that must be installed.
        warm: whether it can start from the last answer.
        method: what it does, in two words.
    """

    backend: str
    package: str
    warm: bool
    method: str


SESSIONS: Final = {
    "daqp": Solver("daqp:DaqpBackend", "daqp", True, "active set"),
    "quadprog": Solver("quadprog:QuadprogBackend", "quadprog", False, "active set"),
    "qpoases": Solver("plugins:QpoasesBackend", "casadi", True, "active set"),
    "qrqp": Solver("plugins:QrqpBackend", "casadi", False, "active set"),
    "highs": Solver("plugins:HighsBackend", "casadi", False, "active set"),
    "piqp": Solver("piqp:PiqpBackend", "piqp", False, "interior point"),
    "hpipm": Solver("plugins:HpipmBackend", "casadi", False, "interior point"),
    "clarabel": Solver("clarabel:ClarabelBackend", "clarabel", False, "interior point"),
    "proxqp": Solver("proxqp:ProxqpBackend", "proxsuite", True, "augmented Lagrangian"),
    "osqp": Solver("osqp:OsqpBackend", "osqp", True, "operator splitting"),
}
"""Solvers by name."""


def installed_sessions() -> tuple[str, ...]:
    """Return the names of the solvers whose packages are installed."""
    return tuple(name for name, solver in SESSIONS.items() if find_spec(solver.package) is not None)


def open_session(name: str, n: int, m: int, accuracy: float = 1e-6) -> Session:
    """Return a solver that stays in memory, for QPs of one size.

    Args:
        name: one of `SESSIONS`.
        n: number of unknowns.
        m: number of rows.
        accuracy: largest primal residual, dual residual and gap that are wanted; each solver's
            settings aim a little lower.

    Raises:
        InputError: for an unknown name, a size or an accuracy that cannot be.
        MissingExtraError: if the solver is not installed.
    """
    if name not in SESSIONS:
        raise InputError(f"solver: got {name!r}, allowed one of {', '.join(SESSIONS)}")
    if n < 1 or m < 0:
        raise InputError(f"solver: got {n} unknowns and {m} rows, allowed at least 1 and 0")
    if not 1e-9 <= accuracy <= 1.0:
        raise InputError(f"accuracy: got {accuracy!r}, allowed 1e-9 to 1")
    module, _, kind = SESSIONS[name].backend.partition(":")
    try:
        backend = getattr(import_module(f"ergoqp.solvers.sessions.{module}"), kind)
    except ImportError as error:
        raise MissingExtraError(
            f"solver {name!r}", "solvers", error.name or SESSIONS[name].package
        ) from None
    return Session(name, n, m, backend(n, m, accuracy))
