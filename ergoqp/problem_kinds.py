"""Whether the terms of a problem are what they are to be, each by itself: said when it is made, and not in the loop."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ergoqp.arguments import as_tuple, check_kind, check_number, check_text, shown
from ergoqp.control import Control
from ergoqp.errors import InputError, ProblemError
from ergoqp.limits import TwistLimit
from ergoqp.robot import DeclaredRobot
from ergoqp.sheets.method import Method
from ergoqp.sheets.reba import assess
from ergoqp.sheets.task import TaskOptions

if TYPE_CHECKING:
    from ergoqp.problem import Problem

PERIODS: Final = (1e-4, 0.1)
"""Shortest and longest control period [s]."""

_MEMBERS: Final = {
    "cost": ("name", "minimum", "expression", "__call__"),
    "response": ("coordinates", "largest", "joints", "weight_vector", "expression", "sensitivity", "contact"),
    "limit": (
        *("names", "unit", "hard", "returns", "tolerance", "recovery_time", "yield_zone", "proven"),
        *("measure", "rows", "margins"),
    ),
}
"""What each kind of term must have, see `ergoqp.costs.cost`, `ergoqp.responses.response` and `ergoqp.limits.limit`."""

_JOINTS: Final = 32


def check_kinds(problem: Problem) -> None:
    """Check every term of a problem by itself.

    Raises:
        ProblemError: for the first that is not what it is to be.
    """
    _check_members("cost", problem.cost, "cost")
    _check_members("response", problem.response, "response")
    for limit in _limits(problem.limits):
        if not isinstance(limit, TwistLimit):
            _check_members("limits", limit, "limit")
    check_number("dt", problem.dt, *PERIODS, "s", ProblemError)
    for what, term, kind in (
        ("control", problem.control, Control),
        ("robot", problem.robot, DeclaredRobot),
        ("method", problem.method, Method),
    ):
        check_kind(what, term, kind, f"a {kind.__name__}", ProblemError)
    _check_task(problem.task, problem.method)
    check_text("name", problem.name, error=ProblemError)
    if problem.name.startswith(".") or set(problem.name) & set("/\\"):
        raise ProblemError(f"name: got {problem.name!r}, allowed one that a folder can have: without / and \\, no leading dot")
    check_text("title", problem.title, 0, 1000, ProblemError)


def _limits(limits: Any) -> tuple[Any, ...]:
    try:
        return as_tuple("limits", limits)
    except InputError as error:
        raise ProblemError(str(error)) from None


def _check_members(what: str, term: Any, kind: str) -> None:
    """Check that a term has what its protocol asks for."""
    lacking = [name for name in _MEMBERS[kind] if not (hasattr(type(term), name) or hasattr(term, name))]
    if not callable(term) and "__call__" in _MEMBERS[kind]:
        lacking.append("__call__")
    if isinstance(term, type) or lacking:
        found = "" if isinstance(term, type) or len(lacking) == len(_MEMBERS[kind]) else f" without {', '.join(lacking)}"
        raise ProblemError(f"{what}: got {shown(term)}{found}, allowed a {kind} with {', '.join(_MEMBERS[kind])}")


def _check_task(task: Any, method: Method) -> None:
    """Check that the sheet can be read with the options of a task."""
    check_kind("task", task, Mapping, "a table of options", ProblemError)
    if unknown := [name for name in task if name not in TaskOptions.__annotations__]:
        raise ProblemError(f"task: got {shown(unknown[0])}, allowed {', '.join(TaskOptions.__annotations__)}")
    for name, value in task.items():
        if name not in ("arm_supported", "shoulder_raised") and np.ndim(value) != 0:
            raise ProblemError(f"task.{name}: got {shown(value)}, allowed a single value: a problem is one task")
    try:
        assess(np.zeros(_JOINTS), method, **task)
    except InputError as error:
        raise ProblemError(f"task.{error}") from None
