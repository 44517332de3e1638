"""Gaussian mixtures: expectation maximisation, and regression of any columns on any others.

Regression by Gaussian mixtures: any columns from any others, with covariance and derivative.
Equations 2.1 to 2.8 of the EPFL report. In the report, the formula for the covariance of one
component's prediction has Sigma^IO where Sigma^O is correct: conditioned on the input, the output
of component k has the covariance Sigma_k^O - Sigma_k^OI (Sigma_k^I)^-1 Sigma_k^IO. This module
computes the correct one.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Final, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import softmax

from ergoqp.arguments import are_shares
from ergoqp.errors import ModelError
from ergoqp.learning.pipelines import sklearn

if TYPE_CHECKING:
    from sklearn.mixture import GaussianMixture

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MixtureRegression:
    """A mixture of K Gaussians over D columns; any columns can be inputs or outputs.

    Attributes:
        weights: prior of each Gaussian (K,), positive; the sum is 1.
        means: (K, D).
        covariances: (K, D, D), symmetric. A column that is never an input may have no
            variance.
    """

    weights: Array
    means: Array
    covariances: Array

    def __post_init__(self) -> None:
        """Check shapes and numbers.

        Raises:
            ModelError: if something does not fit; the message names it.
        """
        weights, means, covariances = (
            np.asarray(a, dtype=float) for a in (self.weights, self.means, self.covariances)
        )
        if not (weights > 0).all() or not are_shares(weights, weights.size):
            raise ModelError(
                f"weights: got {weights.shape} adding up to {weights.sum():g}, allowed positive"
                " ones adding up to 1"
            )
        count, width = len(weights), means.shape[-1] if means.ndim else 0
        if means.shape != (count, width) or covariances.shape != (count, width, width):
            got = f"means {means.shape} and covariances {covariances.shape}"
            raise ModelError(
                f"mixture: got {got}, allowed ({count}, D) and ({count}, D, D) for {count} weights"
            )
        if not (np.isfinite(means).all() and np.isfinite(covariances).all()):
            raise ModelError(
                "mixture: got a mean or covariance that is not finite, allowed numbers only"
            )
        for name, values in (("weights", weights), ("means", means), ("covariances", covariances)):
            object.__setattr__(self, name, values)

    def split(self, inputs: Sequence[int], outputs: Sequence[int]) -> Conditional:
        """Return the regression of some columns on others.

        Args:
            inputs: numbers of the input columns.
            outputs: numbers of the predicted columns; all columns in neither are marginalised.

        Raises:
            ModelError: if a column is named twice or does not exist, or a Gaussian has no
                density over the inputs.
        """
        inputs, outputs = [int(i) for i in inputs], [int(i) for i in outputs]
        width = self.means.shape[1]
        both = inputs + outputs
        once = len(set(both)) == len(both) and set(both) <= set(range(width))
        if not inputs or not outputs or not once:
            raise ModelError(
                f"split: got inputs {inputs} and outputs {outputs}, allowed columns 0 to"
                f" {width - 1}, each once"
            )
        blocks = self.covariances[:, inputs][:, :, inputs]
        try:
            factors = np.linalg.cholesky(blocks)
        except np.linalg.LinAlgError:
            raise ModelError(
                f"split: a Gaussian has no variance in some direction of the inputs {inputs}"
            ) from None
        whitening = np.linalg.inv(factors)
        cross = self.covariances[:, outputs][:, :, inputs]  # Sigma_k^OI
        slopes = cross @ np.swapaxes(whitening, 1, 2) @ whitening
        log_volumes = np.log(np.diagonal(factors, axis1=1, axis2=2)).sum(axis=1)
        log_volumes = log_volumes + 0.5 * len(inputs) * np.log(2 * np.pi)
        return Conditional(
            log_scales=np.log(self.weights) - log_volumes,
            whitening=np.asarray(np.tril(whitening), dtype=float),
            inputs=self.means[:, inputs],
            outputs=self.means[:, outputs],
            slopes=slopes,
            covariances=self.covariances[:, outputs][:, :, outputs]
            - slopes @ np.swapaxes(cross, 1, 2),
        )


class Prediction(NamedTuple):
    """A prediction as CasADi expressions.

    Attributes:
        mean: (o,), eq. 2.5.
        covariance: (o, o), eq. 2.6.
        derivative: derivative of the mean (o, d), eq. 2.8.
    """

    mean: ca.MX
    covariance: ca.MX
    derivative: ca.MX


@dataclass(frozen=True, eq=False)
class Conditional:
    """One split of a mixture: d inputs, o outputs, K Gaussians. Made by `MixtureRegression.split`.

    Far from where two Gaussians are equally likely, one of them has all the responsibility,
    and the derivative does not depend on the other. With a temperature T > 1 the
    responsibilities are proportional to (prior times density)^(1/T), which reach further.
    Several temperatures are averaged. One temperature of 1 is the plain regression.

    Attributes:
        log_scales: log of the prior over the volume of each Gaussian of the inputs (K,).
        whitening: inverse Cholesky factors of the inputs' covariances (K, d, d), lower triangular.
        inputs: mean inputs (K, d).
        outputs: mean outputs (K, o).
        slopes: local linear fits Sigma_k^OI (Sigma_k^I)^-1 (K, o, d).
        covariances: covariances of the outputs of each Gaussian, given the inputs (K, o, o).
        temperatures: temperatures of the responsibilities, above 0.
        shares: shares of the temperatures; the sum is 1.
    """

    log_scales: Array
    whitening: Array
    inputs: Array
    outputs: Array
    slopes: Array
    covariances: Array
    temperatures: tuple[float, ...] = (1.0,)
    shares: tuple[float, ...] = (1.0,)

    def tempered(self, temperatures: Sequence[float], shares: Sequence[float]) -> Conditional:
        """Return this regression with other temperatures of the responsibilities.

        Raises:
            ModelError: if a temperature is not positive, or the shares do not add up to 1.
        """
        temperatures, shares = tuple(map(float, temperatures)), tuple(map(float, shares))
        if not temperatures or not all(0 < t < np.inf for t in temperatures):
            raise ModelError(f"temperatures: got {temperatures}, allowed positive numbers")
        if not are_shares(shares, len(temperatures)):
            raise ModelError(
                f"shares: got {shares}, allowed one per temperature ({len(temperatures)}), adding"
                " up to 1"
            )
        return replace(self, temperatures=temperatures, shares=shares)

    def log_densities(self, points: ArrayLike) -> Array:
        """Return the log of prior times density (n, K) of each Gaussian at inputs (n, d)."""
        rows = self._rows(points)
        # One Gaussian at a time. All at once would need K times the memory of the points.
        distances = [
            np.square((rows - mean) @ w.T).sum(axis=1)
            for w, mean in zip(self.whitening, self.inputs, strict=True)
        ]
        return self.log_scales - 0.5 * np.stack(distances, axis=1)

    def log_density(self, points: ArrayLike) -> Array:
        """Return the log density (n,) of inputs (n, d), eq. 2.1."""
        return np.logaddexp.reduce(self.log_densities(points), axis=1)

    def responsibilities(self, points: ArrayLike) -> Array:
        """Return h_k (n, K), each Gaussian's share at inputs (n, d), averaged over temperatures."""
        logs = self.log_densities(points)
        return np.sum(
            [
                share * softmax(logs / t, axis=1)
                for t, share in zip(self.temperatures, self.shares, strict=True)
            ],
            axis=0,
        )

    def means(self, points: ArrayLike) -> Array:
        """Return the prediction of each Gaussian (n, K, o) at inputs (n, d)."""
        rows = self._rows(points)
        return self._offsets + np.tensordot(rows, self.slopes, ([1], [2]))

    def mean(self, points: ArrayLike) -> Array:
        """Return the predictions (n, o) at inputs (n, d), eq. 2.5."""
        return np.einsum("nk,nko->no", self.responsibilities(points), self.means(points))

    def covariance(self, points: ArrayLike) -> Array:
        """Return the covariances of the predictions (n, o, o) at inputs (n, d), eq. 2.6."""
        shares, means = self.responsibilities(points), self.means(points)
        # Moments about the mean instead of about zero give the same sum without cancellation.
        spread = means - np.einsum("nk,nko->no", shares, means)[:, np.newaxis]
        return np.einsum("nk,kop->nop", shares, self.covariances) + np.einsum(
            "nk,nko,nkp->nop", shares, spread, spread
        )

    def derivative(self, points: ArrayLike) -> Array:
        """Return the derivatives of the predictions (n, o, d) at inputs (n, d), eq. 2.8.

        They are the sum of both `terms`.
        """
        local, switching = self.terms(points)
        return local + switching

    def terms(self, points: ArrayLike) -> tuple[Array, Array]:
        """Return the two terms of eq. 2.8, each (n, o, d), at inputs (n, d).

        The first is sum_k h_k Sigma_k^OI (Sigma_k^I)^-1, the local linear fits. The second is
        sum_k mu_k dh_k/dx, the change of the responsibilities.
        """
        rows = self._rows(points)
        logs, means = self.log_densities(rows), self.means(rows)
        local = np.einsum("nk,kod->nod", self.responsibilities(rows), self.slopes)
        # sum_k dh_k = 0, so the mean can be subtracted from every mu_k. The common part of all
        # dh_k then cancels.
        weights = np.zeros_like(means)
        for temperature, share in zip(self.temperatures, self.shares, strict=True):
            h = softmax(logs / temperature, axis=1)[:, :, np.newaxis]
            weights += share / temperature * h * (means - (h * means).sum(axis=1, keepdims=True))
        switching = np.zeros_like(local)
        for k, (w, center) in enumerate(zip(self.whitening, self.inputs, strict=True)):
            pull = -(rows - center) @ w.T @ w  # A_k of eq. 2.8
            switching += weights[:, k, :, np.newaxis] * pull[:, np.newaxis]
        return local, switching

    def expression(self, x: ca.MX) -> Prediction:
        """Return mean, covariance and derivative as expressions of the inputs (d,).

        Outputs that are not used are not evaluated.
        """
        count, width, size = len(self.log_scales), self.inputs.shape[1], self.outputs.shape[1]
        # Sparse where possible: Gaussians with a diagonal covariance take d operations, not
        # d^2.
        stacked = ca.sparsify(ca.DM(self.whitening.reshape(count * width, width)))
        shift = np.einsum("kij,kj->ki", self.whitening, self.inputs)
        white = ca.reshape(ca.densify(stacked @ x) - shift.ravel(), width, count)
        logs = self.log_scales - 0.5 * ca.sum1(white**2).T
        slopes = ca.sparsify(ca.DM(self.slopes.transpose(1, 0, 2).reshape(size * count, width)))
        # The columns are outputs. reshape fills column by column, so the Gaussians come first.
        means = ca.reshape(ca.densify(slopes @ x) + self._offsets.T.ravel(), count, size)
        total, weights = ca.MX(ca.DM.zeros(count)), ca.MX(ca.DM.zeros(count, size))
        for temperature, share in zip(self.temperatures, self.shares, strict=True):
            # Not ca.logsumexp, which scalar expressions (SX) lack.
            h = ca.exp((logs - ca.mmax(logs)) / temperature)
            h /= ca.sum1(h)
            total += share * h
            weights += (
                share
                / temperature
                * ca.repmat(h, 1, size)
                * (means - ca.repmat(h.T @ means, count, 1))
            )
        mean = (total.T @ means).T
        spread = means - ca.repmat(mean.T, count, 1)
        inner = ca.reshape(ca.DM(self.covariances.reshape(count, -1)).T @ total, size, size)
        covariance = inner + spread.T @ (ca.repmat(total, 1, size) * spread)
        rows = []
        for output in range(size):
            pull = ca.vec(white * ca.repmat(weights[:, output].T, width, 1))
            rows.append(total.T @ ca.DM(self.slopes[:, output]) - (stacked.T @ pull).T)
        return Prediction(mean, covariance, ca.densify(ca.vertcat(*rows)))

    @cached_property
    def _offsets(self) -> Array:
        """Prediction of each Gaussian at zero (K, o)."""
        return self.outputs - np.einsum("kod,kd->ko", self.slopes, self.inputs)

    def _rows(self, points: ArrayLike) -> Array:
        rows = np.atleast_2d(np.asarray(points, dtype=float))
        if rows.ndim != 2 or rows.shape[1] != self.inputs.shape[1]:
            raise ModelError(
                f"points: got shape {np.shape(points)}, allowed (n, {self.inputs.shape[1]})"
            )
        return rows


ROUNDS: Final = 300
"""Largest number of iterations of EM."""


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
    what = "fitting a Gaussian mixture"
    estimator = sklearn("mixture", what).GaussianMixture(
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
        warnings.simplefilter("ignore", sklearn("exceptions", what).ConvergenceWarning)
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
