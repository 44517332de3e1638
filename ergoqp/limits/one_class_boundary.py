"""The posture stays where there were data: the boundary of a one-class SVM as one row.

The row holds through the whole stop.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Protocol

import casadi as ca
import numpy as np

from ergoqp.arguments import Range, check_parameters, check_text, object_of, shown
from ergoqp.coordinates import Coordinates
from ergoqp.errors import InputError
from ergoqp.limits.limit import Recovery, Rows, Situation


class BoundaryModel(Protocol):
    """What the limit needs of a one-class machine, see `ergoqp.learning.one_class.OneClass`."""

    coordinates: Coordinates
    gamma: float
    scale: np.ndarray

    def margin_and_slope(self, x: ca.MX) -> tuple[ca.MX, ca.MX]:
        """Return g and its gradient at a point, in the coordinates of the model."""
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
        >>>         >>> from ergoqp.limits import OneClassBoundary
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
    proven = True
    unit = "log"
    holds = "boundary"

    def __post_init__(self) -> None:
        """Check the numbers."""
        known = hasattr(self.model, "margin_and_slope")
        if not known or isinstance(self.model, type):
            allowed = "a one-class SVM, such as ergoqp.learning.one_class.OneClass"
            if known and isinstance(self.model, type):
                allowed = object_of(self.model)
            raise InputError(f"model: got {shown(self.model)}, allowed {allowed}")
        check_text("name", self.name)
        check_parameters(self)

    @property
    def returns(self) -> tuple[bool, ...]:
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

    def rows(self, situation: Situation) -> Rows:
        """Return the one row and its reserve.

        The reserve is gamma times the square of the longest scaled displacement.
        """
        moves = self._moves(situation)
        scaled = self._scaled(moves)
        # Any twist of this period causes the swing plus at most the change, entry by entry.
        lengths = ca.sqrt(ca.sum1(scaled**2))
        longest = (
            ca.norm_2(scaled @ (situation.swing + situation.ahead)) + lengths @ situation.change
        )
        value, slope = self._reading(situation)
        value = value + ca.dot(slope, situation.shift[self.model.coordinates.indices])
        swing, change = situation.swing, situation.change
        drop, stray = self._bow(
            situation, ca.norm_2(swing[3:] - swing[:3]) + ca.norm_2(change[3:] + change[:3])
        )
        free = ca.SX([ca.inf])
        return Rows(
            slope.T @ moves, value, free, free, drop + self.model.gamma * (longest + stray) ** 2
        )

    def margins(self, situation: Situation, displacement: ca.SX) -> ca.SX:
        """Return the smallest value of the bound on a straight path, at one of its ends."""
        value, slope = self._reading(situation)
        moved = self._moves(situation) @ (situation.ahead + displacement)
        drop, stray = self._bow(situation, ca.norm_2(displacement[3:] - displacement[:3]))
        length = ca.sqrt(ca.sumsqr(self._scaled(moved)) + 1e-30) + stray
        return value + ca.fmin(0, ca.dot(slope, moved) - drop - self.model.gamma * length**2)

    def _bow(self, situation: Situation, apart: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return the loss by a surface that bends the path: (drop of the bound, extra length).

        The extra length is scaled.
        """
        if situation.surface is None:
            return ca.SX(0), ca.SX(0)
        _, slope = self._reading(situation)
        pull, rest = situation.surface.bow(situation.posture, apart)
        pull = pull[self.model.coordinates.indices]
        drop = ca.fmax(0, -ca.dot(slope, pull)) + ca.norm_2(slope) * rest
        return drop, (ca.norm_2(pull) + rest) / float(self.model.scale.min())

    def _reading(self, situation: Situation) -> tuple[ca.SX, ca.SX]:
        reading = situation.readings[self.name]
        return reading[0], reading[1:]

    def _moves(self, situation: Situation) -> ca.SX:
        """Return how the inputs of the model follow the object (d, 6)."""
        return situation.sensitivity[self.model.coordinates.indices, :]

    def _scaled(self, rows: ca.SX) -> ca.SX:
        return ca.diag(ca.DM(1 / self.model.scale)) @ rows
