"""The interface of an ergonomic cost: an expression for the controller, numbers for other code."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray


@runtime_checkable
class Cost(Protocol):
    """Ergonomic cost V(q) of a posture, in REBA points, as a differentiable function.

    A cost is a CasADi expression. The controller takes its exact gradient by algorithmic
    differentiation. The numeric call must give the same values as the expression. To add a
    cost, write one class with these four members. It does not have to inherit from this one.

    An example is a quadratic cost around a comfortable posture ``q0`` with weights ``w``, both
    of shape (32,)::

        class Quadratic:
            name = "quadratic"
            minimum = 1.0

            def expression(self, q):
                return 1 + ca.dot(w * (q - q0), q - q0)

            def __call__(self, postures):
                return 1 + ((np.atleast_2d(postures) - q0) ** 2 @ w)

    Example:
        >>> import casadi as ca
        >>> import numpy as np
        >>> from ergoqp.costs.cost import Cost
        >>> class Upright:
        ...     name = "upright"
        ...     minimum = 1.0
        ...     def expression(self, q):
        ...         return 1 + q[0] ** 2
        ...     def __call__(self, postures):
        ...         return 1 + np.atleast_2d(postures)[:, 0] ** 2
        >>> isinstance(Upright(), Cost), Upright()(np.zeros((2, 32))).tolist()
        (True, [1.0, 1.0])
    """

    @property
    def name(self) -> str:
        """Short name for tables and figures, for example ``"smooth_reba"``."""
        ...

    @property
    def minimum(self) -> float:
        """V_min: no posture costs less [points].

        The step uses a Gauss-Newton model of V - V_min, which must not be negative.
        """
        ...

    def expression(self, q: ca.MX) -> ca.MX:
        """Return V(q), a scalar expression [points].

        Args:
            q: posture, shape (32,), in the order of :data:`ergoqp.JOINTS` [rad].
        """
        ...

    def __call__(self, postures: ArrayLike) -> NDArray[np.float64]:
        """Return V of each posture, shape (n,) [points].

        Args:
            postures: shape (n, 32), or (32,) for one [rad].
        """
        ...
