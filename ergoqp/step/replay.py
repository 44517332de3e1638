"""Compute a recorded loop again from its log."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

from ergoqp.arguments import as_tuple, check_kind
from ergoqp.errors import InputError
from ergoqp.problem.problem import Problem
from ergoqp.step.answer.step import Step
from ergoqp.step.guide.place import RECORDED
from ergoqp.step.stepper import Stepper


def replay(problem: Problem, log: Sequence[Mapping[str, Any]]) -> list[Step]:
    """Return the steps of a logged loop, computed from its log alone.

    The same inputs give the same answers, bit for bit (with ProxQP up to its last bits).

    Period, solver and compilation are those of the logged loop. Every entry holds the whole state,
    so steps that are missing in the log do not change the others.

    Args:
        problem: the problem of the logged loop.
        log: the dicts that the log function received, in order.

    Raises:
        InputError: if an entry does not come from such a loop.
        CompilerError: if the logged step was compiled, and there is no compiler here.

    Example:
        >>> import ergoqp
        >>> problem = ergoqp.load_problem("screwing")
        >>> log = []
        >>> stepper = ergoqp.Stepper(problem, log=log.append)
        >>> step = stepper.step(problem.response.comfort)
        >>> [again] = ergoqp.replay(problem, log)
        >>> bool((again.twist == step.twist).all())
        True
    """
    check_kind("problem", problem, Problem, "a Problem, such as ergoqp.load_problem gives")
    log = as_tuple("log", log)
    steppers: dict[str, Stepper] = {}
    steps = []
    for number, entry in enumerate(log):
        try:
            loop, notes = dict(entry["loop"]), dict(entry["notes"])
            guided = "guide" in entry
            stepper = steppers.get(key := repr((sorted(loop.items()), guided)))
            if stepper is None:
                stepper = steppers[key] = Stepper(
                    problem, **loop, guide=RECORDED if guided else None
                )
            for name, values in stepper._inputs.items():
                values[:] = entry[name]
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(
                f"log: entry {number} is not one of a loop of this problem ({error}), allowed the"
                " dicts that its log sink got"
            ) from None
        stepper._call()
        steps.append(stepper._answer(stepper._ready, notes, time.perf_counter()))
    return steps
