"""The step without what users' Python code computes, for the moment in which that code raises.

Most terms are expressions, in which nothing can be raised. But an expression may call Python,
through `casadi.Callback`, in a cost, in a response, and in the `measure` of a limit.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import casadi as ca

from ergoqp.arguments import of_package
from ergoqp.errors import ProblemError
from ergoqp.expressions.evaluator import Evaluator
from ergoqp.problem.problem import Problem
from ergoqp.solvers.solver import SOLVER, interrupted

_CALLBACK: Final = "CallbackInternal"
"""What CasADi calls a function that is written in Python."""


def callers(problem: Problem) -> list[str]:
    """Return the terms of a problem that may call Python, in words."""
    cost, response, limits = problem.cost, problem.response, problem.row_limits
    found = []
    if not of_package(cost):
        q = ca.MX.sym("q", len(problem.coordinates))
        function = ca.Function("cost", [q], [cost.expression(q)])
        if getattr(cost, "dense", False) or calls_python(function):
            found.append(f"cost: {cost.name}")
    if not of_package(response) and calls_python(response.contact(), response.sensitivity()):
        found.append(f"response: {type(response).__name__}")
    return found + [
        f"limits: {limit.names[0]}"
        for limit in limits
        if not of_package(limit) and limit.measure() is not None
    ]


def check_spare(spare: ca.Function) -> None:
    """Check that no row or margin of a limit calls Python: it could raise an error in every step.

    Args:
        spare: a step in which nothing else does, except its solver.

    Raises:
        ProblemError: if one does.
    """
    for part in spare.find_functions():
        if part.class_name() == _CALLBACK and part.name() != SOLVER:
            raise ProblemError(
                f"limits: got rows or margins that call {part.name()!r} in Python, allowed"
                " expressions; what calls Python belongs into the measure of the limit"
            )


def calls_python(*functions: ca.Function) -> bool:
    """Return whether a function contains a `casadi.Callback`."""
    found = [part for function in functions for part in (function, *function.find_functions())]
    return any(part.class_name() == _CALLBACK for part in found)


class NoResponse:
    """A response that gives no numbers: its contact is no pose, and its sensitivity is NaN.

    Args:
        response: the response whose place it takes.
    """

    def __init__(self, response: Any) -> None:
        """Keep the response, for its sizes."""
        self._response = response

    def contact(self) -> ca.Function:
        """Return zeros instead of the contact frame."""
        return _constant(self._response.contact(), 0.0)

    def sensitivity(self) -> ca.Function:
        """Return NaN in every entry."""
        return _constant(self._response.sensitivity(), float("nan"))


def _constant(function: ca.Function, value: float) -> ca.Function:
    """Return a function of the same inputs and sizes that gives one number in every entry."""
    count = function.n_out()
    parts = [ca.SX(value) * ca.SX.ones(*function.size_out(i)) for i in range(count)]
    names = [function.name_out(i) for i in range(count)]
    return ca.Function(function.name(), function.sx_in(), parts, function.name_in(), names)


def guarded(
    call: Callable[[], object], evaluator: Evaluator, spare: ca.Function, raised: list[str]
) -> Callable[[], None]:
    """Return a call of the step that takes the answer of another step if it raises.

    Args:
        call: evaluates the step.
        evaluator: the step, with its inputs and results.
        spare: the step in which these terms give no numbers, so that it brakes.
        raised: holds the error of the last call in words; empty if there was none.
    """
    instead = Evaluator(spare)

    def called() -> None:
        raised.clear()
        try:
            call()
        except Exception as error:  # any error in the code of a user's term
            if interrupted(error):
                raise KeyboardInterrupt from None
            for name, values in evaluator.inputs.items():
                instead.inputs[name][:] = values
            instead.evaluate()
            evaluator.results[:] = instead.results
            # CasADi puts the place in front of the words of the error.
            words = (str(error).strip().splitlines() or [""])[-1].split(": ", 1)[-1]
            raised.append(f"an error ({words[:120]})")

    return called
