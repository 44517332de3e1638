"""Checks of the terms of a problem, each by itself.

They run when the problem is made, not in the loop.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from typing import Any, Final

import casadi as ca
import numpy as np

from ergoqp.arguments import (
    check_kind,
    check_number,
    check_text,
    flag,
    names_of,
    object_of,
    shown,
)
from ergoqp.costs.learned import LearnedCost
from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.errors import InputError, ProblemError
from ergoqp.limits import TwistLimit
from ergoqp.limits.limit import RECOVERY_TIMES
from ergoqp.limits.own_rows import KINDS
from ergoqp.problem.control import Control
from ergoqp.problem.frames import Frames
from ergoqp.problem.robot import DeclaredRobot
from ergoqp.sheets.options import Method
from ergoqp.sheets.reba import assess
from ergoqp.sheets.task import TaskOptions

PERIODS: Final = (1e-4, 0.1)
"""Shortest and longest control period [s]."""

_MEMBERS: Final = {
    "cost": ("name", "minimum", "expression", "__call__"),
    "response": (
        "coordinates",
        "largest",
        "joints",
        "weight_vector",
        "expression",
        "sensitivity",
        "contact",
    ),
    "limit": (
        "names",
        "unit",
        "hard",
        "returns",
        "tolerance",
        "recovery_time",
        "yield_zone",
        "proven",
        "measure",
        "rows",
        "margins",
    ),
}
"""Required members of each kind of term.

See `ergoqp.costs.cost`, `ergoqp.responses.response` and `ergoqp.limits.limit`.
"""

FIGURES: Final = (
    "speed",
    "acceleration",
    "jerk",
    "axes",
    "workspace",
    "tool axis",
    "joint range",
    "joint rate",
    "boundary",
    "arm length",
)
"""Names of the figures of `ergoqp.simulation.check` that are not rows."""

_JOINTS: Final = 32
_LARGEST: Final = 1e6
"""Costs, distances and tolerances above this are mistakes."""


def check_kinds(problem: Any) -> None:
    """Check every term of a problem by itself.

    Raises:
        ProblemError: for the first term that is not valid.
    """
    _check_members("cost", problem.cost, "cost")
    check_text("cost.name", problem.cost.name, ProblemError)
    check_number("cost.minimum", problem.cost.minimum, -_LARGEST, _LARGEST, error=ProblemError)
    check_response("response", problem.response)
    for limit in problem.limits:
        if not isinstance(limit, TwistLimit):
            _check_limit(limit)
    rows = [name for limit in problem.own_limits.limits for name in limit.names]
    if taken := [name for name in rows if name in FIGURES]:
        raise ProblemError(
            f"limits: got a row named {taken[0]!r}, allowed other names than those of the checker's"
            f" own figures: {', '.join(FIGURES)}"
        )
    check_number("dt", problem.dt, *PERIODS, "s", ProblemError)
    for what, term, kind in (
        ("control", problem.control, Control),
        ("robot", problem.robot, DeclaredRobot),
        ("frames", problem.frames, Frames),
        ("method", problem.method, Method),
    ):
        check_kind(what, term, kind, f"a {kind.__name__}", ProblemError)
    _check_task(problem.task, problem.method)
    check_text("name", problem.name, ProblemError)
    if problem.name in (".", "..") or "/" in problem.name:
        raise ProblemError(
            f"name: got {problem.name!r}, allowed one that a folder can have, without /"
        )
    check_kind("title", problem.title, str, "a text", ProblemError)


def _check_members(what: str, term: Any, kind: str) -> None:
    """Check that a term has the members of its protocol."""
    lacking = [
        name for name in _MEMBERS[kind] if not (hasattr(type(term), name) or hasattr(term, name))
    ]
    if not callable(term) and "__call__" in _MEMBERS[kind]:
        lacking.append("__call__")
    if isinstance(term, type) or lacking:
        with_members = f"a {kind} with {', '.join(_MEMBERS[kind])}"
        if isinstance(term, type):
            # Every class can be called. A TwistLimit has no rows, and none of their members.
            known = issubclass(term, TwistLimit) or any(
                hasattr(term, name) for name in _MEMBERS[kind] if name != "__call__"
            )
            raise ProblemError(
                f"{what}: got {shown(term)}, allowed {object_of(term) if known else with_members}"
            )
        found = "" if len(lacking) == len(_MEMBERS[kind]) else f" without {', '.join(lacking)}"
        raise ProblemError(f"{what}: got {shown(term)}{found}, allowed {with_members}")


def check_expression(cost: Any, size: int) -> None:
    """Check that the expression of a user's cost is a scalar that depends only on the state.

    `SmoothReba` and every `LearnedCost` are skipped. They cache objects when their expression is
    made, and not all of these can be sent to another process.

    Args:
        cost: a term with the members of a cost.
        size: number of entries of the state.

    Raises:
        ProblemError: if it does not, with the error that the expression raised.
    """
    if isinstance(cost, (SmoothReba, LearnedCost)):
        return
    state = ca.MX.sym("q", size)
    try:
        # A copy: a user's cost may cache something too.
        found = copy(cost).expression(state)
        if scalar := getattr(found, "shape", None) == (1, 1):
            function = ca.Function("cost", [state], [found])
            if not getattr(cost, "dense", False):
                function.expand()  # as the step does
    except Exception as error:  # any error in the code of a user's cost
        words = (str(error).strip().splitlines() or [""])[-1][:120]
        raise ProblemError(
            f"cost: got {type(error).__name__} ({words}) from the expression of {cost.name},"
            " allowed a scalar of CasADi"
        ) from None
    if not scalar:
        raise ProblemError(
            f"cost: got the expression {shown(found)} of {cost.name}, allowed a scalar of CasADi"
        )


def check_response(what: str, response: Any) -> None:
    """Check that a term has the members of a response and names the entries of its state.

    Args:
        what: name of the term in the message.
        response: any object.

    Raises:
        ProblemError: if it is not a response.
    """
    _check_members(what, response, "response")
    names_of(f"{what} coordinates", response.coordinates, "names of the state", ProblemError)


def _check_limit(limit: Any) -> None:
    """Check that a limit has the members of `ergoqp.limits.limit.Limit`, with usable values."""
    _check_members("limits", limit, "limit")
    names = names_of("limits: names", limit.names, "a name for each row", ProblemError)
    first = names[0]
    check_text(f"limits: unit of {first}", limit.unit, ProblemError)
    for what in ("hard", "proven"):
        flag(f"limits: {what} of {first}", getattr(limit, what), ProblemError)
    for what, low, high in (
        ("tolerance", 0.0, _LARGEST),
        ("recovery_time", *RECOVERY_TIMES),
        ("yield_zone", 0.0, _LARGEST),
    ):
        check_number(
            f"limits: {what} of {first}", getattr(limit, what), low, high, error=ProblemError
        )
    holds = getattr(limit, "holds", None)
    if holds is not None and not (isinstance(holds, str) and holds in KINDS):
        raise ProblemError(
            f"limits: holds of {first}: got {shown(holds)}, allowed {', '.join(KINDS)}, or None"
        )
    check_text(f"limits: breach of {first}", getattr(limit, "breach", "outside"), ProblemError)
    returns = limit.returns
    if not isinstance(returns, (tuple, list, np.ndarray)) or len(returns) not in (1, len(names)):
        raise ProblemError(
            f"limits: returns of {first}: got {shown(returns)}, allowed one True or False for"
            " each row"
        )
    for each in returns:
        flag(f"limits: returns of {first}", each, ProblemError)


def _check_task(task: Any, method: Method) -> None:
    """Check that the options of a task are valid for the sheet."""
    check_kind("task", task, Mapping, "a table of options", ProblemError)
    if unknown := [name for name in task if name not in TaskOptions.__annotations__]:
        raise ProblemError(
            f"task: got {shown(unknown[0])}, allowed {', '.join(TaskOptions.__annotations__)}"
        )
    for name, value in task.items():
        if name not in ("arm_supported", "shoulder_raised") and isinstance(
            value, (list, tuple, np.ndarray)
        ):
            raise ProblemError(
                f"task.{name}: got {shown(value)}, allowed a single value: a problem is one task"
            )
    try:
        assess(np.zeros(_JOINTS), method, **task)
    except InputError as error:
        raise ProblemError(f"task.{error}") from None
    except (ValueError, TypeError) as error:
        raise ProblemError(
            f"task: got {shown(dict(task), 120)}, allowed single values and pairs (right, left):"
            f" {error}"
        ) from None
