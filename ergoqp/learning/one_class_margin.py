"""The margin of a one-class SVM with radial kernels, with a slope that does not vanish far away.

Far from the data, f(x) = sum_i a_i k(u, s_i) - rho with k(u, s) = exp(-gamma |u - s|^2) is
flat. So the margin is written as a logarithm:

    g(x) = log sum_i a_i k(u, s_i) - log rho.

It has the same zero set, and it falls like -gamma times the squared distance. It is a
log-sum-exp of concave quadratics that share one curvature. So it has a lower bound for every
displacement D of the scaled point,

    g(u + D) >= g(u) + grad g . D - gamma |D|^2,

from which `ergoqp.limits.OneClassBoundary` builds a row that holds exactly.
"""

from __future__ import annotations

from functools import cached_property
from typing import Final

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ergoqp.learning.kernels import KernelSum

_CHUNK: Final = 4_000_000
"""Number of entries of a kernel matrix that are held at once."""

_STARTS: Final = 16
"""Number of support vectors from which the largest margin is searched."""

_CLIMB: Final = 30
"""Number of steps of this search."""

Array = NDArray[np.float64]


class Margin:
    """The margin g of a sum of kernels."""

    def __init__(self, kernels: KernelSum, log_rho: float) -> None:
        """Take a sum with positive weights only, and the logarithm of rho."""
        self._sum, self._log_rho = kernels, log_rho
        self._gamma = kernels.kernel.gamma

    def __call__(self, points: ArrayLike) -> Array:
        """Return g (n,) of inputs (n, d)."""
        rows = (np.atleast_2d(np.asarray(points, dtype=float)) - self._sum.origin) / self._sum.scale
        size = max(1, _CHUNK // len(self._sum.weights))
        values = [self._log_sum(rows[i : i + size]) for i in range(0, len(rows), size)]
        return (
            np.concatenate([*values, np.empty(0)])
            - self._gamma * (rows**2).sum(axis=1)
            - self._log_rho
        )

    def _log_sum(self, rows: Array) -> Array:
        exponents = self._exponents(rows)
        largest = exponents.max(axis=1)
        return largest + np.log(np.exp(exponents - largest[:, np.newaxis]).sum(axis=1))

    def summit(self) -> float:
        """Return the largest margin that is found uphill from the innermost support vectors.

        All support vectors can be outside although other points are inside. Each step moves a
        point to the mean of the centres, weighted by their shares in the sum. This never
        lowers the margin (mean shift).
        """
        rows = self._sum.points[
            np.argsort(-self(self._sum.centres * self._sum.scale + self._sum.mean))[:_STARTS]
        ]
        for _ in range(_CLIMB):
            exponents = self._exponents(rows)
            shares = np.exp(exponents - exponents.max(axis=1)[:, np.newaxis])
            rows = shares @ self._sum.points / shares.sum(axis=1)[:, np.newaxis]
        return float(self(rows * self._sum.scale + self._sum.origin).max())

    def _exponents(self, rows: Array) -> Array:
        """Return the exponents (n, centres) at points, without -gamma |u|^2.

        The points are scaled and relative to the origin (n, d).
        """
        return self._offsets + 2 * self._gamma * rows @ self._sum.points.T

    @cached_property
    def _offsets(self) -> Array:
        """Exponents at the origin (n,): log a_i - gamma |s_i|^2.

        The common term -gamma |u|^2 is left out of the sum.
        """
        return np.log(self._sum.weights) - self._gamma * (self._sum.points**2).sum(axis=1)

    @cached_property
    def function(self) -> ca.Function:
        """``x (d,) -> g, grad g (d,)``, a CasADi Function of dense matrices.

        With p_i the share of kernel i in the sum, the slope by the scaled point is 2 gamma
        (sum_i p_i s_i - u). The largest exponent is subtracted first, so that nothing
        underflows far away.
        """
        scale = self._sum.scale
        x = ca.MX.sym("x", len(scale))
        u = (x - ca.DM(self._sum.origin)) / ca.DM(scale)
        matrix = ca.MX(ca.DM(2 * self._gamma * self._sum.points))
        exponents = matrix @ u + ca.DM(self._offsets)
        largest = ca.mmax(exponents)
        shares = ca.exp(exponents - largest)
        total = ca.sum1(shares)
        value = largest + ca.log(total) - self._gamma * ca.sumsqr(u) - self._log_rho
        slope = ((shares.T @ matrix).T / total - 2 * self._gamma * u) / ca.DM(scale)
        return ca.Function("one_class", [x], [value, slope], ["x"], ["margin", "slope"])
