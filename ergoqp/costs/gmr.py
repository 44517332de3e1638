"""Gaussian mixture regression of the score on the posture.

There are two variants: equations 2.4 to 2.8 of the EPFL report, or one mixture per score.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final, Literal, Self, get_args

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ergoqp.arguments import (
    LARGEST_SEED,
    Progress,
    check_kind,
    check_number,
    check_whole,
    check_word,
    numbers_of,
    unseen,
)
from ergoqp.costs.cost import Arrays, LearnedCost, Settings
from ergoqp.datasets.data import DataSet
from ergoqp.errors import ModelError
from ergoqp.learning.mixtures import MixtureRegression, Prediction, estimate, mixture_of
from ergoqp.learning.pipelines import check_radians, named, order_of

if TYPE_CHECKING:
    from sklearn.mixture import GaussianMixture

Array = NDArray[np.float64]
Variant = Literal["per_score", "joint"]
Covariance = Literal["full", "diag"]

COMPONENTS: Final[dict[str, int]] = {"per_score": 60, "joint": 24}
"""Default number of Gaussians in total. 24 is the number that the EPFL report found by BIC."""

MOST_SCORES: Final = 40
"""Largest number of different labels for one mixture per score."""


class Gmr(LearnedCost):
    """V(q) = E[score | q] under a Gaussian mixture.

    There are two variants. ``joint`` is that of the EPFL report: one mixture with full
    covariances over posture and score, conditioned on the posture. It predicts well, but its
    gradient does not lead to good postures (`notebooks/03_gmr_postures` shows why).
    ``per_score`` fits a mixture to the postures of each score and weighs the scores by Bayes'
    rule, V = sum_i s_i p(score i | q). This is the same regression with Gaussians that have no
    variance of the score. The covariances are diagonal. The responsibilities are averaged over
    two temperatures, so that the gradient reaches beyond the next Gaussian. The s_i are the
    scores after a linear map that makes the predictions unbiased on the data.

    Attributes:
        mixture: the Gaussians over (inputs, score).
        regression: the score given the inputs.
        variant: ``"per_score"`` or ``"joint"``.
        coordinates: names of the inputs.
        minimum: V_min, the lowest score of the data [points].
        temperatures: divisors of the logarithms of the responsibilities, dimensionless.
        shares: share of each temperature; the sum is 1.

    Source:
        EPFL semester report, "Learning ergonomic human-robot interaction", equations 2.4 to
        2.8.

    Example:
        >>> import numpy as np
        >>> from ergoqp.costs.gmr import Gmr
        >>> from ergoqp.datasets.data import DataSet
        >>> rng = np.random.default_rng(0)
        >>> x = np.concatenate([rng.normal(0, 0.1, (60, 1)), rng.normal(1, 0.1, (60, 1))])
        >>> data = DataSet(x, np.repeat([1.0, 3.0], 60), ("trunk_flexion",))
        >>> cost = Gmr.fit(data, components=2, temperatures=(1,), shares=(1,))
        >>> cost.predict(np.array([[0.0], [1.0]])).round(1).tolist()
        [1.0, 3.0]
    """

    name = "gmr"

    def __init__(
        self,
        mixture: MixtureRegression,
        coordinates: Sequence[str],
        minimum: float,
        *,
        variant: Variant = "joint",
        temperatures: Sequence[float] = (1.0,),
        shares: Sequence[float] = (1.0,),
    ) -> None:
        """Take a mixture whose last column is the score.

        Raises:
            ModelError: if the number of columns is not the number of inputs plus one, or the
                mixture cannot be split.
        """
        super().__init__(coordinates, minimum)
        width = len(self.coordinates)
        if mixture.means.shape[1] != width + 1:
            raise ModelError(
                f"gmr: got a mixture of {mixture.means.shape[1]} columns, allowed {width + 1}:"
                " inputs and score"
            )
        self.mixture, self.variant = mixture, variant
        self.regression = mixture.split(range(width), [width]).tempered(temperatures, shares)

    @classmethod
    def fit(
        cls,
        data: DataSet,
        components: int | None = None,
        seed: int = 0,
        *,
        variant: Variant = "per_score",
        covariance: Covariance | None = None,
        regularisation: float = 1e-3,
        temperatures: Sequence[float] | None = None,
        shares: Sequence[float] | None = None,
    ) -> Self:
        """Fit by EM from a k-means++ start.

        Args:
            data: points and their scores.
            components: number of Gaussians in total; None: 60 for ``per_score``, where they
                are divided in proportion to the number of postures of each score, and 24 for
                ``joint``.
            seed: seed of the start.
            variant: ``"per_score"`` or ``"joint"`` (that of the EPFL report).
            covariance: ``"full"`` or ``"diag"``; None: diagonal for ``per_score``, full for
                ``joint``.
            regularisation: added to every variance, also to that of the score in ``joint`` [rad^2
                or m^2, points^2].
            temperatures: temperatures of the responsibilities, dimensionless; None: (1, 8) for
                ``per_score`` and (1,) for ``joint``.
            shares: share of each temperature; None: (0.7, 0.3) for ``per_score`` and (1,) for
                ``joint``.

        Raises:
            ModelError: if there are too few points, all labels are equal, or an option is not
                allowed.
            MissingExtraError: if scikit-learn is not installed.
        """
        check_kind("data", data, DataSet, "a DataSet, see ergoqp.datasets.data", ModelError)
        check_word("variant", variant, get_args(Variant), ModelError)
        per_score = variant == "per_score"
        covariance = ("diag" if per_score else "full") if covariance is None else covariance
        check_word("covariance", covariance, get_args(Covariance), ModelError)
        count = COMPONENTS[variant] if components is None else components
        check_whole("components", count, 1, error=ModelError)
        check_whole("seed", seed, 0, LARGEST_SEED, ModelError)
        check_number("regularisation", regularisation, 1e-12, 1e6, error=ModelError)
        # With fewer than d + 2 points a full covariance is only its regularisation. A diagonal
        # one needs a few points.
        least = count * (data.points.shape[1] + 2 if covariance == "full" else 4)
        data.require(least, f"gmr with {count} Gaussians")
        usual = ((1.0, 8.0), (0.7, 0.3)) if per_score else ((1.0,), (1.0,))
        temperatures = usual[0] if temperatures is None else temperatures
        shares = usual[1] if shares is None else shares
        options = {
            "variant": variant,
            "temperatures": numbers_of("temperatures", temperatures, 1e-3, 1e6, ModelError),
            "shares": numbers_of("shares", shares, 0.0, 1.0, ModelError),
        }
        lowest = float(data.labels.min())
        if not per_score:
            columns = np.column_stack([data.points, data.labels])
            found = estimate(columns, count, seed, covariance, regularisation, "kmeans")
            return cls(mixture_of(found), data.coordinates, lowest, **options)
        mixture = _per_score(data, count, seed, covariance, regularisation)
        plain = cls(mixture, data.coordinates, lowest, **options)
        slope, offset = np.polyfit(plain.predict(data.points), data.labels, 1)
        means = mixture.means.copy()
        means[:, -1] = offset + slope * means[:, -1]
        # V is a weighted mean of these, so the lowest is a true lower bound.
        lowest = min(lowest, float(means[:, -1].min()))
        mixture = MixtureRegression(mixture.weights, means, mixture.covariances)
        return cls(mixture, data.coordinates, lowest, **options)

    @classmethod
    def from_estimator(
        cls, estimator: GaussianMixture, coordinates: Sequence[str], minimum: float | None = None
    ) -> Self:
        """Return the regression of a fitted scikit-learn mixture over (inputs, score).

        The mixture may have any type of covariance.

        Args:
            estimator: a fitted mixture; its last column is the score.
            coordinates: names of the inputs, in any order if it was fitted with a table that names
                its columns.
            minimum: V_min [points]; None: the lowest mean score of the Gaussians.

        Raises:
            ModelError: if it is not fitted, or has a wrong number of columns.
        """
        mixture = mixture_of(estimator)
        fitted = named(estimator, coordinates, extra=1)
        check_radians(fitted, estimator)
        order = [*order_of(coordinates, fitted), len(fitted)]
        if order != sorted(order):
            mixture = replace(
                mixture,
                means=mixture.means[:, order],
                covariances=mixture.covariances[:, order][:, :, order],
            )
        lowest = float(mixture.means[:, -1].min()) if minimum is None else minimum
        return cls(mixture, coordinates, lowest)

    def predict(self, points: Array) -> Array:
        """Return V (n,) of inputs (n, d), eq. 2.5."""
        return self.regression.mean(points)[:, 0]

    def variance(self, points: Array) -> Array:
        """Return the variance of the score (n,) at inputs (n, d), eq. 2.6 [points^2]."""
        return self.regression.covariance(points)[:, 0, 0]

    def prediction(self, x: ca.MX) -> Prediction:
        """Return mean, covariance and derivative of the score as expressions of the inputs (d,)."""
        return self.regression.expression(x)

    def value(self, x: ca.MX) -> ca.MX:
        """Return V, a scalar expression of the inputs (d,), eq. 2.5."""
        return self.prediction(x).mean

    def slope(self, x: ca.MX) -> ca.MX:
        """Return dV/dx (d,), an expression, eq. 2.8."""
        return self.prediction(x).derivative.T

    def parts(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Return (settings, arrays)."""
        regression, mixture = self.regression, self.mixture
        tempered = {"temperatures": regression.temperatures, "shares": regression.shares}
        arrays = {name: getattr(mixture, name) for name in ("weights", "means", "covariances")}
        return {"variant": self.variant, **tempered}, arrays

    @classmethod
    def from_parts(
        cls, settings: Settings, arrays: Arrays, coordinates: Sequence[str], minimum: float
    ) -> Self:
        """Return the cost with these `parts`. The arrays must have the same shapes."""
        return cls(MixtureRegression(**arrays), coordinates, minimum, **settings)


def bic_curve(
    data: DataSet,
    counts: Sequence[int] = range(1, 51),
    seed: int = 0,
    *,
    covariance: Covariance = "full",
    regularisation: float = 1e-3,
    progress: Progress = unseen,
) -> NDArray[np.float64]:
    """Return the Bayesian information criterion of joint mixtures over (inputs, score).

    A lower value is better.

    Args:
        data: points and their scores.
        counts: numbers of Gaussians.
        seed: seed of the starts.
        covariance: ``"full"`` or ``"diag"``.
        regularisation: added to every variance.
        progress: called with the share that is done.

    Returns:
        One value per count.

    Raises:
        ModelError: if there are too few points.
        MissingExtraError: if scikit-learn is not installed.
    """
    most = max(counts)
    data.require(most * (data.points.shape[1] + 2), f"a BIC curve up to {most} Gaussians")
    columns = np.column_stack([data.points, data.labels])
    values, work = [], np.cumsum(counts)
    for count, done in zip(counts, work, strict=True):
        found = estimate(columns, count, seed, covariance, regularisation, "kmeans")
        values.append(found.bic(columns))
        progress(float(done / work[-1]))
    return np.array(values)


def _per_score(
    data: DataSet, count: int, seed: int, covariance: str, regularisation: float
) -> MixtureRegression:
    """Return the union of one mixture per score. The Gaussians have no variance of the score."""
    scores, sizes = np.unique(data.labels, return_counts=True)
    if len(scores) > MOST_SCORES:
        raise ModelError(
            f"gmr: got {len(scores)} different labels, allowed at most {MOST_SCORES} for a mixture"
            " per score; variant 'joint' takes any"
        )
    weights, means, covariances = [], [], []
    for score, size in zip(scores, sizes, strict=True):
        own = max(1, round(count * size / len(data)))
        # k-means++ seeds without Lloyd iterations: the Gaussians of one score overlap, and
        # clusters would separate them.
        points = data.points[data.labels == score]
        part = mixture_of(estimate(points, own, seed, covariance, regularisation, "k-means++"))
        weights.append(part.weights * size / len(data))
        means.append(np.column_stack([part.means, np.full(own, score)]))
        covariances.append(np.pad(part.covariances, ((0, 0), (0, 1), (0, 1))))
    return MixtureRegression(*(np.concatenate(arrays) for arrays in (weights, means, covariances)))
