"""Limits of the state itself: the boundary of the data, and the length of the forearm.

The posture stays where there were data: the boundary of a one-class SVM as one row. The row holds
through the whole stop.

The forearm keeps its length: elbow and wrist move as one rigid segment. Projection keeps the length
exactly at every step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final, Protocol

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ergoqp.arguments import Range, check_has, check_parameters, check_text
from ergoqp.coordinates import FOREARM, Coordinates
from ergoqp.errors import InputError
from ergoqp.limits.limit import Expression, LimitContext, Recovery, Rows
from ergoqp.limits.twist_and_stopping import TwistLimit


class BoundaryModel(Protocol):
    """What the limit needs of a one-class machine, see `ergoqp.learning.one_class.OneClass`."""

    @property
    def coordinates(self) -> Coordinates:
        """Which entries of the state the model reads."""
        ...

    @property
    def gamma(self) -> float:
        """Return gamma of the kernels, in scaled coordinates."""
        ...

    @property
    def scale(self) -> np.ndarray:
        """Scale of each coordinate (d,)."""
        ...

    @property
    def margin_and_slope(self) -> ca.Function:
        """``x (d,) -> g, grad g (d,)``, a CasADi Function of dense matrices."""
        ...


@dataclass(frozen=True, eq=False)
class OneClassBoundary:
    """The boundary g(q) >= 0 of a one-class SVM with radial kernels.

    Here g = log sum a_i k(q, s_i) - log rho.

    The logarithm does not change the boundary, and its slope does not vanish far away. g is the
    logarithm of a sum of exponentials of concave quadratics, so its curvature is never below -2
    gamma. With the scaled displacement D::

        g(q + D) >= g(q) + grad g . D - gamma |D|^2

    everywhere. The row requires that this bound is not negative at the end of the longest stop that
    this period can cause. Along a straight path the bound is concave, so its two ends decide.
    Braking along an accepted path never makes it worse.

    Attributes:
        model: the one-class SVM.
        hard: True where the state itself is commanded (`LinearResponse`): the boundary is kept by
            construction. False for a person's posture: it is kept as far as braking allows.
        tolerance: value outside that still counts as on the boundary, in units of g
            (dimensionless).
        recovery_time: time constant of the return from outside [s]. The speed back is distance /
            recovery_time.
        name: name of the row.

    Raises:
        InputError: if a value has the wrong type or is out of range.

    Example:
        >>> import numpy as np
        >>> from ergoqp.learning.one_class import OneClass
        >>> from ergoqp.limits import OneClassBoundary
        >>> points = np.random.default_rng(0).normal(0.3, 0.1, (60, 2))
        >>> seen = OneClass.fit(points, ["trunk_flexion", "neck_flexion"])
        >>> OneClassBoundary(seen, name="seen before").names
        ('seen before',)
    """

    model: BoundaryModel
    hard: bool = False
    tolerance: Annotated[float, Range(0.0, 1e3)] = 1e-9
    recovery_time: Recovery = 0.25
    name: str = "boundary"
    yield_zone = 0.0
    margin_is_lower_bound = True
    unit = "log"
    kind = "boundary"

    def __post_init__(self) -> None:
        """Check the numbers."""
        allowed = "a one-class SVM, such as ergoqp.learning.one_class.OneClass"
        check_has("model", self.model, "margin_and_slope", allowed)
        check_text("name", self.name)
        check_parameters(self)

    @property
    def recovers(self) -> tuple[bool, ...]:
        """Whether the row asks to come back. A posture does not move the object by itself."""
        return (self.hard,)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of the one row."""
        return (self.name,)

    def measure(self) -> ca.Function:
        """Return ``posture -> (g, grad g)`` stacked (1 + d,).

        The gradient is in the coordinates of the model.
        """
        coordinates = self.model.coordinates
        q = ca.MX.sym("q", len(coordinates.state))
        value, slope = self.model.margin_and_slope(coordinates.pick(q))
        return ca.Function("boundary", [q], [ca.vertcat(value, slope)])

    def rows(self, context: LimitContext) -> Rows:
        """Return the one row and its reserve.

        The reserve is gamma times the square of the longest scaled displacement.
        """
        moves = self._moves(context)
        scaled = self._scaled(moves)
        # Any twist of this period causes the swing plus at most the change, entry by entry.
        lengths = ca.sqrt(ca.sum1(scaled**2))
        longest = (
            ca.norm_2(scaled @ (context.stop_displacement + context.pending_displacement))
            + lengths @ context.change
        )
        value, slope = self._reading(context)
        value = value + ca.dot(slope, context.shift[self.model.coordinates.indices])
        swing, change = context.stop_displacement, context.change
        drop, stray = self._bow(
            context, ca.norm_2(swing[3:] - swing[:3]) + ca.norm_2(change[3:] + change[:3])
        )
        free = ca.SX([ca.inf])
        return Rows(
            slope.T @ moves, value, free, free, drop + self.model.gamma * (longest + stray) ** 2
        )

    def margins(self, context: LimitContext, displacement: ca.SX) -> ca.SX:
        """Return the smallest value of the bound on a straight path, at one of its ends."""
        value, slope = self._reading(context)
        moved = self._moves(context) @ (context.pending_displacement + displacement)
        drop, stray = self._bow(context, ca.norm_2(displacement[3:] - displacement[:3]))
        length = ca.sqrt(ca.sumsqr(self._scaled(moved)) + 1e-30) + stray
        return value + ca.fmin(0, ca.dot(slope, moved) - drop - self.model.gamma * length**2)

    def _bow(self, context: LimitContext, apart: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return the loss by a surface that bends the path: (drop of the bound, extra length).

        The extra length is scaled.
        """
        if context.surface is None:
            return ca.SX(0), ca.SX(0)
        _, slope = self._reading(context)
        pull, rest = context.surface.bow(context.posture, apart)
        pull = pull[self.model.coordinates.indices]
        drop = ca.fmax(0, -ca.dot(slope, pull)) + ca.norm_2(slope) * rest
        return drop, (ca.norm_2(pull) + rest) / float(self.model.scale.min())

    def _reading(self, context: LimitContext) -> tuple[ca.SX, ca.SX]:
        reading = context.readings[self.name]
        return reading[0], reading[1:]

    def _moves(self, context: LimitContext) -> ca.SX:
        """Return how the inputs of the model follow the object (d, 6)."""
        return context.sensitivity[self.model.coordinates.indices, :]

    def _scaled(self, rows: ca.SX) -> ca.SX:
        return ca.diag(ca.DM(1 / self.model.scale)) @ rows


RETURN: Final = 0.05
"""Share of the acceleration that corrects a wrong length."""


@dataclass(frozen=True)
class ArmLength:
    """Elbow and wrist keep their distance, where they are the state and the twist moves them.

    The row is an equality, the tangent of this surface. The deviation of a straight path from the
    surface grows with the square of its length. So every twist is projected first: both points are
    moved along their connecting line, each by half of the error. The step judges and sends the
    twist that leads there. Turning needs an acceleration of v^2 / length, for the relative velocity
    v; `aside` keeps it free.

    A measured length that is wrong is corrected slowly, at `RETURN` times what the acceleration
    allows in one period.

    Attributes:
        length: distance of elbow and wrist [m].
        name: name of the row.
        tolerance: error that still counts as on the limit, for noise [m].
        recovery_time: time constant of the return from outside [s]. The speed back is distance /
            recovery_time.

    Raises:
        InputError: if a value has the wrong type or is out of range.

    Example:
        >>> import numpy as np
        >>> from ergoqp.limits import ArmLength
        >>> limit = ArmLength(0.25)
        >>> state = limit.project([[0, 0, 0, 0.3, 0, 0]])
        >>> state.round(3).tolist()
        [[0.025, 0.0, 0.0, 0.275, 0.0, 0.0]]
    """

    length: Annotated[float, Range(1e-3, 100.0, "m", (0.1, 0.5))]
    name: str = "arm length"
    tolerance: Annotated[float, Range(0.0, 1.0, "m")] = 1e-6
    recovery_time: Recovery = 1.0
    yield_zone = 0.0
    hard = True
    margin_is_lower_bound = False
    recovers = (True,)
    unit = "m"
    equality = True
    commanded = True
    state = FOREARM
    kind = "length"

    def __post_init__(self) -> None:
        """Check the numbers and the name."""
        check_text("name", self.name)
        check_parameters(self, f"{self.name} ")

    @property
    def names(self) -> tuple[str, ...]:
        """Name of the one row."""
        return (self.name,)

    def measure(self) -> None:
        """Return None: nothing is computed beforehand."""

    def constants(self) -> dict[str, np.ndarray]:
        """Return the ``length`` (1,) [m]."""
        return {"length": np.array([self.length])}

    def structure(self) -> tuple[()]:
        """Return nothing: all lengths have the same operations."""
        return ()

    def rows(self, context: LimitContext) -> Rows:
        """Return the tangent: the rate at which the distance of the two points grows.

        It has no ends to stop before; the step keeps it as an equality.
        """
        along = _direction(context.posture)
        matrix = ca.horzcat(-along.T, along.T)
        free = ca.SX([ca.inf])
        return Rows(matrix, free, free, free, ca.SX(1, 1))

    def margins(self, context: LimitContext, displacement: ca.SX) -> ca.SX:
        """Return minus the present error of the length; projection keeps it on the whole path."""
        return -ca.fabs(_distance(context.posture) - context.given(self).length)

    def aside(self, limit: TwistLimit) -> float:
        """Return the acceleration that keeping and correcting the length can need [m/s^2].

        It is needed on every axis of the twist.

        Raises:
            InputError: if too little acceleration remains for everything else.
        """
        apart = float(np.linalg.norm(limit.speed[:3] + limit.speed[3:]))
        least = float(limit.acceleration.min())
        needed = apart**2 / (2 * self.length) + RETURN * least
        if needed > 0.8 * least:
            raise InputError(
                f"{self.name}: got speeds at which turning a forearm of {self.length:g} m takes"
                f" {needed:.2g} m/s^2, allowed 0.8 of the acceleration, {0.8 * least:.2g} m/s^2;"
                " lower the speed or raise the acceleration"
            )
        return needed

    def tangent(self, posture: ca.SX, twist: ca.SX, dt: ca.SX, acceleration: Expression) -> ca.SX:
        """Return the twist (6,) without its component normal to the surface.

        Only the speed that corrects a wrong length remains in that direction.
        """
        along = _direction(posture)
        normal = ca.vertcat(-along, along)
        return (
            twist
            + normal * (self._mended(posture, dt, acceleration) / dt - ca.dot(normal, twist)) / 2
        )

    def retract(self, posture: ca.SX, twist: ca.SX, dt: ca.SX, acceleration: Expression) -> ca.SX:
        """Return the twist (6,) from the state to the projection of ``state + twist dt``."""
        target = posture + twist * dt
        wanted = _distance(posture) + self._mended(posture, dt, acceleration)
        along = _direction(target)
        return twist + ca.vertcat(-along, along) * (wanted - _distance(target)) / (2 * dt)

    def bow(self, posture: ca.SX, apart: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return the deviation of a projected path from a straight one [m].

        `apart` is the relative displacement of the two points along the path [m].

        Returns:
            The inward deviation (6,), largest at the end of the path, and a bound of its error, as
            a length: an arc of angle f = apart / length bends by length (1 - cos f) and is shorter
            by length (f - sin f), shared by the two points.
        """
        along = _direction(posture)
        pull = ca.vertcat(along, -along) * apart**2 / (4 * self.length)
        return pull, np.sqrt(2) / 12 * apart**3 / self.length**2

    def _mended(self, posture: ca.SX, dt: ca.SX, acceleration: Expression) -> ca.SX:
        """Return the correction of the length in this period [m]."""
        most = RETURN * ca.mmin(acceleration) * dt**2
        return ca.fmax(-most, ca.fmin(most, self.length - _distance(posture)))

    def project(self, points: ArrayLike) -> np.ndarray:
        """Return states (n, 6) with the right length: each point is moved by half the error."""
        points = np.array(points, dtype=float, ndmin=2)
        apart = points[:, 3:] - points[:, :3]
        distance = np.linalg.norm(apart, axis=1, keepdims=True)
        shift = apart / distance * (self.length - distance) / 2
        return points + np.hstack([-shift, shift])


def _distance(posture: ca.SX) -> ca.SX:
    return ca.norm_2(posture[3:6] - posture[:3])


def _direction(posture: ca.SX) -> ca.SX:
    apart = posture[3:6] - posture[:3]
    return apart / ca.fmax(ca.norm_2(apart), 1e-6)
