"""The step without what users' Python code computes, for the moment in which that code raises.

Most terms are expressions, in which nothing can be raised. A cost with `dense` and the `measure` of
a limit may call Python, through `casadi.Callback`.
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca

from ergoqp.arguments import of_package
from ergoqp.expressions.evaluator import Evaluator
from ergoqp.problem.problem import Problem


def callers(problem: Problem) -> list[str]:
    """Return the terms of a problem that may call Python, in words."""
    cost, limits = problem.cost, problem.row_limits
    found = [f"cost: {cost.name}"] if getattr(cost, "dense", False) and not of_package(cost) else []
    return found + [
        f"limits: {limit.names[0]}"
        for limit in limits
        if not of_package(limit) and limit.measure() is not None
    ]


def guarded(
    call: Callable[[], object], evaluator: Evaluator, spare: ca.Function, raised: list[str]
) -> Callable[[], None]:
    """Return a call of the step that takes the answer of another step if it raises.

    Args:
        call: evaluates the step.
        evaluator: the step, with its inputs and results.
        spare: the step in which costs and readings are NaN, so that it brakes.
        raised: holds the error of the last call in words; empty if there was none.
    """
    instead = Evaluator(spare)

    def called() -> None:
        raised.clear()
        try:
            call()
        except Exception as error:  # any error in the code of a user's term
            for name, values in evaluator.inputs.items():
                instead.inputs[name][:] = values
            instead.evaluate()
            evaluator.results[:] = instead.results
            # CasADi puts the place in front of the words of the error.
            words = (str(error).strip().splitlines() or [""])[-1].split(": ", 1)[-1]
            raised.append(f"an error ({words[:120]})")

    return called
