"""What a limit gives the step: named rows over the twist, how its margins change along a stop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, Protocol

import casadi as ca

from ergoqp.errors import ProblemError

Expression = Any
"""`casadi.SX` or `casadi.MX`: the same lines write scalars to compile or vectors to interpret."""


@dataclass(frozen=True)
class Situation:
    """The person and the object at one step, as CasADi expressions.

    Attributes:
        posture: joint angles (32,) [rad], or what the state of the problem is.
        observed: 1 for joints that are seen (32,).
        pose: contact frame in the world (4, 4) [m], where the object lands when the motion under
            way is done.
        sensitivity: S (32, 6) with the locks of this pass.
        swing: displacement (6,) [m, rad] of a stop at the present twist: how far curved rows must
            look ahead.
        change: by how much each entry of the swing can differ at the next twist (6,) [m, rad].
        readings: what each limit's `measure` says at this posture, by the name of its first row.
        surface: the limit that the state has to stay on exactly, or None.
        ahead: displacement (6,) [m, rad] of the object that is under way: in `pose` already, not
            yet in `posture`.
        shift: change of the posture that is still to come from that displacement, S ahead (32,)
            [rad].
        lost: how much of the distance to the (lower, upper) ends of each hard limit's rows cannot
            be counted on, by the name of its first row; without an entry all of it can.
        turn: largest angle under way that a robot may have done already [rad]; None: there is none.
        stray: largest angle by which what is under way leaves a straight line [rad]; None: it
            matters to no row.
        raised: angle that a rising mean adds to it at most [rad]; None: it matters to no row.
        lead: what a rising mean adds at most to a displacement of `Limit.margins`, at any
            acceleration (6,) [m, rad]; None: nothing.
        most: what it adds at most at any twist (6,) [m, rad]: the displacement holds that much of
            it, along each axis by itself; None: nothing.

    Example:
        >>> import casadi as ca
        >>> from ergoqp.limits import Situation, WorkspaceBox
        >>> pose = ca.DM.eye(4)
        >>> posture, seen, still = ca.DM.zeros(32), ca.DM.ones(32), ca.DM.zeros(6)
        >>> here = Situation(posture, seen, pose, ca.DM.zeros(32, 6), still, still)
        >>> rows = WorkspaceBox((-1, -1, -1), (1, 1, 2)).rows(here)
        >>> rows.above.full().ravel().tolist()
        [1.0, 1.0, 2.0]
    """

    posture: Expression
    observed: Expression
    pose: Expression
    sensitivity: Expression
    swing: Expression
    change: Expression
    readings: Mapping[str, Expression] = field(default_factory=dict)
    surface: Surface | None = None
    ahead: Expression = field(default_factory=lambda: ca.SX(6, 1))
    shift: Expression = field(default_factory=lambda: ca.SX(32, 1))
    lost: Mapping[str, tuple[Expression, Expression]] = field(default_factory=dict)
    turn: Expression | None = None
    stray: Expression | None = None
    raised: Expression | None = None
    lead: Expression | None = None
    most: Expression | None = None

    def straight(self, displacement: Expression) -> Expression:
        """Return a displacement of `Limit.margins` (6,) without what a rising mean adds.

        What is left leads along the twist.
        """
        if self.lead is None or self.most is None:
            return displacement
        return displacement - ca.fmax(-self.most, ca.fmin(self.most, self.lead))

    def counted(self, name: str, rows: Rows) -> Rows:
        """Return rows on the object side with only the distances that can be counted on.

        Every hard limit returns these.

        Where the object is measured with an error, or what it was sent may be done already or not,
        that much is not there.

        Args:
            name: of the limit's first row.
            rows: as they are at `pose`.
        """
        if name not in self.lost:
            return rows
        below, above = self.lost[name]
        return replace(rows, below=rows.below - below, above=rows.above - above)


class Surface(Protocol):
    """A limit that is an equality: the state stays on it by projection, whatever the twist.

    See `ergoqp.limits.ArmLength`.
    """

    def tangent(self, posture: ca.SX, twist: ca.SX, dt: ca.SX, acceleration: Expression) -> ca.SX:
        """Return a twist (6,) without its part across the surface.

        What is wrong is mended as far as `acceleration` allows.
        """
        ...

    def retract(self, posture: ca.SX, twist: ca.SX, dt: ca.SX, acceleration: Expression) -> ca.SX:
        """Return the twist (6,) that leads to the projection of ``posture + twist dt``."""
        ...

    def bow(self, posture: ca.SX, apart: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return how far a projected way strays from a straight one: (vector (n,), error bound)."""
        ...


@dataclass(frozen=True)
class Rows:
    """Some quantities that the twist moves, each between two ends.

    Their rate is A xi, with `below` and `above` left to go.

    A margin is negative outside. The step turns rows into bounds that leave room for the whole
    stop.

    Attributes:
        matrix: A (m, 6): rate of each quantity per twist.
        below: distance to the lower end (m,), inf without one.
        above: distance to the upper end (m,), inf without one.
        rate: largest rate allowed (m,), inf without one.
        reserve: what a curved row must keep free for its own curvature along the swing (m,); 0 for
            straight ones.

    Raises:
        ProblemError: at construction, for shapes that do not fit together.

    Example:
        >>> import casadi as ca
        >>> from ergoqp.limits import Rows
        >>> height = ca.DM([[0, 0, 1, 0, 0, 0]])
        >>> free = ca.DM([ca.inf])
        >>> rows = Rows(height, ca.DM([0.2]), ca.DM([0.3]), free, ca.DM.zeros(1))
        >>> rows.matrix.shape, float(rows.above)
        ((1, 6), 0.3)
    """

    matrix: Expression
    below: Expression
    above: Expression
    rate: Expression
    reserve: Expression

    def __post_init__(self) -> None:
        """Check that the parts are of the same rows.

        Raises:
            ProblemError: if they are not.
        """
        one = (self.matrix.shape[0], 1)
        for name, part in vars(self).items():
            if (shape := getattr(part, "shape", None)) != (
                (one[0], 6) if name == "matrix" else one
            ):
                allowed = (
                    "(m, 6)" if name == "matrix" else f"{one}, a number for each row of the matrix"
                )
                raise ProblemError(
                    f"limits: got rows whose {name} has shape {shape}, allowed {allowed}"
                )


RECOVERY_TIMES: Final = (1e-3, 1e3)
"""Least and greatest `Limit.recovery_time` [s]."""


class Limit(Protocol):
    """A kind of row, added by a file with this protocol and a line of registration.

    Attributes:
        names: name of each row, unique in a problem.
        unit: of the quantities, for people (``"rad"``, ``"m"``).
        hard: object side (True): kept by construction, braking included; its `rows` and `margins`
            count on no more than `Situation.counted` leaves. Through S (False): kept as far as
            braking allows; they add `Situation.shift` to the posture.
        returns: whether each row, once outside, asks to come back: on the object side it does; a
            person's posture does not move the object by itself.
        tolerance: how far outside counts as still on the limit (sensor noise), in `unit`.
        recovery_time: time constant of the return from outside [s]: the speed that is asked for is
            distance / recovery_time.
        yield_zone: distance to the end within which a joint of the response yields (is locked)
            instead of stopping the object; 0 for quantities that cannot yield. A limit that has one
            is `linear`.
        linear: whether rows and margins may be asked for with matrices (`casadi.MX`) as well as
            with scalars; without the attribute they are not.
        bend: by how much the rate of its rows can change per rad that the object turns, roughly;
            without the attribute they are straight. Coming back from outside is then not asked
            faster than the object can stop where it is nearest.
        tangent: whether the direction of its one row is read off the pose, as that of a half-space
            which touches a region; without the attribute it is not. The declared noise of a
            position then counts twice, so that the object is never measured inside.
        equality: whether the state stays on it exactly, by projection, as on `Surface`; without the
            attribute it does not. A problem has one at most.
        holds: what of the world it holds, in a word: ``"workspace"``, ``"tool axis"``,
            ``"joints"``, ``"boundary"`` or ``"length"``. Places, optimum and checker know how to
            judge the package's own limit of that word, the first in a problem; all others, with the
            attribute or without, they judge by `rows` alone, see `ergoqp.limits.own_rows`.
        breach: how being beyond an end is called, before the row's name; without the attribute it
            is ``"outside"``, as of a box.
        state: names of the coordinates that it is about; without the attribute any serve.
        commanded: whether the twist must be the velocity of that state itself; without the
            attribute it need not.
        proven: whether `margins` is a lower bound and not the margin itself. A hard limit is then
            never asked for less than it promises, not even where braking has no better bound.

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
    def returns(self) -> Sequence[bool]:
        """Whether each row, once outside, asks to come back."""
        ...

    tolerance: float
    recovery_time: float
    yield_zone: float
    proven: bool

    def measure(self) -> ca.Function | None:
        """Return ``posture -> readings (k,)``, evaluated once per step as it is, or None.

        For what should not be written out as scalars, such as a sum of thousands of kernels. The
        readings come back in `Situation.readings`.
        """
        ...

    def rows(self, situation: Situation) -> Rows:
        """Return the rows at a situation."""
        ...

    def margins(self, situation: Situation, displacement: ca.SX) -> ca.SX:
        """Return each row's smallest margin (m,) on the straight way to a displacement.

        The displacement (6,) [m, rad] is that of the object.

        A displacement of zero gives the margins as they are.
        """
        ...


def straight_margins(
    rows: Rows, displacement: Expression, mixed: Situation | None = None
) -> Expression:
    """Return the smallest margins (m,) on the way to a displacement, for quantities linear in it.

    Args:
        rows: as they are where the way begins.
        displacement: of the object (6,) [m, rad].
        mixed: the situation, for hard rows of more than one axis. A mean adds to the displacement
            axis by axis, and in a row that mixes axes these parts can cancel each other.

    Example:
        >>> import casadi as ca
        >>> from ergoqp.limits import Rows
        >>> from ergoqp.limits.limit import straight_margins
        >>> free = ca.DM([ca.inf])
        >>> rows = Rows(ca.DM([[0, 0, 1, 0, 0, 0]]), free, ca.DM([0.3]), free, ca.DM.zeros(1))
        >>> round(float(straight_margins(rows, ca.DM([0, 0, 0.1, 0, 0, 0]))), 2)
        0.2
    """
    if mixed is None or mixed.lead is None or mixed.most is None:
        moved = rows.matrix @ displacement
        return ca.fmin(rows.below + ca.fmin(moved, 0), rows.above - ca.fmax(moved, 0))
    moved, led = rows.matrix @ mixed.straight(displacement), rows.matrix @ mixed.lead
    most = ca.fabs(rows.matrix) @ mixed.most
    down, up = (
        ca.fmin(moved, 0) + ca.fmax(ca.fmin(led, 0), -most),
        ca.fmax(moved, 0) + ca.fmin(ca.fmax(led, 0), most),
    )
    return ca.fmin(rows.below + down, rows.above - up)
