"""How the object stops: straight, as fast as its slowest axis allows; and how far at most."""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from ergoqp.limits.limit import Expression, Situation
from ergoqp.limits.twist import TwistLimit


@dataclass(frozen=True)
class Stop:
    """The law by which a problem's object stops, see `ergoqp.Problem.stop`.

    Braking scales the planned twist u down along a straight line, in ``t_b = max_i |u_i| / a_i``
    seconds, whatever the periods of the steps to come. Where every twist is sent as planned, the
    object moves by at most u (dt + t_b / 2) in the period of u and the stop after it.

    Where the mean of the plan over the last W seconds is sent instead, the plan is a line from the
    last twist to this one, and the object moves by the half of this period that belongs to u and by
    the stop, u (dt / 2 + t_b / 2); what was planned before is under way already
    (`ergoqp.step.under_way.motion`). But a period is held at the mean of its end, which is more
    than it was on the way there while the mean still rises: by h times the rise at most, for
    periods up to h. By how much it rises without u is under way too; with u it is at most u, and at
    most a dt, more. And the last period of a stop is a line down to rest that ends later than the
    stop would have, by at most min(u h / 2, a h^2 / 8).

    Attributes:
        limit: speeds and accelerations.
        average: W [s].
        longest: h, longest period that a step may be called with without braking [s].
        stretch: the robot moves by at most this many times what was sent.
        hold: for how long it may go on with a twist, once in a stop [s].
        memory: how old that twist may be [s].
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
        """Seconds at the new twist that cover one hold with any twist under way [s].

        The twist under way may have been faster.
        """
        return self.stretch * (self.hold + 2 * self.memory) if self.hold else 0.0

    @property
    def duration(self) -> float:
        """Seconds after which nothing is sent any more, whatever was sent before."""
        moves = self.limit.speed > 0
        slowest = np.max(self.limit.speed[moves] / self.limit.acceleration[moves], initial=0.0)
        return float(slowest) + self.average + self.longest

    def rise(self, dt: Expression) -> Expression:
        """Return the most a mean rising with the new twist adds, per unit of acceleration [s^2]."""
        return self.longest * dt + self.longest**2 / 8

    def time(self, twist: ca.SX) -> ca.SX:
        """Return how long it takes to stop from a planned twist (6,) [s]."""
        return ca.mmax(ca.fabs(twist) / ca.DM(self.limit.acceleration))

    def displacement(self, twist: ca.SX, dt: ca.SX) -> ca.SX:
        """Return the largest displacement (6,) [m, rad] that a planned twist adds.

        It adds this in its period and the stop after it.
        """
        way = self.stretch * twist * (self.share * dt + self.time(twist) / 2)
        if self.average:
            most = self.most(dt)
            way += ca.fmax(-most, ca.fmin(most, self.lead(twist)))
        return way

    def lead(self, twist: ca.SX) -> ca.SX:
        """Return the largest displacement (6,) that a mean rising to a planned twist can add.

        It holds at any acceleration.
        """
        return self.stretch * 1.5 * self.longest * twist

    def most(self, dt: Expression) -> Expression:
        """Return what it can add at most along each axis (6,) at any twist."""
        return self.stretch * self.rise(dt) * ca.DM(self.limit.acceleration)

    def ways(self, twist: ca.SX, dt: ca.SX) -> ca.SX:
        """Return the displacements (6, k) by which margins are judged.

        They are the `displacement` of a planned twist, the one with a hold if that is declared, and
        of a mean its `lead` and the `most` of it.
        """
        ways = [self.displacement(twist, dt)]
        if self.hold:
            ways.append(ways[0] + self.stretch * self.hold * twist)
        return ca.horzcat(*ways, *([self.lead(twist), self.most(dt)] if self.average else []))

    def braking(self, previous: ca.SX, dt: ca.SX) -> Braking:
        """Return braking twist and twist bounds after the planned twist `previous` (6,).

        They are for a period `dt` [s].
        """
        limit = self.limit
        speed, acceleration = ca.DM(limit.speed), ca.DM(limit.acceleration)
        if limit.aside:
            speed = ca.fmax(0, speed - limit.aside * dt)
        stop = self.time(previous)
        twist = previous * ca.fmax(0, 1 - dt / ca.fmax(stop, 1e-12))
        # A twist beyond its speed can only come back as fast as the acceleration allows, so the
        # braking twist is never excluded.
        low = ca.fmin(ca.fmax(-speed, previous - acceleration * dt), twist)
        high = ca.fmax(ca.fmin(speed, previous + acceleration * dt), twist)
        return Braking(
            twist, low, high, self.stretch * (self.share * dt + (stop + dt) / 2), dt, self
        )


@dataclass(frozen=True)
class Braking:
    """What braking does from the planned twist of the last period.

    Attributes:
        twist: the braking twist (6,).
        low: least twist of this period (6,).
        high: greatest twist of this period (6,); both allow the braking twist.
        reach: seconds of motion at the new twist that a stop from it takes at most [s].
        dt: period [s].
        stop: the law.
    """

    twist: Expression
    low: Expression
    high: Expression
    reach: Expression
    dt: Expression
    stop: Stop

    @property
    def acceleration(self) -> ca.DM:
        """Largest acceleration per axis (6,)."""
        return ca.DM(self.stop.limit.acceleration)

    @property
    def swing(self) -> Expression:
        """Seconds of motion at the new twist for which a curved row looks ahead [s]."""
        return self.reach + self.stop.held

    @property
    def slowest(self) -> Expression:
        """Seconds of motion at the new twist in the stop from a small one [s].

        A mean that rises counts for more in the stop from a small twist.
        """
        return self.swing + (
            self.stop.stretch * 1.5 * self.stop.longest if self.stop.average else 0.0
        )

    @property
    def change(self) -> Expression:
        """By how much each entry of a stop's displacement can differ (6,) [m, rad].

        The difference is from that of the present twist.
        """
        return self.acceleration * self.dt * self.swing

    def fastest(self, left: Expression, slowing: Expression, hard: Expression) -> Expression:
        """Return the rates (m,) from which rows are stopped in time by an end that is so far away.

        Args:
            left: distance to the end (m,) [m, rad].
            slowing: by how much each row can be slowed per second (m,).
            hard: 1 for rows on the object side (m,): what a robot may hold on to is kept free of
                them.
        """
        law = self.stop
        if law.average:
            left = ca.fmax(left - slowing * (law.stretch * law.rise(self.dt)), ca.fmin(left, 0))
        # v = d / (h + H) up to the knee, and from there on its tangent parabola (v + a H)^2 = (a
        # H)^2 + 2 a d - (a h)^2.
        if not law.held:
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


def on_surface(brake: Braking, situation: Situation, known: Expression = 1) -> Braking:
    """Return the same braking along the surface that the state has to stay on.

    Without a surface it is returned as it is.

    Args:
        brake: along a straight line.
        situation: where things are.
        known: 0 if the state was not measured: its distance from the surface is not mended then, or
            it would never rest.
    """
    if situation.surface is None:
        return brake
    twist = situation.surface.tangent(
        situation.posture, brake.twist, brake.dt, brake.acceleration * known
    )
    return replace(
        brake, twist=twist, low=ca.fmin(brake.low, twist), high=ca.fmax(brake.high, twist)
    )
