"""The members of a response model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import casadi as ca
import numpy as np


class Response(Protocol):
    """A model of how the person's posture follows the held object: dq/dt = S(q) xi.

    Attributes:
        coordinates: names of the entries of the state (32): `ergoqp.JOINTS` for a person.
        largest: largest plausible magnitude of an entry [rad]. A larger one is taken for a mistake.
        joints: names of the joints that the model moves. The others stay as measured.
        weight_vector: relative cost of moving each joint (32,).
        comfort: posture (32,) [rad] that the step approaches where the cost is flat. May be left
            out: zeros.
        stance: ``"standing"`` or ``"seated"``. May be left out.

    Example:
        >>> import ergoqp
        >>> response = ergoqp.load_problem("screwing").response
        >>> response.sensitivity().size_out(0), len(response.joints)
        ((32, 6), 27)
    """

    @property
    def coordinates(self) -> Sequence[str]:
        """Names of the entries of the state."""
        ...

    @property
    def largest(self) -> float:
        """Largest plausible magnitude of an entry."""
        ...

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints that the object can move, in the order of `ergoqp.JOINTS`."""
        ...

    @property
    def weight_vector(self) -> np.ndarray:
        """Relative cost of moving each joint (32,)."""
        ...

    def expression(self, q: ca.MX) -> ca.MX:
        """Return S (32, 6) [rad/m, 1] at the posture `q` (32,) [rad].

        The twist that it multiplies is along the world's axes [m/s, rad/s].
        """
        ...

    def sensitivity(self) -> ca.Function:
        """Return the function ``(q (32,), locked (32,)) -> (S (32, 6), E (k, 6))``.

        A joint with ``locked`` 1 does not move. ``E @ twist`` is the part of the contact's motion
        that the posture cannot follow.
        """
        ...

    def contact(self) -> ca.Function:
        """Return ``q (32,) -> (contact pose (4, 4), pelvis pose (4, 4))``, both in the world."""
        ...
