"""What every response model offers to a problem and to the control step."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import casadi as ca
import numpy as np


class Response(Protocol):
    """A model of how the person's posture follows the held object: dq/dt = S(q) xi.

    Attributes:
        joints: names of the joints that the model moves; the others stay as measured.

    Example:
        >>> import ergoqp
        >>> response = ergoqp.load_problem("screwing").response
        >>> response.sensitivity().size_out(0), len(response.joints)
        ((32, 6), 27)
    """

    @property
    def coordinates(self) -> Sequence[str]:
        """Names of the state: `ergoqp.JOINTS`, or what the model moves instead of a person."""
        ...

    @property
    def largest(self) -> float:
        """Largest magnitude of a plausible entry."""
        ...

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints that the object can move, in the order of `ergoqp.JOINTS`."""
        ...

    @property
    def weight_vector(self) -> np.ndarray:
        """Cost of each joint's rate (32,), relative."""
        ...

    def expression(self, q: ca.MX) -> ca.MX:
        """Return the sensitivity S (32, 6) at the posture `q` (32,) [rad].

        It is for a world-aligned twist [m/s, rad/s].
        """
        ...

    def sensitivity(self) -> ca.Function:
        """Return the function ``(q (32,), locked (32,)) -> (S (32, 6), E (k, 6))``.

        Joints with ``locked`` 1 do not move. ``E @ twist`` is the contact motion that the posture
        cannot follow.
        """
        ...

    def contact(self) -> ca.Function:
        """Return ``q (32,) -> (contact pose (4, 4), pelvis pose (4, 4))``, both in the world."""
        ...
