"""Bounds on the twist, per axis, and how far the object moves at most until it stands still.

Bounds on the twist, per axis: largest speed and largest acceleration. The bounds that follow for
one period are in `ergoqp.limits.twist_and_stopping`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Final

import casadi as ca
import numpy as np

from ergoqp.arguments import Range, check_parameters, names_of, shown
from ergoqp.errors import InputError
from ergoqp.expressions import column, present
from ergoqp.limits.limit import Expression, LimitContext

AXES: Final = ("x", "y", "z", "rx", "ry", "rz")
"""The six axes of a twist: along and about the world's x, y and z.

Example:
    >>> from ergoqp.limits import AXES
    >>> AXES
    ('x', 'y', 'z', 'rx', 'ry', 'rz')
"""


Speed = Annotated[float, Range(1e-9, 1e6, "m/s", (0.005, 1.0))]
Acceleration = Annotated[float, Range(1e-9, 1e6, "m/s^2", (0.02, 5.0))]


@dataclass(frozen=True)
class TwistLimit:
    """Largest speed, largest acceleration and allowed axes of the object, each axis by itself.

    Braking scales the whole twist down along a straight line, as fast as the slowest axis allows. A
    stop from twist xi then takes ``max_i |xi_i| / a_i`` seconds and moves the object along xi only.
    So a convex limit that holds at both ends of the stop holds during the whole stop.

    Attributes:
        linear_speed: largest speed along each axis [m/s].
        angular_speed: largest speed about each axis [rad/s].
        linear_acceleration: largest acceleration along each axis [m/s^2].
        angular_acceleration: largest acceleration about each axis [rad/s^2].
        axes: axes that the object can move, of `AXES`.
        aside: acceleration that the step does not use on any axis, because a surface needs it
            [m/s^2].

    Raises:
        InputError: if a value has the wrong type or is out of range.

    Example:
        >>> from ergoqp.limits import TwistLimit
        >>> limit = TwistLimit(linear_speed=0.1, axes=("x", "y", "z"))
        >>> limit.speed.tolist()
        [0.1, 0.1, 0.1, 0.0, 0.0, 0.0]
    """

    linear_speed: Speed = 0.20
    angular_speed: Annotated[float, Range(1e-9, 1e6, "rad/s", (0.02, 4.0))] = 0.80
    linear_acceleration: Acceleration = 0.60
    angular_acceleration: Annotated[float, Range(1e-9, 1e6, "rad/s^2", (0.05, 20.0))] = 2.50
    axes: tuple[str, ...] = AXES
    aside: Annotated[float, Range(0.0, 1e3, "m/s^2")] = 0.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        check_parameters(self)
        allowed = f"some of {', '.join(AXES)}, each once"
        object.__setattr__(self, "axes", names_of("axes", self.axes, allowed))
        if set(self.axes) - set(AXES) or len(set(self.axes)) != len(self.axes):
            raise InputError(f"axes: got {shown(self.axes)}, allowed {allowed}")

    @property
    def speed(self) -> np.ndarray:
        """Largest speed per axis (6,), zero for axes that cannot move [m/s, rad/s]."""
        allowed = np.array([axis in self.axes for axis in AXES])
        return allowed * np.repeat([self.linear_speed, self.angular_speed], 3)

    @property
    def acceleration(self) -> np.ndarray:
        """Acceleration per axis that the step may use (6,) [m/s^2, rad/s^2].

        It is the largest acceleration minus `aside`.
        """
        return np.repeat([self.linear_acceleration, self.angular_acceleration], 3) - self.aside


@dataclass(frozen=True)
class Stop:
    """The law by which the object of a problem stops, see `ergoqp.Problem.stop`.

    Braking scales the planned twist u down along a straight line, in ``t_b = max_i |u_i| / a_i``
    seconds, whatever the later periods are. If every twist is sent as planned, the object moves by
    at most u (dt + t_b / 2) in the period of u and the stop after it.

    If the mean of the plan over the last W seconds is sent instead, the plan is linear between the
    last twist and this one. The object then moves by u (dt / 2 + t_b / 2): half of this period
    belongs to u, and the stop follows. What was planned before is already under way
    (`ergoqp.step.delay`). Two parts are added:

    - The robot holds the mean of the end of a period during the whole period. While the mean rises,
      this is too much, by at most h times the rise, for periods up to h. The rise without u is
      under way too. The rise with u is larger by at most u, and by at most a dt.
    - The last period of a stop is a line down to rest. It ends later than the stop, which adds at
      most min(u h / 2, a h^2 / 8).

    In the step its numbers are symbols, see `StepModel.stop`; one that is zero stays a number.

    Attributes:
        limit: speeds and accelerations.
        average: W, length of the moving average [s].
        longest: h, longest period of a step that does not brake [s].
        stretch: the robot moves by at most this many times what was sent.
        hold: how long the robot may go on with a twist, once in a stop [s].
        memory: largest age of that twist [s].
    """

    limit: TwistLimit
    average: float = 0.0
    longest: float = 0.0
    stretch: float = 1.0
    hold: float = 0.0
    memory: float = 0.0

    @property
    def share(self) -> float:
        """Share of the present period that belongs to the new twist."""
        return 0.5 if self.average else 1.0

    @property
    def held(self) -> float:
        """Time at the new twist that covers one hold with any twist under way [s].

        The twist under way may have been faster.
        """
        return self.stretch * (self.hold + 2 * self.memory) if present(self.hold) else 0.0

    @property
    def duration(self) -> float:
        """Time after which nothing is sent any more, whatever was sent before [s]."""
        moves = self.limit.speed > 0
        slowest = np.max(self.limit.speed[moves] / self.limit.acceleration[moves], initial=0.0)
        return float(slowest) + self.average + self.longest

    def rise(self, dt: Expression) -> Expression:
        """Return the largest addition of a rising mean per unit of acceleration [s^2]."""
        return self.longest * dt + self.longest**2 / 8

    def time(self, twist: ca.SX) -> ca.SX:
        """Return the duration of the stop from a planned twist (6,) [s]."""
        return ca.mmax(ca.fabs(twist) / column(self.limit.acceleration))

    def displacement(self, twist: ca.SX, dt: ca.SX) -> ca.SX:
        """Return the largest displacement (6,) [m, rad] by a planned twist.

        It covers the period of the twist and the stop after it.
        """
        way = self.stretch * twist * (self.share * dt + self.time(twist) / 2)
        if self.average:
            most = self.most(dt)
            way += ca.fmax(-most, ca.fmin(most, self.lead(twist)))
        return way

    def lead(self, twist: ca.SX) -> ca.SX:
        """Return the largest addition (6,) of a mean that rises to a planned twist [m, rad].

        It holds for any acceleration.
        """
        return self.stretch * 1.5 * self.longest * twist

    def most(self, dt: Expression) -> Expression:
        """Return the largest addition of a rising mean per axis (6,), at any twist [m, rad]."""
        return self.stretch * self.rise(dt) * column(self.limit.acceleration)

    def ways(self, twist: ca.SX, dt: ca.SX) -> ca.SX:
        """Return the displacements (6, k) from which margins are computed.

        These are the `displacement` of a planned twist, the same with a hold if one is declared,
        and, with a moving average, `lead` and `most`.
        """
        ways = [self.displacement(twist, dt)]
        if present(self.hold):
            ways.append(ways[0] + self.stretch * self.hold * twist)
        return ca.horzcat(*ways, *([self.lead(twist), self.most(dt)] if self.average else []))

    def braking(self, previous: ca.SX, dt: ca.SX) -> Braking:
        """Return the braking twist and the twist bounds of a period.

        Args:
            previous: planned twist of the last period (6,) [m/s, rad/s].
            dt: period [s].
        """
        limit = self.limit
        speed, acceleration = column(limit.speed), column(limit.acceleration)
        if present(limit.aside):
            speed = ca.fmax(0, speed - limit.aside * dt)
        stop = self.time(previous)
        twist = previous * ca.fmax(0, 1 - dt / ca.fmax(stop, 1e-12))
        # A twist beyond its largest speed comes back only as fast as the acceleration allows. So
        # the bounds always include the braking twist.
        low = ca.fmin(ca.fmax(-speed, previous - acceleration * dt), twist)
        high = ca.fmax(ca.fmin(speed, previous + acceleration * dt), twist)
        return Braking(
            twist, low, high, self.stretch * (self.share * dt + (stop + dt) / 2), dt, self
        )


@dataclass(frozen=True)
class Braking:
    """The braking twist and the twist bounds after the planned twist of the last period.

    Attributes:
        twist: the braking twist (6,).
        low: lower bound of the twist of this period (6,).
        high: upper bound of the twist of this period (6,). Both bounds allow the braking twist.
        reach: longest time of motion at the new twist, with the stop after it [s].
        dt: period [s].
        stop: the law of the stop.
    """

    twist: Expression
    low: Expression
    high: Expression
    reach: Expression
    dt: Expression
    stop: Stop

    @property
    def acceleration(self) -> Expression:
        """Largest acceleration per axis (6,)."""
        return column(self.stop.limit.acceleration)

    @property
    def swing(self) -> Expression:
        """Time of motion at the new twist over which a curved row must be correct [s]."""
        return self.reach + self.stop.held

    @property
    def slowest(self) -> Expression:
        """Longest time of motion at a small new twist, with the stop after it [s].

        A rising mean counts for more in the stop from a small twist.
        """
        return self.swing + (
            self.stop.stretch * 1.5 * self.stop.longest if self.stop.average else 0.0
        )

    @property
    def change(self) -> Expression:
        """Largest change of each entry of a stop's displacement at the next twist (6,) [m, rad]."""
        return self.acceleration * self.dt * self.swing

    def fastest(self, left: Expression, slowing: Expression, hard: Expression) -> Expression:
        """Return the largest rates (m,) from which the rows can stop before an end.

        Args:
            left: distance to the end (m,) [m, rad].
            slowing: largest deceleration of each row (m,).
            hard: 1 for rows on the object side (m,). A declared hold of the robot counts for these
                only.
        """
        law = self.stop
        if law.average:
            left = ca.fmax(left - slowing * (law.stretch * law.rise(self.dt)), ca.fmin(left, 0))
        # v = d / (h + H) up to the knee. Beyond it: the parabola that is tangent there,
        # (v + a H)^2 = (a H)^2 + 2 a d - (a h)^2.
        if not present(law.held):
            knee = slowing * self.reach**2
            return (
                ca.sqrt(slowing * (2 * ca.fmax(left, knee) - knee))
                + ca.fmin(left - knee, 0) / self.reach
            )
        held = law.held * hard
        bent, kept = slowing * self.reach, slowing * held
        knee = bent * (self.reach + held)
        steep = ca.sqrt(kept**2 + 2 * slowing * ca.fmax(left, knee) - bent**2) - kept
        return steep + ca.fmin(left - knee, 0) / (self.reach + held)


def on_surface(brake: Braking, context: LimitContext, known: Expression = 1) -> Braking:
    """Return the same braking along the surface that the state stays on.

    Without a surface, return it unchanged.

    Args:
        brake: braking along a straight line.
        context: person and object.
        known: 0 if the state was not measured. A deviation from the surface is then not corrected,
            because the object would never come to rest.
    """
    if context.surface is None:
        return brake
    twist = context.surface.tangent(
        context.posture, brake.twist, brake.dt, brake.acceleration * known
    )
    return replace(
        brake, twist=twist, low=ca.fmin(brake.low, twist), high=ca.fmax(brake.high, twist)
    )
