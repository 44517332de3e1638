"""Checks of the terms of a problem, each by itself and tried at a few drawn postures.

They run when the problem is made, not in the loop.

Whether a user's cost and response are what they say, tried at a few drawn postures.

Terms of the package are skipped: its tests judge them.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
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
    of_package,
    shown,
)
from ergoqp.errors import InputError, ProblemError, in_words, last_line
from ergoqp.joints import JOINTS, LOWER, UPPER, spoken
from ergoqp.limits import TwistLimit
from ergoqp.limits.custom import KINDS, judged_once
from ergoqp.limits.limit import RECOVERY_TIMES
from ergoqp.problem.settings import Control, DeclaredRobot, Frames
from ergoqp.sheets.options import Method, TaskOptions
from ergoqp.sheets.reba import assess

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
        "recovers",
        "tolerance",
        "recovery_time",
        "yield_zone",
        "margin_is_lower_bound",
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

    The costs of ergoqp are skipped. They cache objects when their expression is
    made, and not all of these can be sent to another process.

    Args:
        cost: a term with the members of a cost.
        size: number of entries of the state.

    Raises:
        ProblemError: if it does not, with the error that the expression raised.
    """
    if of_package(cost):
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
        raise ProblemError(
            f"cost: got {type(error).__name__} ({last_line(error)[:120]}) from the expression of"
            f" {cost.name}, allowed a scalar of CasADi"
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
    for what in ("hard", "margin_is_lower_bound"):
        flag(f"limits: {what} of {first}", getattr(limit, what), ProblemError)
    for what, low, high in (
        ("tolerance", 0.0, _LARGEST),
        ("recovery_time", *RECOVERY_TIMES),
        ("yield_zone", 0.0, _LARGEST),
    ):
        check_number(
            f"limits: {what} of {first}", getattr(limit, what), low, high, error=ProblemError
        )
    kind = getattr(limit, "kind", None)
    if kind is not None and not (isinstance(kind, str) and kind in KINDS):
        raise ProblemError(
            f"limits: kind of {first}: got {shown(kind)}, allowed {', '.join(KINDS)}, or None"
        )
    check_text(
        f"limits: violation_label of {first}",
        getattr(limit, "violation_label", "outside"),
        ProblemError,
    )
    recovers = limit.recovers
    if not isinstance(recovers, (tuple, list, np.ndarray)) or len(recovers) not in (1, len(names)):
        raise ProblemError(
            f"limits: recovers of {first}: got {shown(recovers)}, allowed one True or False for"
            " each row"
        )
    for each in recovers:
        flag(f"limits: recovers of {first}", each, ProblemError)


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


_POSTURES: Final = 8
"""Number of postures that are drawn."""
_POINTS: Final = 33
"""Number of points on a line between two postures."""
_HALVINGS: Final = 30
"""How often a suspicious part of a line is halved; what is left is 1e-10 rad long."""
_SUSPECTS: Final = 3
"""Parts of a line that are looked into."""
_SAME: Final = 1e-6
"""Largest difference of what must be the same, relative to 1 + its size."""
_KINK: Final = 1e-3
"""Smallest jump of a slope that counts, relative to the largest slope on the line."""
_SLOW: Final = 1e-3
"""A term that takes longer is tried on one line only [s]."""
_MOVES: Final = (-0.1, 3.0)
"""How far the contact may move in the model per metre of the object."""


def judge_terms(cost: Any, response: Any) -> dict[str, float]:
    """Try the user's own cost and response.

    Args:
        cost: a term with the members of a cost.
        response: a term with the members of a response.

    Returns:
        For each of the user's own terms, in words, how long one evaluation takes [s].

    Raises:
        ProblemError: if a term contradicts itself.
    """
    state = tuple(response.coordinates)
    comfort = np.asarray(getattr(response, "comfort", np.zeros(len(state))), dtype=float)
    found = {}
    if not of_package(cost):
        took = judged_once(cost, state, lambda: _Cost(cost, state, comfort).judged())
        found[f"cost {cost.name}"] = took
    if not of_package(response):
        took = judged_once(response, state, lambda: _Response(response, state, comfort).judged())
        found["response"] = took
    return found


def _drawn(state: tuple[str, ...], comfort: np.ndarray) -> np.ndarray:
    """Return postures (k, n) from the comfort posture outward, to the ends of the ranges."""
    rng = np.random.default_rng(0)
    low, high = (LOWER, UPPER) if state == JOINTS else (comfort - 0.3, comfort + 0.3)
    ends = rng.uniform(low, high, (_POSTURES, len(comfort)))
    return comfort + np.linspace(0, 1, _POSTURES)[:, np.newaxis] * (ends - comfort)


def shortest(evaluate: Callable[[], object], repeats: int = 3) -> float:
    """Return the shortest of the durations of repeated calls [s]."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        evaluate()
        times.append(time.perf_counter() - start)
    return min(times)


class _Cost:
    """A user's cost, with its value and slope as functions of the state."""

    def __init__(self, cost: Any, state: tuple[str, ...], comfort: np.ndarray) -> None:
        # A copy: a user's cost may cache objects that cannot be sent to another process.
        self.cost, self.state = copy(cost), state
        self.postures = _drawn(state, comfort)
        q = ca.MX.sym("q", len(state))
        if getattr(cost, "dense", False):
            self.function = ca.Function("cost", [q], list(self.cost.value_and_gradient(q)))
        else:
            value = self.cost.expression(q)
            self.function = ca.Function("cost", [q], [value, ca.gradient(value, q)]).expand()

    def at(self, posture: np.ndarray) -> tuple[float, np.ndarray]:
        """Return value and slope."""
        value, slope = self.function(posture)
        return float(value), np.array(slope).ravel()

    def judged(self) -> float:
        """Return how long an evaluation takes [s].

        Raises:
            ProblemError: if expression, call, minimum and slope do not fit together.
        """
        name, tried = self.cost.name, [self.at(posture) for posture in self.postures]
        values = np.array([value for value, _ in tried])
        if not (np.isfinite(values).all() and all(np.isfinite(slope).all() for _, slope in tried)):
            raise ProblemError(
                f"cost: got NaN or infinity from the expression of {name} or its slope within the"
                " joint ranges, allowed finite numbers"
            )
        called = self._called()
        apart = np.abs(called - values)
        if not (apart <= _SAME * (1 + np.abs(values))).all():
            worst = int(np.argmax(apart))
            raise ProblemError(
                f"cost: got {values[worst]:.6g} from the expression of {name} and"
                f" {called[worst]:.6g} from its call at the same posture, allowed the same"
            )
        if values.min() < self.cost.minimum - _SAME * (1 + abs(self.cost.minimum)):
            raise ProblemError(
                f"cost: got minimum {self.cost.minimum:g} of {name}, but {values.min():.6g} at a"
                " posture, allowed at most its least value"
            )
        took = shortest(lambda: self.at(self.postures[1]))
        for end in self.postures[-1:] if took > _SLOW else self.postures[1:]:
            self._smooth(self.postures[0], end)
        return took

    def _called(self) -> np.ndarray:
        """Return the values of the call (k,)."""
        allowed = f"costs ({_POSTURES},) of postures ({_POSTURES}, {len(self.state)})"
        try:
            called = np.asarray(self.cost(self.postures), dtype=float)
        except Exception as error:  # any error in the code of a user's cost
            raise ProblemError(
                f"cost: got {in_words(error)} from the call of {self.cost.name}, allowed {allowed}"
            ) from None
        if called.shape != (_POSTURES,):
            raise ProblemError(
                f"cost: got shape {called.shape} from the call of {self.cost.name}, allowed"
                f" {allowed}"
            )
        return called

    def _smooth(self, begin: np.ndarray, end: np.ndarray) -> None:
        """Check that value and slope do not jump on a line.

        Parts of the line in which they change most are halved again and again. What changes
        smoothly changes less and less.
        """
        way = end - begin
        shares = np.linspace(0, 1, _POINTS)
        points = [self._on(begin, way, share) for share in shares.tolist()]
        values, slopes = np.array(points).T
        steepest = float(np.abs(slopes).max())
        rises = np.abs(np.diff(values) - (slopes[1:] + slopes[:-1]) / 2 / (_POINTS - 1))
        bends = np.abs(np.diff(slopes, 2, prepend=slopes[0], append=slopes[-1]))
        bends = np.maximum(bends[1:], bends[:-1])
        suspects = [np.argsort(each)[-_SUSPECTS:] for each in (rises, bends)]
        for part in np.unique(suspects).tolist():
            for what in (0, 1):
                a, b = shares[part], shares[part + 1]
                at_a, at_b = points[part], points[part + 1]
                for _ in range(_HALVINGS):
                    middle = float(a + b) / 2
                    here = self._on(begin, way, middle)
                    if abs(here[what] - at_a[what]) > abs(at_b[what] - here[what]):
                        b, at_b = middle, here
                    else:
                        a, at_a = middle, here
                leap = abs(at_b[what] - at_a[what])
                if leap > (_KINK * steepest, _SAME * (1 + abs(at_a[0])))[1 - what]:
                    self._refuse(begin + a * way, begin + b * way, what, leap)

    def _on(self, begin: np.ndarray, way: np.ndarray, share: float) -> tuple[float, float]:
        """Return value and slope along a line."""
        value, slope = self.at(begin + share * way)
        return value, float(slope @ way)

    def _refuse(self, before: np.ndarray, after: np.ndarray, what: int, leap: float) -> None:
        changes = np.abs(self.at(after)[1] - self.at(before)[1])
        joint = int(np.argmax(changes))
        at = np.degrees(before[joint]) if self.state == JOINTS else before[joint]
        unit = " deg" if self.state == JOINTS else ""
        where = f"at {spoken(self.state[joint])} {at:.3g}{unit}"
        name = self.cost.name
        found = (
            f"a slope of {name} that jumps {where}" if what else f"a jump of {name} by {leap:.3g}"
        )
        raise ProblemError(
            f"cost: got {found}, allowed an expression with a continuous slope (fmax(0, x)**2, not"
            " fmax(0, x))"
        )


class _Response:
    """A user's response, as functions of the state."""

    def __init__(self, response: Any, state: tuple[str, ...], comfort: np.ndarray) -> None:
        self.response, self.state, self.postures = response, state, _drawn(state, comfort)
        q = ca.MX.sym("q", len(state))
        try:
            self.sensitivity, self.contact = response.sensitivity(), response.contact()
            self.expression = ca.Function("expression", [q], [response.expression(q)])
        except Exception as error:  # any error in the code of a user's response
            raise ProblemError(
                f"response: got {in_words(error)}, allowed the members of"
                " ergoqp.responses.Response as CasADi makes them"
            ) from None

    def judged(self) -> float:
        """Return how long an evaluation takes [s].

        Raises:
            ProblemError: if expression, sensitivity and contact do not fit together.
        """
        n = len(self.state)
        shapes = self.sensitivity.size_out(0), self.expression.size_out(0)
        if set(shapes) != {(n, 6)}:
            raise ProblemError(
                f"response: got shapes {shapes} from sensitivity and expression, allowed ({n}, 6)"
            )
        for number, posture in enumerate(self.postures):
            S, E = (np.array(part) for part in self.sensitivity(posture, np.zeros(n)))
            told = np.array(self.expression(posture))
            if not (np.isfinite(S).all() and np.isfinite(E).all()):
                raise ProblemError(
                    "response: got NaN or infinity from the sensitivity within the joint ranges,"
                    " allowed finite numbers"
                )
            apart = np.abs(told - S)
            if not (apart <= _SAME * (1 + np.abs(S))).all():
                raise ProblemError(
                    "response: got an expression that is not what the sensitivity gives with"
                    " nothing locked, allowed the same"
                )
            self._locks(posture, number)
        moved = [move for posture in self.postures for move in self._moves(posture)]
        for axis in range(3):
            moves = [move for along, move in moved if along == axis]
            if moves and not _MOVES[0] <= np.median(moves) <= _MOVES[1]:
                raise ProblemError(
                    f"response: got a contact that moves {np.median(moves):.2g} m along"
                    f" {'xyz'[axis]} when the object moves 1 m, allowed about 1: contact and"
                    " sensitivity must be of one person"
                )
        return shortest(lambda: self.sensitivity(self.postures[0], np.zeros(n)))

    def _locks(self, posture: np.ndarray, number: int) -> None:
        """Check that a locked joint does not move."""
        joints = self.response.joints
        joint = self.state.index(joints[number % len(joints)])
        S = np.array(self.sensitivity(posture, np.eye(len(self.state))[joint])[0])
        if S[joint].any():
            raise ProblemError(
                f"response: got a motion of {spoken(self.state[joint])} although it is locked,"
                " allowed zeros in the sensitivity"
            )

    def _moves(self, posture: np.ndarray) -> Iterator[tuple[int, float]]:
        """Yield axes and how far the contact of the model moves along them with the object."""
        S = np.array(self.sensitivity(posture, np.zeros(len(self.state)))[0])
        for pose in self.contact(posture):
            turn = np.array(pose)[:3, :3]
            rigid = np.allclose(turn.T @ turn, np.eye(3), atol=1e-3) and np.linalg.det(turn) > 0
            if not (rigid and np.isfinite(np.array(pose)).all()):
                raise ProblemError(
                    "response: got a contact that is no rigid pose, allowed poses (4, 4) of contact"
                    " and pelvis"
                )
        step = 1e-5
        for axis in range(3):
            way = step * S[:, axis]
            after, before = (np.array(self.contact(posture + way * sign)[0]) for sign in (1, -1))
            moved = (after[:3, 3] - before[:3, 3]) / (2 * step)
            if np.linalg.norm(moved) > 1e-6:
                yield axis, float(moved[axis])


def slowest(times: dict[str, float], dt: float) -> str:
    """Return the slowest own term, in words, or nothing if none takes a tenth of a period."""
    name = max(times, key=lambda each: times[each], default="")
    if not name or times[name] <= dt / 10:
        return ""
    return f"{name} ({1e3 * times[name]:.2g} ms when it was tried)"


def check_pace(times: dict[str, float], dt: float) -> None:
    """Check that no own term takes longer than a period.

    Args:
        times: how long each takes [s], see `judge_terms`.
        dt: control period [s].

    Raises:
        ProblemError: if one does.
    """
    for name, took in times.items():
        if took > dt:
            raise ProblemError(
                f"{name.split()[0]}: got {1e3 * took:.3g} ms for one evaluation of the {name},"
                f" allowed less than the period of {1e3 * dt:g} ms: a longer dt or a simpler"
                " expression"
            )
