"""Solvers that come with CasADi, called through its buffers: qrqp, qpOASES, HPIPM and HiGHS."""

from __future__ import annotations

import abc
from contextlib import AbstractContextManager, nullcontext
from typing import Any, Final

import casadi as ca

from ergoqp.expressions.evaluator import Evaluator
from ergoqp.solvers.sequence import Qp
from ergoqp.solvers.session import QpAnswer, Workspace, no_answer
from ergoqp.solvers.solver import QpSolver
from ergoqp.solvers.unheard import unheard

_INPUTS: Final = ("h", "g", "a", "lba", "uba", "lbx", "ubx")
_OUTPUTS: Final = ("x", "lam_a", "lam_x")
_FLAGS: Final = {"SOLVER_RET_SUCCESS": "solved", "SOLVER_RET_LIMITED": "stopped"}
_QUIET: Final = {"print_iter": False, "print_header": False, "print_info": False}


class PluginSolver(QpSolver):
    """A CasADi conic plugin of the solver's name; a subclass says which, with what settings.

    Attributes:
        rebinds: whether it must be told anew for every QP where the data lie.
        loud: whether it prints, whatever it is told.
    """

    rebinds: bool = False
    loud: bool = False

    @abc.abstractmethod
    def options(self, n: int, m: int, accuracy: float) -> dict[str, Any]:
        """Return the plugin's options for this size."""

    def iterations(self, stats: dict[str, Any]) -> int | None:
        """Return the solver's count of iterations."""
        return stats["iter_count"]

    def workspace(self, n: int, m: int, accuracy: float) -> Workspace:
        """Return the conic function with memory of its own."""
        return _PluginWorkspace(self, n, m, accuracy)


class _PluginWorkspace:
    """One CasADi conic function, called through its buffers."""

    def __init__(self, solver: PluginSolver, n: int, m: int, accuracy: float) -> None:
        """Make the function and its memory."""
        self._solver, self._n, self._m = solver, n, m
        self._shapes = {"h": ca.Sparsity.dense(n, n), "a": ca.Sparsity.dense(m, n)}
        self._options = {"error_on_fail": False, **solver.options(n, m, accuracy)}
        self._solved = False
        self._renew()

    def solve(self, qp: Qp, warm: bool) -> QpAnswer:
        """Solve; warm: from the last answer, where the plugin can."""
        # A plugin that can start warm goes on from the last QP whatever it is given; and what a
        # failed solve leaves behind is no place to start from.
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
        # Of one function CasADi hands out used memory again: only a new one's is new.
        with self._quiet():
            self._function = ca.conic("qp", self._solver.name, self._shapes, self._options)
            self._evaluator = Evaluator(self._function)
        self._new = True

    def _quiet(self) -> AbstractContextManager[None]:
        return unheard() if self._solver.loud else nullcontext()


def _flag(stats: dict[str, Any]) -> str:
    # The unified status does not know infeasible QPs; the solvers' own words do, in different ones.
    if "infeasib" in str(stats["return_status"]).lower():
        return "infeasible"
    return _FLAGS.get(stats["unified_return_status"], "failed")


class Qrqp(PluginSolver):
    """CasADi's own active-set method by sparse QR; plain C.

    Started from the last multipliers it was seen to cycle, and to say solved with multipliers of
    the wrong sign: always cold.
    """

    name = "qrqp"
    method = "active set"

    def options(self, n: int, m: int, accuracy: float) -> dict[str, Any]:
        """Return the plugin's options; it ends where an active set fits, to its tolerance."""
        # Where it cycles it would go on for a thousand iterations, and a control step for 0.3 s.
        tolerances = {"constr_viol_tol": accuracy / 10, "dual_inf_tol": accuracy / 10}
        return {**_QUIET, **tolerances, "max_iter": 100}


class Qpoases(PluginSolver):
    """qpOASES: a parametric active-set method that goes on from the last QP by homotopy.

    It greets with its licence whenever memory is made, and shouts at what is infeasible.

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

    Called again on the same buffers, its interface was seen to answer the first QP over and over;
    bound to buffers anew it does not.
    """

    name = "hpipm"
    method = "interior point"
    rebinds = True

    def options(self, n: int, m: int, accuracy: float) -> dict[str, Any]:
        """Return the plugin's options.

        Its tolerance is for each product of multiplier and distance, and there are many.
        """
        # Far below that it gives up before it is there; where many ends are near, here already.
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
    """HiGHS: an active-set QP solver beside its simplex method.

    Reference: Huangfu and Hall, Math. Prog. Comp. 10, 2018.
    """

    name = "highs"
    method = "active set"

    def options(self, n: int, m: int, accuracy: float) -> dict[str, Any]:
        """Return the plugin's options.

        Its tolerances go no lower than 1e-10. By default it would add 1e-7 to H.
        """
        tolerance = max(1e-10, accuracy / 10)
        names = ("primal_feasibility_tolerance", "dual_feasibility_tolerance")
        # Without a limit it was seen to go on for ever between rows that all but meet.
        own = {"output_flag": False, "qp_regularization_value": 0.0, "qp_iteration_limit": 1000}
        return {"highs": own | dict.fromkeys(names, tolerance)}

    def iterations(self, stats: dict[str, Any]) -> int | None:
        """Return the count of the QP method."""
        return stats["qp_iteration_count"]
