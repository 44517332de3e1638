"""The margin of a one-class SVM with radial kernels, whose slope never vanishes.

Far from the data f(x) = sum_i a_i k(u, s_i) - rho, k(u, s) = exp(-gamma |u - s|^2), is flat, so the
margin is

    g(x) = log sum_i a_i k(u, s_i) - log rho:

the same zero set, and it falls like -gamma times the squared distance. As a log-sum-exp of concave
quadratics that share one curvature it has a bound from below for every displacement D of the scaled
point,

    g(u + D) >= g(u) + grad g . D - gamma |D|^2,

on which `ergoqp.limits.OneClassBoundary` builds a row that holds exactly.
"""

from __future__ import annotations

from functools import cached_property
from typing import Final

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ergoqp.learning.kernels import KernelSum

_CHUNK: Final = 4_000_000
"""Entries of a kernel matrix that are held at once."""

_STARTS: Final = 16
"""From so many support vectors the largest margin is looked for,"""

_CLIMB: Final = 30
"""in so many steps."""

Array = NDArray[np.float64]


class Margin:
    """g of a sum of kernels."""

    def __init__(self, kernels: KernelSum, log_rho: float) -> None:
        """Take the sum, all of whose weights are positive, and the logarithm of rho."""
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
        """Return the largest margin found uphill from the most inner support vectors.

        All support vectors can be outside and points inside. Moving each point to the mean of the
        centres, weighted by their shares in the sum, never goes down (mean shift).
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
        """Return the exponents (n, centres) of points, without -gamma |u|^2.

        The points are as seen from the origin, scaled (n, d).
        """
        return self._offsets + 2 * self._gamma * rows @ self._sum.points.T

    @cached_property
    def _offsets(self) -> Array:
        """Exponents at the origin (n,): log a_i - gamma |s_i|^2.

        What all share, -gamma |u|^2, is left out of the sum.
        """
        return np.log(self._sum.weights) - self._gamma * (self._sum.points**2).sum(axis=1)

    @cached_property
    def function(self) -> ca.Function:
        """``x (d,) -> g, grad g (d,)``, a CasADi Function of dense matrices.

        With p_i the share of kernel i in the sum, the slope by the scaled point is 2 gamma (sum_i
        p_i s_i - u). The largest exponent is taken out first, so that far away nothing underflows.
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
