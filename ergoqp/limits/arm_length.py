"""The forearm keeps its length: elbow and wrist move as one rigid segment.

Projection keeps the length exactly at every step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ergoqp.arguments import Range, check_parameters, check_text
from ergoqp.coordinates import FOREARM
from ergoqp.errors import InputError
from ergoqp.limits.limit import Expression, Recovery, Rows, Situation
from ergoqp.limits.twist import TwistLimit

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
    proven = False
    returns = (True,)
    unit = "m"
    equality = True
    commanded = True
    state = FOREARM
    holds = "length"

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

    def rows(self, situation: Situation) -> Rows:
        """Return the tangent: the rate at which the distance of the two points grows.

        It has no ends to stop before; the step keeps it as an equality.
        """
        along = _direction(situation.posture)
        matrix = ca.horzcat(-along.T, along.T)
        free = ca.SX([ca.inf])
        return Rows(matrix, free, free, free, ca.SX(1, 1))

    def margins(self, situation: Situation, displacement: ca.SX) -> ca.SX:
        """Return minus the present error of the length; projection keeps it on the whole path."""
        return -ca.fabs(_distance(situation.posture) - self.length)

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
