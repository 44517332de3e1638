"""Relevance of each column for a label: length scales by the evidence of a Gaussian process.

For labels y of standardised points and the kernel s^2 exp(-sum_j r_j (x_j - x'_j)^2) + noise,
the relevances r_j maximise the marginal likelihood (Rasmussen and Williams, Gaussian Processes
for Machine Learning, 2006, eq. 5.8 and 5.9). Columns that do not matter get values near zero.
A kernel machine should be fitted to columns times sqrt(r_j), so that the distances are
meaningful.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ergoqp.errors import MissingExtraError
from ergoqp.progress import Progress, unseen

Array = NDArray[np.float64]

_LEAST_NOISE: Final = 1e-4
"""Smallest noise variance relative to the labels'. It keeps the kernel matrix positive definite."""

_MOST_SIGNAL: Final = 4.0
"""Largest s^2, relative to the variance of the labels.

Without it, a nearly linear effect would become a kernel with almost no relevance and a huge
factor. A machine with bounded weights cannot represent that.
"""

_RANGE: Final = (-16.0, 6.0)
"""Range of the logarithms of the relevances."""


@dataclass(frozen=True, eq=False)
class Relevance:
    """How much each column matters.

    Attributes:
        factors: r (d,) per squared unit of the column.
        slopes: prior standard deviation of the slope of the label along each column, sqrt(2 r)
            s (d,).
        cost: negative log likelihood per point; the lower, the better the columns explain the
            labels.
    """

    factors: Array
    slopes: Array
    cost: float


def relevance(
    points: Array,
    labels: Array,
    seed: int = 0,
    count: int = 1000,
    rounds: int = 40,
    progress: Progress = unseen,
) -> Relevance:
    """Find the relevance of each column on a random part of the data.

    Args:
        points: (n, d), each column with a variance near 1.
        labels: (n,).
        seed: seed of the random part.
        count: number of points of the part; time grows with its cube.
        rounds: iterations of the search (L-BFGS).
        progress: called with the share that is done; the search may end early.

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
    begun = itertools.count(1)
    best = minimize(
        _cost,
        start,
        args=(x, y),
        jac=True,
        method="L-BFGS-B",
        bounds=bounds,
        options={"maxiter": rounds},
        callback=lambda at: progress(next(begun) / rounds),
    )
    found = np.exp(best.x[: d + 1])
    return Relevance(found[:d], np.sqrt(2 * found[:d] * found[d]), float(best.fun))


def _cost(logs: Array, x: Array, y: Array) -> tuple[float, Array]:
    """Return the negative log likelihood per point, without its constant.

    Also return its gradient with respect to the logarithms.
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
    # This name is created at run time, so pyright does not know it.
    inverse = lapack.dpotri(factor, lower=1)[0]  # pyright: ignore[reportAttributeAccessIssue]
    inverse = np.tril(inverse) + np.tril(inverse, -1).T
    weights = inverse @ y
    value = 0.5 * y @ weights + np.log(np.diag(factor)).sum()
    # d value / d K = -W / 2. Every derivative of K is K times a function of the points, so no
    # further n x n matrix is needed.
    pull = (np.outer(weights, weights) - inverse) * kernel
    by_relevance = (pull.sum(axis=1)[:, np.newaxis] * x**2).sum(axis=0) - (x * (pull @ x)).sum(
        axis=0
    )
    by_noise = weights @ weights - np.trace(inverse)
    gradient = np.r_[relevances * by_relevance, -0.5 * pull.sum(), -0.5 * noise * by_noise]
    return value / n, gradient / n
