"""What a limit gives to the step: named rows, and their least margins along a stop."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Annotated, Any, Final, Protocol

import casadi as ca
import numpy as np

from ergoqp.arguments import Range, read_array, shown
from ergoqp.errors import InputError, ProblemError

Expression = Any
"""`casadi.SX` or `casadi.MX`: the same lines write scalars to compile or vectors to interpret."""


def with_symbols(term: Any, given: Any) -> Any:
    """Return a term whose attributes of `constants` are those of `given`, such as symbols.

    Where one of its `directions` has a zero, the symbol is zero too.
    """
    found = copy(term)
    for name, value in term.constants().items():
        symbol = getattr(given, name)
        if name in getattr(term, "directions", ()):
            symbol = symbol * ca.DM((value != 0).astype(float))
        object.__setattr__(found, name, symbol)
    return found


@dataclass(frozen=True)
class LimitContext:
    """The person and the object at one step, as CasADi expressions.

    The "motion under way" is what the robot was sent but has not done yet (delay and lag). The
    "rising mean" is the effect of the moving average on a twist that still grows: the object then
    travels farther than the twist that is sent now would suggest.

    Attributes:
        posture: joint angles (32,) [rad], or the state of the problem if that is something else.
        observed: 1 for each joint that is seen, else 0 (32,).
        pose: contact frame in the world (4, 4) [m], after the motion under way.
        sensitivity: S (32, 6) with the joints that are locked in this pass.
        stop_displacement: displacement (6,) [m, rad] of a stop from the present twist. Curved rows
            must be correct along all of it.
        change: largest change of each entry of `stop_displacement` at the next twist (6,) [m, rad].
        readings: result of each limit's `measure` at this posture, by the name of its first row.
        surface: the limit that is an equality, or None.
        pending_displacement: displacement (6,) [m, rad] of the motion under way. It is included in
            `pose`, not in `posture`.
        shift: change of the posture that this displacement will cause, S pending_displacement (32,)
            [rad].
        margin_reduction: parts of the distances to the (lower, upper) ends of each hard limit's
            rows that must not be used, by the name of its first row. No entry: 0.
        turn: largest angle of the motion under way that the robot may have done already [rad].
            None: zero.
        direction_error: largest angle between the motion under way and a straight line [rad]. None:
            no row needs it.
        overshoot_angle: largest angle that a rising mean adds to `direction_error` [rad]. None: no
            row needs it.
        overshoot: largest addition of a rising mean to a displacement of `Limit.margins`, at any
            acceleration (6,) [m, rad]. None: zero.
        overshoot_bound: largest addition of a rising mean at any twist (6,) [m, rad]. The
            displacement contains up to this much of it, independently along each axis. None: zero.
        numbers: gives the symbols that stand for the numbers of a limit, by their names in
            `Limit.constants`, or None if they are written into the expressions.

    Example:
        >>> import casadi as ca
        >>> from ergoqp.limits import LimitContext, WorkspaceBox
        >>> pose = ca.DM.eye(4)
        >>> posture, seen, still = ca.DM.zeros(32), ca.DM.ones(32), ca.DM.zeros(6)
        >>> here = LimitContext(posture, seen, pose, ca.DM.zeros(32, 6), still, still)
        >>> rows = WorkspaceBox((-1, -1, -1), (1, 1, 2)).rows(here)
        >>> rows.to_upper.full().ravel().tolist()
        [1.0, 1.0, 2.0]
    """

    posture: Expression
    observed: Expression
    pose: Expression
    sensitivity: Expression
    stop_displacement: Expression
    change: Expression
    readings: Mapping[str, Expression] = field(default_factory=dict)
    surface: Surface | None = None
    pending_displacement: Expression = field(default_factory=lambda: ca.SX(6, 1))
    shift: Expression = field(default_factory=lambda: ca.SX(32, 1))
    margin_reduction: Mapping[str, tuple[Expression, Expression]] = field(default_factory=dict)
    turn: Expression | None = None
    direction_error: Expression | None = None
    overshoot_angle: Expression | None = None
    overshoot: Expression | None = None
    overshoot_bound: Expression | None = None
    numbers: Callable[[Any], Any] | None = None

    def given(self, limit: Any) -> Any:
        """Return the numbers of a limit, by their names in `Limit.constants`.

        In the step they are inputs of its functions, so that one function serves all problems that
        differ in numbers only. Elsewhere they are the numbers themselves.
        """
        symbols = None if self.numbers is None else self.numbers(limit)
        if symbols is not None:
            return symbols
        return SimpleNamespace(**{n: ca.DM(value) for n, value in limit.constants().items()})

    def straight(self, displacement: Expression) -> Expression:
        """Return a displacement of `Limit.margins` (6,) without the addition of a rising mean.

        The result is parallel to the twist.
        """
        if self.overshoot is None or self.overshoot_bound is None:
            return displacement
        return displacement - ca.fmax(
            -self.overshoot_bound, ca.fmin(self.overshoot_bound, self.overshoot)
        )

    def reduced(self, name: str, rows: Rows) -> Rows:
        """Return rows of the object side without the distances in `margin_reduction`.

        Every hard limit must return its rows through this function. It subtracts the error with
        which the object is measured, and motion of which it is unknown whether it is done.

        Args:
            name: name of the limit's first row.
            rows: rows at `pose`.
        """
        if name not in self.margin_reduction:
            return rows
        below, above = self.margin_reduction[name]
        return replace(rows, to_lower=rows.to_lower - below, to_upper=rows.to_upper - above)


class Surface(Protocol):
    """A limit that is an equality: projection keeps the state on it exactly.

    See `ergoqp.limits.ArmLength`.
    """

    def tangent(self, posture: ca.SX, twist: ca.SX, dt: ca.SX, acceleration: Expression) -> ca.SX:
        """Return a twist (6,) without its component normal to the surface.

        A deviation from the surface is corrected as far as `acceleration` allows.
        """
        ...

    def retract(self, posture: ca.SX, twist: ca.SX, dt: ca.SX, acceleration: Expression) -> ca.SX:
        """Return the twist (6,) that leads to the projection of ``posture + twist dt``."""
        ...

    def bow(self, posture: ca.SX, apart: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return the deviation of the projected path from a straight one.

        Returns:
            The deviation (n,) and a bound of its error.
        """
        ...


@dataclass(frozen=True)
class Rows:
    """Quantities that the twist moves, each between a lower and an upper end.

    The rate of the quantities is A xi. A distance is negative outside. The step turns rows into
    bounds of the twist that leave room for the whole stop.

    Attributes:
        matrix: A (m, 6), the rate of each quantity per unit of twist.
        to_lower: distance to the lower end (m,), inf if there is none.
        to_upper: distance to the upper end (m,), inf if there is none.
        rate: largest allowed rate (m,), inf if there is none.
        curvature_margin: distance that a curved row needs for its curvature along the swing (m,), 0
            for straight rows.

    Raises:
        ProblemError: if the shapes do not fit together.

    Example:
        >>> import casadi as ca
        >>> from ergoqp.limits import Rows
        >>> height = ca.DM([[0, 0, 1, 0, 0, 0]])
        >>> free = ca.DM([ca.inf])
        >>> rows = Rows(height, ca.DM([0.2]), ca.DM([0.3]), free, ca.DM.zeros(1))
        >>> rows.matrix.shape, float(rows.to_upper)
        ((1, 6), 0.3)
    """

    matrix: Expression
    to_lower: Expression
    to_upper: Expression
    rate: Expression
    curvature_margin: Expression

    def __post_init__(self) -> None:
        """Check the shapes.

        Raises:
            ProblemError: if they do not fit together.
        """
        m = self.matrix.shape[0]
        for name, part in vars(self).items():
            shape, allowed = (m, 1), f"{(m, 1)}, a number for each row of the matrix"
            if name == "matrix":
                shape, allowed = (m, 6), "(m, 6)"
            if (got := getattr(part, "shape", None)) != shape:
                raise ProblemError(
                    f"limits: got rows whose {name} has shape {got}, allowed {allowed}"
                )


RECOVERY_TIMES: Final = (1e-3, 1e3)
"""Least and greatest `Limit.recovery_time` [s]."""

Recovery = Annotated[float, Range(*RECOVERY_TIMES, "s")]


class Limit(Protocol):
    """The members of a limit. The last nine of the list may be left out.

    Attributes:
        names: name of each row, unique in a problem.
        unit: unit of the quantities (``"rad"``, ``"m"``), used in messages.
        hard: True: the rows depend on the object only. They are certified, stops included; the
            rows must be returned through `LimitContext.reduced`. False: the rows depend on the
            posture, through S. They are kept as far as braking allows; the posture must be taken
            with `LimitContext.shift` added.
        recovers: whether each row, when it is outside, asks for a motion back. Rows of the object
            usually do. Rows of a posture usually do not, so that a joint that is measured wrongly
            does not move the object.
        tolerance: distance outside that still counts as on the limit, for sensor noise, in `unit`.
        recovery_time: time constant of the return from outside [s]. The speed back is
            distance / recovery_time.
        yield_zone: distance to the end from which on a joint of the response is held, so that the
            object can move on. 0: the quantity is never held. A limit with a yield zone must be
            `linear`.
        margin_is_lower_bound: whether `margins` returns a lower bound instead of the margin itself.
            A hard limit of this kind is never required to be worse than its own bound.
        linear: whether `rows` and `margins` accept matrices (`casadi.MX`) as well as scalars. The
            step is then faster. Default: False.
        curvature: approximate change of the rate of a row per rad that the object turns. The speed
            back from outside is then limited to one from which the object can stop. Default: 0.
        tangent: whether the normal of the one row depends on the measured pose, as for a half-space
            that touches a region. The declared position noise then counts twice. Default: False.
        equality: whether the state stays on the limit exactly, by projection; the limit is then a
            `Surface` too. A problem can have one such limit. Default: False.
        kind: kind of the package's own limits: ``"workspace"``, ``"tool axis"``, ``"joints"``,
            ``"boundary"`` or ``"length"``. For the first limit of each kind, the optimum, the place
            search and the checker have their own computation. All other limits are judged by
            `rows`, see `ergoqp.limits.custom`.
        violation_label: word that precedes the row's name when it is violated. Default:
            ``"outside"``.
        state: names of the coordinates that the limit is about. Default: any.
        commanded: whether the twist must be the velocity of that state itself. Default: False.
        constants: a method that returns the numbers that its rows and margins read with
            `LimitContext.given`, by name. Default: they are written into the expressions.

    Example:
        >>> import ergoqp
        >>> problem = ergoqp.load_problem("screwing")
        >>> from ergoqp.limits import WorkspaceBox
        >>> box = problem.limit_of(WorkspaceBox)
        >>> box.names, box.unit, box.hard
        (('workspace x', 'workspace y', 'workspace z'), 'm', True)
    """

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each row."""
        ...

    @property
    def unit(self) -> str:
        """Unit of the quantities."""
        ...

    @property
    def hard(self) -> bool:
        """Whether the rows are on the object side."""
        ...

    @property
    def recovers(self) -> Sequence[bool]:
        """Whether each row, once outside, asks to come back."""
        ...

    tolerance: float
    recovery_time: float
    yield_zone: float
    margin_is_lower_bound: bool

    def measure(self) -> ca.Function | None:
        """Return a function ``posture -> readings (k,)``, or None.

        It is evaluated once per step and is meant for large computations, such as a sum of
        thousands of kernels. The result is in `LimitContext.readings`.
        """
        ...

    def rows(self, context: LimitContext) -> Rows:
        """Return the rows."""
        ...

    def margins(self, context: LimitContext, displacement: ca.SX) -> ca.SX:
        """Return the smallest margin of each row (m,) on the straight path to a displacement.

        Args:
            context: where the path begins.
            displacement: of the object (6,) [m, rad]. Zero gives the present margins.
        """
        ...


def three(what: str, value: Any, largest: float = np.inf) -> tuple[float, float, float]:
    """Return a user's three numbers.

    Raises:
        InputError: if they are not finite, or larger than `largest`.
    """
    numbers = read_array(what, value, (3,), "three finite numbers")
    if np.abs(numbers).max() > largest:
        raise InputError(f"{what}: got {shown(value)}, allowed numbers up to {largest:g}")
    return float(numbers[0]), float(numbers[1]), float(numbers[2])


def straight_margins(
    rows: Rows, displacement: Expression, mixed: LimitContext | None = None
) -> Expression:
    """Return the smallest margins (m,) on the path to a displacement, for linear quantities.

    Args:
        rows: rows where the path begins.
        displacement: of the object (6,) [m, rad].
        mixed: the context, for hard rows that combine several axes. The addition of a rising mean
            is independent along each axis, and in such a row the parts could cancel each other.

    Example:
        >>> import casadi as ca
        >>> from ergoqp.limits import Rows
        >>> from ergoqp.limits.limit import straight_margins
        >>> free = ca.DM([ca.inf])
        >>> rows = Rows(ca.DM([[0, 0, 1, 0, 0, 0]]), free, ca.DM([0.3]), free, ca.DM.zeros(1))
        >>> round(float(straight_margins(rows, ca.DM([0, 0, 0.1, 0, 0, 0]))), 2)
        0.2
    """
    if mixed is None or mixed.overshoot is None or mixed.overshoot_bound is None:
        moved = rows.matrix @ displacement
        return ca.fmin(rows.to_lower + ca.fmin(moved, 0), rows.to_upper - ca.fmax(moved, 0))
    moved, led = rows.matrix @ mixed.straight(displacement), rows.matrix @ mixed.overshoot
    most = ca.fabs(rows.matrix) @ mixed.overshoot_bound
    down = ca.fmin(moved, 0) + ca.fmax(ca.fmin(led, 0), -most)
    up = ca.fmax(moved, 0) + ca.fmin(ca.fmax(led, 0), most)
    return ca.fmin(rows.to_lower + down, rows.to_upper - up)
