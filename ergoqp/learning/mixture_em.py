"""Gaussian mixtures by expectation maximisation with scikit-learn."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from ergoqp.errors import MissingExtraError, ModelError
from ergoqp.learning.mixture_regression import MixtureRegression

if TYPE_CHECKING:
    from sklearn.mixture import GaussianMixture

Array = NDArray[np.float64]

ROUNDS: Final = 300
"""Largest number of iterations of EM."""


def em(
    columns: Array, count: int, seed: int, covariance: str, regularisation: float, start: str
) -> MixtureRegression:
    """Return the mixture fitted to rows of numbers, see `estimate`."""
    return mixture_of(estimate(columns, count, seed, covariance, regularisation, start))


def estimate(
    columns: Array, count: int, seed: int, covariance: str, regularisation: float, start: str
) -> GaussianMixture:
    """Return scikit-learn's mixture, fitted by EM.

    Args:
        columns: rows of numbers (n, d).
        count: number of Gaussians.
        seed: seed of the start.
        covariance: ``"full"`` or ``"diag"``.
        regularisation: added to every variance.
        start: scikit-learn's name of the start.

    Raises:
        ModelError: if a Gaussian has no width.
        MissingExtraError: if scikit-learn is not installed.
    """
    try:
        from sklearn.exceptions import ConvergenceWarning
        from sklearn.mixture import GaussianMixture
    except ImportError:
        raise MissingExtraError("fitting a Gaussian mixture", "learn", "sklearn") from None
    estimator = GaussianMixture(
        count,
        covariance_type=covariance,
        reg_covar=regularisation,
        max_iter=ROUNDS,
        init_params=start,
        random_state=seed,
    )
    with warnings.catch_warnings():
        # More iterations would hardly change the predictions. A start with too few clusters is
        # not a fault.
        warnings.simplefilter("ignore", ConvergenceWarning)
        # A single point gives a Gaussian too. Its variance is the regularisation.
        try:
            return estimator.fit(columns if len(columns) > 1 else np.repeat(columns, 2, axis=0))
        except ValueError:
            raise ModelError(
                f"gmr: one of {count} Gaussians has no width; got regularisation"
                f" {regularisation:g}, allowed a larger one"
            ) from None


def mixture_of(estimator: GaussianMixture) -> MixtureRegression:
    """Return a fitted mixture of scikit-learn, with any type of covariance.

    Raises:
        ModelError: if it is not fitted.
    """
    if not hasattr(estimator, "means_"):
        raise ModelError("gmr: got a Gaussian mixture that is not fitted, allowed a fitted one")
    weights, means, given = (
        np.asarray(a, float) for a in (estimator.weights_, estimator.means_, estimator.covariances_)
    )
    count, width = means.shape
    if estimator.covariance_type == "full":
        covariances = given
    elif estimator.covariance_type == "tied":
        covariances = np.repeat(given[np.newaxis], count, axis=0)
    else:
        covariances = np.stack([np.eye(width) * variances for variances in given])
    return MixtureRegression(weights / weights.sum(), means, covariances)
