"""The region of the data: a one-class SVM with radial kernels, and its margin.

The margin of a one-class SVM with radial kernels, with a slope that does not vanish far away.

Far from the data, f(x) = sum_i a_i k(u, s_i) - rho with k(u, s) = exp(-gamma |u - s|^2) is
flat. So the margin is written as a logarithm:

    g(x) = log sum_i a_i k(u, s_i) - log rho.

It has the same zero set, and it falls like -gamma times the squared distance. It is a
log-sum-exp of concave quadratics that share one curvature. So it has a lower bound for every
displacement D of the scaled point,

    g(u + D) >= g(u) + grad g . D - gamma |D|^2,

from which `ergoqp.limits.OneClassBoundary` builds a row that holds exactly. The region of the data:
a one-class SVM with radial kernels.

The decision function is f(x) = sum_i a_i k(u, s_i) - rho with a_i > 0. The scaled point is
u = (x - mean) / scale, and k(u, s) = exp(-gamma |u - s|^2). A point is inside where f >= 0.
The margin is in `ergoqp.learning.one_class`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ergoqp.arguments import check_number, check_real, flag, names_of, table_of_numbers
from ergoqp.coordinates import Coordinates
from ergoqp.errors import ModelError
from ergoqp.learning.kernels import Kernel, KernelSum
from ergoqp.learning.model_file import load_model, save_model
from ergoqp.learning.pipelines import check_radians, dense, named, order_of, sklearn, unpack

_STARTS: Final = 16
"""Number of support vectors from which the largest margin is searched."""

_CLIMB: Final = 30
"""Number of steps of this search."""

Array = NDArray[np.float64]


KIND: Final = "one_class"
"""The kind in the header of its files."""

_TOLERANCE: Final = 1e-6
"""Accuracy of the fit.

With a thousandth, the default of scikit-learn, twice the share of points would be outside.
"""


class OneClass:
    """A one-class SVM with radial kernels.

    Attributes:
        coordinates: names of the inputs.
        gamma: gamma of the kernel, per squared scaled unit.
        mean: subtracted from the inputs (d,) [rad or m].
        scale: divides the result (d,) [rad or m].
        centres: support vectors, scaled (n, d), dimensionless.
        weights: a_i, positive (n,), dimensionless.
        rho: value of the sum of kernels on the boundary, positive (dimensionless). It is kept
            as `log_rho`.
        log_rho: logarithm of rho.

    Example:
        >>> import numpy as np
        >>> from ergoqp.learning.one_class import OneClass
        >>> points = np.random.default_rng(0).normal(0.3, 0.1, (60, 2))
        >>> seen = OneClass.fit(points, ["trunk_flexion", "neck_flexion"], nu=0.1)
        >>> (seen.margin([[0.25, 0.35], [2.0, 2.0]]) > 0).tolist()
        [True, False]
    """

    def __init__(
        self,
        coordinates: Coordinates | Sequence[str],
        gamma: float,
        mean: ArrayLike,
        scale: ArrayLike,
        centres: ArrayLike,
        weights: ArrayLike,
        rho: float,
    ) -> None:
        """Check and keep the parts.

        Raises:
            ModelError: if they do not fit together, rho is not positive, or no support vector is
                left.
        """
        self.coordinates = _coordinates(coordinates)
        weights, centres = (
            table_of_numbers(f"one-class SVM {what}", of, ModelError)
            for what, of in (("weights", weights), ("centres", centres))
        )
        check_number("one-class SVM gamma", gamma, 1e-300, 1e300, error=ModelError)
        check_real("one-class SVM rho", rho, "the kernels' sum", ModelError)
        if not rho > 0:
            raise ModelError(
                f"one-class SVM: got rho {rho!r}, allowed a positive number: without it nothing is"
                " outside"
            )
        if weights.shape != (len(centres),):
            raise ModelError(
                f"one-class SVM: got weights of shape {weights.shape}, allowed ({len(centres)},),"
                " one per centre"
            )
        if (weights < 0).any():
            raise ModelError("one-class SVM: got negative weights, allowed weights of at least 0")
        kept = weights > 0
        self._sum = KernelSum(
            Kernel("rbf", float(gamma)),
            centres[kept],
            weights[kept],
            -float(rho),
            np.ravel(mean),
            np.ravel(scale),
        )
        self.gamma = self._sum.kernel.gamma
        self.mean, self.scale = self._sum.mean, self._sum.scale
        self.centres, self.weights = self._sum.centres, self._sum.weights
        if len(self.scale) != len(self.coordinates):
            raise ModelError(
                f"one-class SVM: got {len(self.scale)} inputs, allowed {len(self.coordinates)}, one"
                " per coordinate"
            )
        self.log_rho = float(np.log(rho))

    @classmethod
    def fit(
        cls,
        points: ArrayLike,
        coordinates: Coordinates | Sequence[str],
        nu: float = 0.02,
        gamma: float | None = None,
        scale: bool = True,
    ) -> OneClass:
        """Fit the boundary of a set of points.

        Args:
            points: (n, d), in the order of `coordinates` [rad or m].
            coordinates: names of the columns.
            nu: upper bound of the share of points outside; above 0, below 1.
            gamma: gamma of the kernel, per squared scaled unit; None: 1 / d.
            scale: first scale every column to mean 0 and variance 1.

        Raises:
            ModelError: if the points cannot be used, or no point is inside the fitted
                boundary.
            MissingExtraError: if scikit-learn is not installed.
        """
        names = _coordinates(coordinates)
        rows = _points(points, len(names))
        gamma = 1 / len(names) if gamma is None else gamma
        check_number("one-class SVM nu", nu, 1e-6, 0.999, error=ModelError)
        check_number("one-class SVM gamma", gamma, 1e-9, 1e9, error=ModelError)
        scale = flag("one-class SVM scale", scale, ModelError)
        steps = [sklearn("preprocessing", "a one-class SVM").StandardScaler()] if scale else []
        svm = sklearn("svm", "a one-class SVM").OneClassSVM(nu=nu, gamma=gamma, tol=_TOLERANCE)
        estimator = sklearn("pipeline", "a one-class SVM").make_pipeline(*steps, svm)
        try:
            estimator.fit(rows)
        except ValueError as error:
            raise ModelError(
                f"one-class SVM: cannot be fitted to {len(rows)} points with nu {nu:g}: {error}"
            ) from None
        model = cls.from_estimator(estimator, names)
        if model.decision(rows).max() <= 10 * _TOLERANCE:
            raise ModelError(
                f"one-class SVM: nothing is inside with nu {nu:g} and gamma {gamma:g}; use a"
                " smaller gamma"
            )
        return model

    @classmethod
    def from_estimator(cls, estimator: Any, coordinates: Coordinates | Sequence[str]) -> OneClass:
        """Return the boundary of a fitted `sklearn.svm.OneClassSVM`.

        A pipeline of scalers and one such machine is accepted too.

        Args:
            estimator: fitted, with radial kernels.
            coordinates: names of its inputs, in any order if it was fitted with a table that names
                its columns.

        Raises:
            ModelError: if the estimator or its kernel is another one, it is not fitted, nothing is
                inside, or it was fitted to other columns than the coordinates or to degrees.
            MissingExtraError: if scikit-learn is not installed.
        """
        names = coordinates if isinstance(coordinates, Coordinates) else Coordinates(coordinates)
        mean, scale, svm = unpack(estimator, len(names))
        if type(svm).__name__ != "OneClassSVM":
            raise ModelError(f"estimator: got a {type(svm).__name__}, allowed a OneClassSVM")
        if svm.kernel != "rbf":
            raise ModelError(f"OneClassSVM: got the kernel {svm.kernel!r}, allowed 'rbf'")
        fitted = named(estimator, names.names)
        check_radians(fitted, svm, mean, scale)
        order = order_of(names.names, fitted)
        gamma = svm._gamma  # the value of "scale" and "auto", which has no public name
        centres, weights = dense(svm.support_vectors_)[:, order], dense(svm.dual_coef_).ravel()
        rho = float(-svm.intercept_[0])
        model = cls(names, gamma, mean[order], scale[order], centres, weights, rho)
        if np.exp(model.log_rho) * np.expm1(model._summit()) < -svm.tol:
            raise ModelError(
                f"OneClassSVM: nothing is inside with nu {svm.nu:g} and gamma {gamma:g}; use"
                " another nu or gamma"
            )
        return model

    def decision(self, points: ArrayLike) -> Array:
        """Return f (n,) of inputs (n, d), as `decision_function` of scikit-learn does."""
        return self._sum.values(points)

    def margin(self, points: ArrayLike) -> Array:
        """Return g (n,) of inputs (n, d): 0 on the boundary, positive inside, finite everywhere."""
        rows = self._sum.scaled_rows(points)
        values = self._sum.in_chunks(rows, self._log_sum)
        return values - self.gamma * (rows**2).sum(axis=1) - self.log_rho

    def _log_sum(self, rows: Array) -> Array:
        exponents = self._exponents(rows)
        largest = exponents.max(axis=1)
        return largest + np.log(np.exp(exponents - largest[:, np.newaxis]).sum(axis=1))

    def _summit(self) -> float:
        """Return the largest margin that is found uphill from the innermost support vectors.

        All support vectors can be outside although other points are inside. Each step moves a
        point to the mean of the centres, weighted by their shares in the sum. This never
        lowers the margin (mean shift).
        """
        rows = self._sum.points[
            np.argsort(-self.margin(self.centres * self.scale + self.mean))[:_STARTS]
        ]
        for _ in range(_CLIMB):
            exponents = self._exponents(rows)
            shares = np.exp(exponents - exponents.max(axis=1)[:, np.newaxis])
            rows = shares @ self._sum.points / shares.sum(axis=1)[:, np.newaxis]
        return float(self.margin(rows * self.scale + self._sum.origin).max())

    def _exponents(self, rows: Array) -> Array:
        """Return the exponents (n, centres) at points, without -gamma |u|^2.

        The points are scaled and relative to the origin (n, d).
        """
        return self._offsets + 2 * self.gamma * rows @ self._sum.points.T

    @cached_property
    def _offsets(self) -> Array:
        """Exponents at the origin (n,): log a_i - gamma |s_i|^2.

        The common term -gamma |u|^2 is left out of the sum.
        """
        return np.log(self.weights) - self.gamma * (self._sum.points**2).sum(axis=1)

    @property
    def margin_and_slope(self) -> ca.Function:
        """``x (d,) -> g, grad g (d,)``, a CasADi Function of dense matrices."""
        return self._margin_and_slope

    @cached_property
    def _margin_and_slope(self) -> ca.Function:
        """Return the function of `margin_and_slope`.

        With p_i the share of kernel i in the sum, the slope by the scaled point is 2 gamma
        (sum_i p_i s_i - u). The largest exponent is subtracted first, so that nothing
        underflows far away.
        """
        scale = self.scale
        x = ca.MX.sym("x", len(scale))
        u = (x - ca.DM(self._sum.origin)) / ca.DM(scale)
        matrix = ca.MX(ca.DM(2 * self.gamma * self._sum.points))
        exponents = matrix @ u + ca.DM(self._offsets)
        largest = ca.mmax(exponents)
        shares = ca.exp(exponents - largest)
        total = ca.sum1(shares)
        value = largest + ca.log(total) - self.gamma * ca.sumsqr(u) - self.log_rho
        slope = ((shares.T @ matrix).T / total - 2 * self.gamma * u) / ca.DM(scale)
        return ca.Function("one_class", [x], [value, slope], ["x"], ["margin", "slope"])

    def save(self, path: Path | str) -> None:
        """Write the model to a file (npz with a JSON header and a checksum).

        Raises:
            ModelError: if the file cannot be written.
        """
        header = {
            "kind": KIND,
            "coordinates": list(self.coordinates.names),
            "gamma": self.gamma,
            "rho": -self._sum.bias,
        }
        arrays = {name: getattr(self, name) for name in ("mean", "scale", "centres", "weights")}
        save_model(path, header, arrays)


def load_one_class(path: Path | str) -> OneClass:
    """Return the model that :meth:`OneClass.save` wrote.

    Raises:
        ModelError: if the file does not exist, is truncated or changed, or holds something
            else.
    """
    header, arrays = load_model(path)
    if header.get("kind") != KIND:
        raise ModelError(
            f"{Path(path).name}: holds a model of kind {header.get('kind')!r}, allowed {KIND!r}"
        )
    try:
        return OneClass(header["coordinates"], header["gamma"], rho=header["rho"], **arrays)
    except (KeyError, TypeError, ValueError) as error:
        raise ModelError(
            f"{Path(path).name}: does not hold what a one-class SVM needs ({error})"
        ) from None


def _coordinates(names: Coordinates | Sequence[str]) -> Coordinates:
    return (
        names
        if isinstance(names, Coordinates)
        else Coordinates(names_of("coordinates", names, "a list of names", ModelError))
    )


def _points(points: ArrayLike, width: int) -> Array:
    rows = table_of_numbers("points", points, ModelError)
    if rows.ndim != 2 or rows.shape[1] != width or len(rows) < 2:
        raise ModelError(
            f"one-class SVM: got points of shape {rows.shape}, allowed (n, {width}) with n at"
            " least 2"
        )
    if not np.isfinite(rows).all():
        bad = np.flatnonzero(~np.isfinite(rows).all(axis=1))
        raise ModelError(
            f"one-class SVM: row {bad[0]} is not finite ({bad.size} such rows), allowed numbers"
            " only"
        )
    return rows
