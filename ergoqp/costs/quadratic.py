"""The classical baseline: the sum of one quadratic per joint. It is convex."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ergoqp.arguments import check_kind
from ergoqp.costs.cost import LearnedCost
from ergoqp.datasets.data import DataSet
from ergoqp.errors import ModelError


class Quadratic(LearnedCost):
    """V(x) = a + sum_j (b_j x_j + c_j x_j^2) with c_j >= 0.

    Args:
        constant: a [points].
        slopes: b (d,) [points per unit of the inputs].
        curvatures: c (d,), not negative [points per unit squared].
        coordinates: the inputs.
        minimum: V_min, the lowest score of the data [points].

    Raises:
        ModelError: if the number of slopes or curvatures differs from the number of inputs, or
            a curvature is negative.

    Example:
        >>> import numpy as np
        >>> from ergoqp.costs.quadratic import Quadratic
        >>> from ergoqp.datasets.data import DataSet
        >>> x = np.linspace(-1, 1, 9)[:, None]
        >>> cost = Quadratic.fit(DataSet(x, 2 + 3 * x[:, 0] ** 2, ("trunk_flexion",)))
        >>> cost.predict(np.array([[0.5]])).round(3).tolist()
        [2.75]
    """

    name = "quadratic"

    def __init__(
        self,
        constant: float,
        slopes: NDArray,
        curvatures: NDArray,
        coordinates: Sequence[str],
        minimum: float,
    ) -> None:
        """Keep the coefficients."""
        super().__init__(coordinates, minimum)
        self.constant = float(constant)
        self.slopes, self.curvatures = (
            np.asarray(values, dtype=float) for values in (slopes, curvatures)
        )
        shapes, width = (self.slopes.shape, self.curvatures.shape), (len(self.coordinates),)
        if shapes != (width, width):
            raise ModelError(
                f"quadratic: got slopes and curvatures of shapes {shapes}, allowed {width} each"
            )
        if not (self.curvatures >= 0).all():
            raise ModelError(
                f"quadratic: got a curvature of {self.curvatures.min():g}, allowed 0 or more"
            )

    @classmethod
    def fit(cls, data: DataSet) -> Self:
        """Fit by least squares with curvatures bounded below by zero.

        Args:
            data: labelled points, at least three per input.

        Raises:
            ModelError: if there are too few points, or all labels are the same.
        """
        from scipy.optimize import lsq_linear

        check_kind("data", data, DataSet, "a DataSet, see ergoqp.datasets.data", ModelError)
        width = data.points.shape[1]
        data.require(3 * width, "quadratic")
        # Standardised inputs give columns of similar size.
        centre, still = data.points.mean(axis=0), np.ptp(data.points, axis=0) == 0
        spread = np.where(still, 1.0, data.points.std(axis=0))
        z = np.where(still, 0.0, (data.points - centre) / spread)
        columns = np.hstack([np.ones((len(z), 1)), z, z * z])
        lower = np.concatenate([np.full(1 + width, -np.inf), np.zeros(width)])
        # The small triangular factor has the same solution as all the rows.
        q, r = np.linalg.qr(columns)
        found = lsq_linear(r, q.T @ data.labels, bounds=(lower, np.inf), method="bvls").x
        b, c = found[1 : 1 + width] / spread, np.maximum(found[1 + width :], 0.0) / spread**2
        constant = found[0] - b @ centre + c @ centre**2
        return cls(constant, b - 2 * c * centre, c, data.coordinates, float(data.labels.min()))

    def predict(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the value (n,) of inputs (n, d)."""
        return self.constant + points @ self.slopes + points**2 @ self.curvatures

    def value(self, x: ca.MX) -> ca.MX:
        """Return the value, a scalar expression of the inputs (d,)."""
        return self.constant + ca.dot(ca.DM(self.slopes) + ca.DM(self.curvatures) * x, x)

    def slope(self, x: ca.MX) -> ca.MX:
        """Return dV/dx (d,)."""
        return ca.DM(self.slopes) + ca.DM(2 * self.curvatures) * x

    def parts(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Return settings and arrays (d,)."""
        return {"constant": self.constant}, {"slopes": self.slopes, "curvatures": self.curvatures}
