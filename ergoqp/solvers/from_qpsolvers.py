"""Every solver that qpsolvers offers (Caron and others), set up again for each QP.

The conversion of its inputs is part of the measured times, as for its users.
"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import qpsolvers
from scipy.sparse import csc_matrix

from ergoqp.solvers.session import Array, Qp, QpAnswer, Workspace, no_answer
from ergoqp.solvers.solver import Pattern, QpSolver


class FromQpsolvers(QpSolver):
    """A solver by its name in qpsolvers; a subclass gives the name and the settings."""

    method = "by qpsolvers"

    def settings(self, accuracy: float) -> dict[str, Any]:
        """Return the settings for the solver. An empty dict keeps its defaults."""
        return {}

    def workspace(self, n: int, m: int, accuracy: float) -> Workspace:
        """Return an object with the settings; there is no memory."""
        return _QpsolversWorkspace(self.name, self.settings(accuracy))


class Offered(FromQpsolvers):
    """Any solver that qpsolvers offers, with its default settings for any accuracy.

    Args:
        name: one of `qpsolvers.available_solvers`.
    """

    def __init__(self, name: str) -> None:
        """Keep the name."""
        self.name = name


class Quadprog(FromQpsolvers):
    """The dual method of Goldfarb and Idnani (Math. Programming 27, 1983); exact."""

    name = "quadprog"
    method = "active set"


class Piqp(FromQpsolvers):
    """PIQP (Schwan and others, CDC 2023): proximal interior point, dense."""

    name = "piqp"
    method = "interior point"

    def settings(self, accuracy: float) -> dict[str, Any]:
        """Return the tolerances.

        PIQP applies its tolerance to the sum of many small multipliers, but each of them must be
        within the accuracy. With an additional relative tolerance it used all its iterations for
        QPs with a large slack penalty.
        """
        least = max(accuracy / 100, 1e-10)
        gap = {"check_duality_gap": True, "eps_duality_gap_abs": least, "eps_duality_gap_rel": 0.0}
        return {"eps_abs": least, "eps_rel": 0.0, **gap}


class Clarabel(FromQpsolvers):
    """Clarabel (Goulart and Chen, 2024): interior point, homogeneous embedding."""

    name = "clarabel"
    method = "interior point"

    def settings(self, accuracy: float) -> dict[str, Any]:
        """Return the tolerances, which are relative to the size of the data if that is above one.

        With slack the size is 1e4. By default, the linear systems are not solved exactly enough for
        this, and the solver stops early.
        """
        names = ("tol_gap_abs", "tol_gap_rel", "tol_feas")
        refined = ("iterative_refinement_abstol", "iterative_refinement_reltol")
        exact = dict.fromkeys(refined, 1e-14) | {"static_regularization_constant": 1e-12}
        exact |= {"presolve_enable": False}
        return dict.fromkeys(names, accuracy / 100) | exact


class _QpsolversWorkspace:
    """The name and the settings of a solver."""

    def __init__(self, name: str, settings: dict[str, Any]) -> None:
        self._name, self._settings = name, settings
        self._matrix = np.asarray if name in qpsolvers.dense_solvers else csc_matrix

    def solve(self, qp: Qp, warm: bool) -> QpAnswer:
        """Solve; `warm` has no effect."""
        pattern = Pattern(qp)
        # Bounds are written as rows, because not every solver accepts one-sided or infinite bounds.
        equal, unequal = pattern.equalities(), pattern.inequalities()
        problem = qpsolvers.Problem(
            self._matrix(qp.H), qp.g, *self._rows(unequal), *self._rows(equal)
        )
        with warnings.catch_warnings():
            # A solver that warns also reports that no answer was found.
            warnings.simplefilter("ignore")
            try:
                found = qpsolvers.solve_problem(problem, self._name, **self._settings)
            except qpsolvers.QPError:
                return no_answer(*qp.size, "failed")
        if not found.found or found.x is None:
            return no_answer(*qp.size, _flag(self._name, found.extras), _iterations(found.extras))
        y, z = (
            np.zeros(0) if part is None else np.asarray(part, float) for part in (found.y, found.z)
        )
        rows, box = pattern.multipliers(y, z)
        return QpAnswer(np.array(found.x), rows, box, "solved", _iterations(found.extras))

    def _rows(self, rows: tuple[Array, Array]) -> tuple[Any, Any]:
        matrix, ends = rows
        return (self._matrix(matrix), ends) if len(ends) else (None, None)


def _flag(name: str, extras: dict[str, Any]) -> str:
    # quadprog gives no other reason; unusable matrices raise an error.
    if name == "quadprog":
        return "infeasible"
    status = str(extras.get("status", getattr(extras.get("info"), "status", ""))).lower()
    if "infeasible" in status:
        return "infeasible"
    return "stopped" if "max" in status or "almost" in status else "failed"


def _iterations(extras: dict[str, Any]) -> int | None:
    count = extras.get("iterations", getattr(extras.get("info"), "iter", None))
    return None if count is None else int(np.ravel(count)[0])
