"""A limit: the contact point stays below a height."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from ergoqp.limits import LimitContext, Rows
from ergoqp.limits.limit import straight_margins


@dataclass(frozen=True)
class Ceiling:
    """A row on the object side: its z is at most `height` [m]."""

    height: float
    tolerance: float = 1e-6
    recovery_time: float = 2.0
    names = ("ceiling",)
    unit = "m"
    hard = True
    recovers = (True,)
    yield_zone = 0.0
    margin_is_lower_bound = False
    linear = True

    def measure(self) -> None:
        """Need nothing measured beforehand."""

    def rows(self, context: LimitContext) -> Rows:
        """Return how fast z grows with the twist, and how far it is from the height."""
        matrix = ca.DM(1, 6)
        matrix[0, 2] = 1.0
        free = ca.DM([ca.inf])
        left = self.height - context.pose[2, 3]
        return context.reduced("ceiling", Rows(matrix, free, left, free, ca.DM.zeros(1)))

    def margins(self, context: LimitContext, displacement: ca.SX) -> ca.SX:
        """Return the smallest distance on a straight way: a height is linear."""
        return straight_margins(self.rows(context), displacement)
