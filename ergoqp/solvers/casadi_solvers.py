"""Solvers that come with CasADi, called through buffers: qrqp, qpOASES, HPIPM and HiGHS."""

from __future__ import annotations

import abc
from contextlib import AbstractContextManager, nullcontext
from typing import Any, Final

import casadi as ca

from ergoqp.expressions import Evaluator
from ergoqp.solvers.session import Qp, QpAnswer, Workspace, no_answer
from ergoqp.solvers.solver import QpSolver, suppress_stdout

_INPUTS: Final = ("h", "g", "a", "lba", "uba", "lbx", "ubx")
_OUTPUTS: Final = ("x", "lam_a", "lam_x")
_FLAGS: Final = {"SOLVER_RET_SUCCESS": "solved", "SOLVER_RET_LIMITED": "stopped"}
_QUIET: Final = {"print_iter": False, "print_header": False, "print_info": False}


class PluginSolver(QpSolver):
    """A conic plugin of CasADi; a subclass gives the name and the settings.

    Attributes:
        rebinds: whether its buffers must be bound again for every QP.
        loud: whether it prints in spite of its settings.
    """

    rebinds: bool = False
    loud: bool = False

    @abc.abstractmethod
    def options(self, n: int, m: int, accuracy: float) -> dict[str, Any]:
        """Return the plugin's options for this size."""

    def iterations(self, stats: dict[str, Any]) -> int | None:
        """Return the number of iterations of the solver."""
        return stats["iter_count"]

    def workspace(self, n: int, m: int, accuracy: float) -> Workspace:
        """Return the conic function with its own memory."""
        return _PluginWorkspace(self, n, m, accuracy)


class _PluginWorkspace:
    """One conic function of CasADi, called through its buffers."""

    def __init__(self, solver: PluginSolver, n: int, m: int, accuracy: float) -> None:
        """Make the function and its memory."""
        self._solver, self._n, self._m = solver, n, m
        self._shapes = {"h": ca.Sparsity.dense(n, n), "a": ca.Sparsity.dense(m, n)}
        self._options = {"error_on_fail": False, **solver.options(n, m, accuracy)}
        self._solved = False
        self._renew()

    def solve(self, qp: Qp, warm: bool) -> QpAnswer:
        """Solve; `warm`: start from the last answer if the plugin can."""
        # A plugin with a warm start always continues from the last QP. And it must not start from
        # the state of a failed solve.
        if not self._new and (not self._solved or (self._solver.warm and not warm)):
            self._renew()
        elif not self._new and self._solver.rebinds:
            self._evaluator = Evaluator(self._function)
        self._new = False
        for name, part in zip(
            _INPUTS, (qp.H, qp.g, qp.A, qp.lbA, qp.ubA, qp.lb, qp.ub), strict=True
        ):
            self._evaluator.inputs[name][:] = part.ravel(order="F")
        with self._quiet():
            self._evaluator.evaluate()
        stats = self._evaluator.stats()
        flag, count = _flag(stats), self._solver.iterations(stats)
        self._solved = flag == "solved"
        if not self._solved:
            return no_answer(self._n, self._m, flag, count)
        x, rows, box = (self._evaluator.outputs[name].copy() for name in _OUTPUTS)
        return QpAnswer(x, rows, box, flag, count)

    def _renew(self) -> None:
        # CasADi reuses the memory of a function. Only a new function has new memory.
        with self._quiet():
            self._function = ca.conic("qp", self._solver.name, self._shapes, self._options)
            self._evaluator = Evaluator(self._function)
        self._new = True

    def _quiet(self) -> AbstractContextManager[None]:
        return suppress_stdout() if self._solver.loud else nullcontext()


def _flag(stats: dict[str, Any]) -> str:
    # The unified status has no infeasible QPs. The solvers' own statuses have, in different words.
    if "infeasib" in str(stats["return_status"]).lower():
        return "infeasible"
    return _FLAGS.get(stats["unified_return_status"], "failed")


class Qrqp(PluginSolver):
    """CasADi's own active-set method by sparse QR; plain C.

    With a start from the last multipliers it was seen to cycle, and to report success with
    multipliers of the wrong sign. So it always starts cold.
    """

    name = "qrqp"
    method = "active set"

    def options(self, n: int, m: int, accuracy: float) -> dict[str, Any]:
        """Return the plugin's options. It stops, within its tolerance, where an active set fits."""
        # A cycle would go on for a thousand iterations, which is 0.3 s of a control step.
        tolerances = {"constr_viol_tol": accuracy / 10, "dual_inf_tol": accuracy / 10}
        return {**_QUIET, **tolerances, "max_iter": 100}


class Qpoases(PluginSolver):
    """qpOASES: a parametric active-set method that continues from the last QP by homotopy.

    It prints its licence whenever memory is made, and messages about infeasible QPs.

    Reference: Ferreau and others, Math. Prog. Comp. 6, 2014.
    """

    name = "qpoases"
    method = "active set"
    warm = True
    loud = True

    def options(self, n: int, m: int, accuracy: float) -> dict[str, Any]:
        """Return the plugin's options."""
        return {"printLevel": "none", "nWSR": 1000, "enableEqualities": True}


class Hpipm(PluginSolver):
    """HPIPM (Frison and Diehl, IFAC 2020): interior point for optimal control.

    Here it solves a single stage without dynamics.

    When called again on the same buffers, its interface was seen to return the answer of the first
    QP. With newly bound buffers it does not.
    """

    name = "hpipm"
    method = "interior point"
    rebinds = True

    def options(self, n: int, m: int, accuracy: float) -> dict[str, Any]:
        """Return the plugin's options.

        Its tolerance applies to each product of multiplier and distance, and there are many.
        """
        # With a much smaller tolerance it fails early; if many ends are near, even with this one.
        tolerance = max(accuracy / 1000, 1e-11)
        names = ("res_g_max", "res_b_max", "res_d_max", "res_m_max")
        return {
            "N": 0,
            "nx": [n],
            "nu": [0],
            "ng": [m],
            "hpipm": {"iter_max": 200} | dict.fromkeys(names, tolerance),
        }


class Highs(PluginSolver):
    """HiGHS: an active-set QP solver in addition to its simplex method.

    Reference: Huangfu and Hall, Math. Prog. Comp. 10, 2018.
    """

    name = "highs"
    method = "active set"

    def options(self, n: int, m: int, accuracy: float) -> dict[str, Any]:
        """Return the plugin's options.

        Its smallest tolerance is 1e-10. By default it would add 1e-7 to H.
        """
        tolerance = max(1e-10, accuracy / 10)
        names = ("primal_feasibility_tolerance", "dual_feasibility_tolerance")
        # Without a limit it was seen to run forever between rows that are almost equal.
        own = {"output_flag": False, "qp_regularization_value": 0.0, "qp_iteration_limit": 1000}
        return {"highs": own | dict.fromkeys(names, tolerance)}

    def iterations(self, stats: dict[str, Any]) -> int | None:
        """Return the number of iterations of the QP method."""
        return stats["qp_iteration_count"]
