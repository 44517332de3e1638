"""The interface of an ergonomic cost, and the base class of all learned costs.

The base class of all learned costs. Each cost has named inputs, gives numbers and an expression
from the same parts, and is saved without pickle.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Protocol, Self, runtime_checkable

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ergoqp.coordinates import Coordinates
from ergoqp.learning.model_file import Arrays, Settings, save_model


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


class LearnedCost(ABC):
    """An ergonomic cost V(q) that is learned from data.

    A subclass adds `fit`, `predict`, the expression of the same value, and the parts to save.

    `minimum` is the lowest score of the data. Where there were no data, the value may be
    lower.

    Attributes:
        name: name of the kind, a key of `ergoqp.costs.load.KINDS`.
        dense: the cost is evaluated with matrices; thousands of kernels are never expanded to
            scalars.
        coordinates: the inputs.
        minimum: V_min, the lowest score of the data [points].

    Example:
        >>> import numpy as np
        >>> import tempfile
        >>> from pathlib import Path
        >>> import ergoqp
        >>> from ergoqp.costs.quadratic import Quadratic
        >>> cost = Quadratic(1.0, np.zeros(1), np.ones(1), ["trunk_flexion"], 1.0)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     cost.save(Path(folder) / "cost.npz", notes={"who": "me"})
        ...     again = ergoqp.load_cost(Path(folder) / "cost.npz")
        >>> again.name, again(np.full(32, 0.5)).tolist()
        ('quadratic', [1.25])
    """

    name: ClassVar[str]
    dense: ClassVar[bool] = True

    def __init__(self, coordinates: Sequence[str], minimum: float) -> None:
        """Keep the parts that all kinds have."""
        self.coordinates, self.minimum = Coordinates(coordinates), float(minimum)

    @abstractmethod
    def predict(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return V (n,) of inputs (n, d), as the estimator computes it."""

    @abstractmethod
    def value(self, x: ca.MX) -> ca.MX:
        """Return V, a scalar expression of the inputs (d,). It agrees with `predict` to 1e-10."""

    def values(self, x: ca.MX) -> ca.MX:
        """Return the expression of V (1, k) at k columns of inputs (d, k).

        The control step evaluates the cost at several places ahead. Kinds whose matrices can
        take several columns at once override this.
        """
        return ca.horzcat(*(self.value(column) for column in ca.horzsplit(x)))

    def slope(self, x: ca.MX) -> ca.MX:
        """Return dV/dx (d,), an expression.

        Kinds with a shorter form than differentiation override this.
        """
        return ca.gradient(self.value(x), x)

    @abstractmethod
    def parts(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Return (settings for JSON, arrays): everything that `from_parts` needs."""

    @classmethod
    def from_parts(
        cls, settings: Settings, arrays: Arrays, coordinates: Sequence[str], minimum: float
    ) -> Self:
        """Return the cost with these `parts`. The arrays must have the same shapes.

        Kinds whose parts are not arguments of their constructor override this.
        """
        return cls(**settings, **arrays, coordinates=coordinates, minimum=minimum)

    def expression(self, q: ca.MX) -> ca.MX:
        """Return V(q), see :meth:`ergoqp.costs.cost.Cost.expression`. `q` is the whole state."""
        return self.function(q)

    def __call__(self, postures: ArrayLike) -> NDArray[np.float64]:
        """Return V of each state, see :meth:`ergoqp.costs.cost.Cost.__call__`. NaN gives NaN."""
        rows = self.coordinates.read(postures)
        values = np.full(len(rows), np.nan)
        whole = np.isfinite(rows).all(axis=1)
        if whole.any():
            values[whole] = self.predict(rows[whole])
        return values

    @cached_property
    def function(self) -> ca.Function:
        """``state (N,) -> cost``, a CasADi Function."""
        q = ca.MX.sym("q", len(self.coordinates.state))
        return ca.Function(
            self.name, [q], [self.value(self.coordinates.pick(q))], ["posture"], ["cost"]
        )

    @cached_property
    def value_and_gradient(self) -> ca.Function:
        """``state (N,) -> cost, gradient (N,)``, a CasADi Function.

        The gradient is in points per unit of the state.
        """
        q = ca.MX.sym("q", len(self.coordinates.state))
        x = ca.MX.sym("x", len(self.coordinates))
        inner = ca.Function("inner", [x], ca.cse([self.value(x), self.slope(x)]))
        value, slope = inner(self.coordinates.pick(q))
        gradient = ca.MX(len(self.coordinates.state), 1)
        gradient[self.coordinates.indices] = slope
        outputs = [value, ca.densify(gradient)]
        return ca.Function(f"{self.name}_gradient", [q], outputs, ["posture"], ["cost", "gradient"])

    def save(self, path: Path | str, notes: Mapping[str, Any] | None = None) -> None:
        """Write the cost to a file (npz with a JSON header and a checksum).

        Args:
            path: path of the file.
            notes: other facts for readers of the file, for example test results; JSON must be
                able to hold them.

        Raises:
            ModelError: if the file cannot be written.
        """
        settings, arrays = self.parts()
        header = {
            "kind": self.name,
            "coordinates": list(self.coordinates.names),
            "minimum": self.minimum,
            "settings": settings,
            "notes": dict(notes or {}),
        }
        save_model(path, header, arrays)
