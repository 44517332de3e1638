"""The members of a response model, and a state that the twist moves by a fixed matrix."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ergoqp.arguments import check_number, names_of, read_array, shown
from ergoqp.coordinates import FOREARM
from ergoqp.errors import InputError


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


@dataclass(frozen=True, eq=False)
class LinearResponse:
    """S is a constant matrix: dq/dt = S xi.

    With the identity, the six entries of the twist are the velocities of the six coordinates. In
    the problem ``forearm`` these are elbow and wrist.

    Attributes:
        coordinates: names of the entries of the state.
        matrix: S (n, 6) [unit of the coordinate per m, or per rad]. None: the identity.
        comfort: preferred state (n,), in the unit of each coordinate, see `ergoqp.Control.comfort`.
            None: zero.
        largest: entries of a state beyond this count as mistakes, in their unit.

    Raises:
        InputError: if a value has the wrong type or is out of range.

    Example:
        >>> import numpy as np
        >>> from ergoqp.responses import LinearResponse
        >>> response = LinearResponse()
        >>> rates, unmet = response.sensitivity()(np.zeros(6), np.zeros(6))
        >>> bool((rates.full() == np.eye(6)).all())
        True
    """

    coordinates: Sequence[str] = FOREARM
    matrix: ArrayLike | None = None
    comfort: ArrayLike | None = None
    largest: float = 10.0

    def __post_init__(self) -> None:
        """Check shapes and numbers."""
        object.__setattr__(
            self, "coordinates", names_of("coordinates", self.coordinates, "a list of names")
        )
        n = len(self.coordinates)
        if len(set(self.coordinates)) < n:
            raise InputError(f"coordinates: got {shown(self.coordinates)}, allowed each name once")
        if self.matrix is None and n != 6:
            raise InputError(f"coordinates: got {n}, allowed 6 where no matrix is given")
        for name, value, shape in (
            ("matrix", np.eye(n, 6) if self.matrix is None else self.matrix, (n, 6)),
            ("comfort", np.zeros(n) if self.comfort is None else self.comfort, (n,)),
        ):
            object.__setattr__(
                self, name, read_array(name, value, shape, f"{shape} of finite numbers")
            )
        check_number("largest", self.largest, 1e-9, 1e9)

    @property
    def joints(self) -> tuple[str, ...]:
        """All coordinates: the twist can move each of them."""
        return tuple(self.coordinates)

    @property
    def weight_vector(self) -> np.ndarray:
        """Cost of the rate of each coordinate (n,): one for all."""
        return np.ones(len(self.coordinates))

    def expression(self, q: ca.MX) -> ca.MX:
        """Return S (n, 6), which is constant."""
        return self.sensitivity()(q, 0)[0]

    def sensitivity(self) -> ca.Function:
        """Return ``(q (n,), locked (n,)) -> (S (n, 6), E (1, 6))``.

        The state follows every twist, so E is zero.
        """
        return self._functions[0]

    def contact(self) -> ca.Function:
        """Return ``q (n,) -> (pose, pose)``. There is no object frame, so both are the identity."""
        return self._functions[1]

    @cached_property
    def _functions(self) -> tuple[ca.Function, ca.Function]:
        n = len(self.coordinates)
        q, locked = ca.SX.sym("q", n), ca.SX.sym("locked", n)
        matrix = ca.SX(ca.sparsify(ca.DM(np.asarray(self.matrix))))
        still = ca.SX.eye(4)
        return (
            ca.Function("sensitivity", [q, locked], [ca.densify(matrix), ca.SX(ca.DM.zeros(1, 6))]),
            ca.Function("contact", [q], [ca.densify(still), ca.densify(still)]),
        )
