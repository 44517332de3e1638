"""How much each column matters to a label: length scales by the evidence of a Gaussian process.

For labels y of standardised points and the kernel s^2 exp(-sum_j r_j (x_j - x'_j)^2) + noise, the
relevances r_j maximise the marginal likelihood (Rasmussen and Williams, Gaussian Processes for
Machine Learning, 2006, eq. 5.8 and 5.9). Columns that do not matter end near zero. A kernel machine
fitted to columns times sqrt(r_j) sees distances that mean something.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ergoqp.errors import MissingExtraError

Array = NDArray[np.float64]

_LEAST_NOISE: Final = 1e-4
"""Smallest noise variance, relative to the labels': keeps the kernel matrix positive definite."""

_MOST_SIGNAL: Final = 4.0
"""Largest s^2, relative to the variance of the labels.

A nearly linear effect would otherwise be a kernel of almost no relevance and a huge factor, which a
machine with bounded weights cannot follow.
"""

_RANGE: Final = (-16.0, 6.0)
"""Of the logarithms of the relevances."""


@dataclass(frozen=True, eq=False)
class Relevance:
    """How much each column matters.

    Attributes:
        factors: r (d,) per squared unit of the column.
        slopes: standard deviation of the label's slope along each column, sqrt(2 r) s (d,), before
            any label is seen.
        cost: negative log likelihood per point: the lower, the better the columns explain the
            labels.
    """

    factors: Array
    slopes: Array
    cost: float


def relevance(
    points: Array, labels: Array, seed: int = 0, count: int = 1000, rounds: int = 40
) -> Relevance:
    """Find the relevance of each column on a random part of the data.

    Args:
        points: (n, d), each column with a variance near 1.
        labels: (n,).
        seed: of the part.
        count: points of the part; time grows with its cube.
        rounds: steps of the search (L-BFGS).

    Returns:
        How much each column matters.

    Raises:
        MissingExtraError: if scipy, which comes with scikit-learn, is not installed.
    """
    try:
        from scipy.optimize import minimize
    except ImportError:
        raise MissingExtraError("fitting a kernel cost", "learn", "scipy") from None

    rows = np.random.default_rng(seed).permutation(len(labels))[:count]
    x, y = points[rows], labels[rows] - labels[rows].mean()
    d, spread = x.shape[1], float(y.var())
    start = np.r_[np.full(d, np.log(0.5 / d)), np.log(spread), np.log(0.3 * spread)]
    noise = (np.log(_LEAST_NOISE * spread), np.log(2 * spread))
    bounds = [_RANGE] * d + [(noise[0], np.log(_MOST_SIGNAL * spread)), noise]
    best = minimize(
        _cost,
        start,
        args=(x, y),
        jac=True,
        method="L-BFGS-B",
        bounds=bounds,
        options={"maxiter": rounds},
    )
    found = np.exp(best.x[: d + 1])
    return Relevance(found[:d], np.sqrt(2 * found[:d] * found[d]), float(best.fun))


def _cost(logs: Array, x: Array, y: Array) -> tuple[float, Array]:
    """Return the negative log likelihood per point, without its constant.

    Also return its gradient by the logarithms.
    """
    from scipy.linalg import cholesky, lapack

    n, d = x.shape
    relevances, signal, noise = np.exp(logs[:d]), np.exp(logs[d]), np.exp(logs[d + 1])
    scaled = x * np.sqrt(relevances)
    lengths = (scaled**2).sum(axis=1)
    kernel = signal * np.exp(
        -np.maximum(lengths[:, np.newaxis] + lengths - 2 * scaled @ scaled.T, 0)
    )
    factor = cholesky(kernel + noise * np.eye(n), lower=True)
    # Made at run time.
    inverse = lapack.dpotri(factor, lower=1)[0]  # pyright: ignore[reportAttributeAccessIssue]
    inverse = np.tril(inverse) + np.tril(inverse, -1).T
    weights = inverse @ y
    value = 0.5 * y @ weights + np.log(np.diag(factor)).sum()
    # d value / d K = -W / 2; every derivative of K is K times something of the points, so no
    # further n x n matrix is needed.
    pull = (np.outer(weights, weights) - inverse) * kernel
    by_relevance = (pull.sum(axis=1)[:, np.newaxis] * x**2).sum(axis=0) - (x * (pull @ x)).sum(
        axis=0
    )
    by_noise = weights @ weights - np.trace(inverse)
    gradient = np.r_[relevances * by_relevance, -0.5 * pull.sum(), -0.5 * noise * by_noise]
    return value / n, gradient / n
