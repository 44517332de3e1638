"""Compute a recorded loop again from its log."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

from ergoqp.arguments import as_tuple, check_kind, shown
from ergoqp.errors import InputError
from ergoqp.problem.problem import Problem
from ergoqp.solvers import QpSolver, read_solver
from ergoqp.step.answer import Step
from ergoqp.step.guide import RECORDED
from ergoqp.step.stepper import Stepper


def replay(
    problem: Problem, log: Sequence[Mapping[str, Any]], solver: QpSolver | None = None
) -> list[Step]:
    """Return the steps of a logged loop, computed from its log alone.

    The same inputs give the same answers, bit for bit (with ProxQP up to its last bits).

    Period and solver are those of the logged loop. It makes no difference which steps were
    compiled. Every entry holds the whole state, so steps that are missing in the log do not change
    the others.

    Args:
        problem: the problem of the logged loop.
        log: the dicts that the log function received, in order. A call that was interrupted may
            have left one: it gives a step that nobody received.
        solver: the solver of the logged loop, if it was an object that `Stepper` got. A log holds
            only its name.

    Raises:
        InputError: if an entry does not come from such a loop, or if the logged loop had a solver
            that is an object and `solver` is None, or the other way around.

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
    _check_solver(log, solver)
    steppers: dict[str, Stepper] = {}
    steps = []
    for number, entry in enumerate(log):
        try:
            loop, notes = dict(entry["loop"]), dict(entry["notes"])
            loop.pop("compiled", None)  # in older logs
            guided = "guide" in entry
            stepper = steppers.get(key := repr((sorted(loop.items()), guided)))
            if stepper is None:
                if loop.pop("own_solver", False):
                    loop["solver"] = solver
                stepper = steppers[key] = Stepper(
                    problem, **loop, guide=RECORDED if guided else None
                )
            for name, values in stepper._recorded.items():
                values[:] = entry[name]
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(
                f"log: entry {number} is not one of a loop of this problem ({error}); give the"
                " dicts that its log sink got"
            ) from None
        stepper._raised.clear()
        stepper._call()
        if entry.get("instead"):  # this answer was given, and not the one before
            steps.pop()
        frame = (stepper._inputs["posture"].copy(), stepper._inputs["observed"].copy())
        steps.append(stepper._answer(stepper._ready, notes, time.perf_counter(), frame))
    return steps


def _check_solver(log: Sequence[Any], given: QpSolver | None) -> None:
    """Check that a solver is given if the loop had one that was an object, and only then."""
    if given is not None:
        read_solver(given)
    for number, entry in enumerate(log):
        loop = entry.get("loop") if isinstance(entry, Mapping) else None
        if not isinstance(loop, Mapping):
            continue
        name, own = shown(loop.get("solver")), bool(loop.get("own_solver"))
        if own and given is None:
            raise InputError(
                f"log: entry {number} is of a loop with a solver {name} that was given as an"
                " object, which a log does not hold; give replay(..., solver=that object)"
            )
        if given is not None and not own:
            raise InputError(
                f"solver: got {shown(given)}, allowed only for a loop whose solver was given as an"
                f" object; that of entry {number} is {name}"
            )
