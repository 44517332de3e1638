"""Bounds on the twist, per axis: largest speed and largest acceleration.

The bounds that follow for one period are in `ergoqp.limits.stop`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final

import numpy as np

from ergoqp.arguments import Range, check_parameters, names_of, shown
from ergoqp.errors import InputError

AXES: Final = ("x", "y", "z", "rx", "ry", "rz")
"""The six axes of a twist: along and about the world's x, y and z.

Example:
    >>> from ergoqp.limits import AXES
    >>> AXES
    ('x', 'y', 'z', 'rx', 'ry', 'rz')
"""


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

    linear_speed: Annotated[float, Range(1e-9, 1e6, "m/s", (0.005, 1.0))] = 0.20
    angular_speed: Annotated[float, Range(1e-9, 1e6, "rad/s", (0.02, 4.0))] = 0.80
    linear_acceleration: Annotated[float, Range(1e-9, 1e6, "m/s^2", (0.02, 5.0))] = 0.60
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
