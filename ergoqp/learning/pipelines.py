"""Reading fitted scikit-learn pipelines, and relevance of each column for a label.

Relevance of each column for a label: length scales by the evidence of a Gaussian process. For
labels y of standardised points and the kernel s^2 exp(-sum_j r_j (x_j - x'_j)^2) + noise, the
relevances r_j maximise the marginal likelihood (Rasmussen and Williams, Gaussian Processes for
Machine Learning, 2006, eq. 5.8 and 5.9). Columns that do not matter get values near zero. A kernel
machine should be fitted to columns times sqrt(r_j), so that the distances are meaningful.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from importlib import import_module
from types import ModuleType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ergoqp.arguments import Progress, unseen
from ergoqp.errors import MissingExtraError, ModelError
from ergoqp.joints import JOINTS

SCALERS: Final = ("StandardScaler", "MinMaxScaler", "MaxAbsScaler", "RobustScaler")
"""Steps that may come before the estimator. All have the form (x - mean) / scale."""

Array = NDArray[np.float64]


def sklearn(module: str, what: str) -> ModuleType:
    """Return a module of scikit-learn, which is an extra.

    Args:
        module: its name below ``sklearn``.
        what: what needs it, for the message.

    Raises:
        MissingExtraError: if scikit-learn is not installed.
    """
    try:
        return import_module(f"sklearn.{module}")
    except ImportError:
        raise MissingExtraError(what, "learn", "sklearn") from None


def require_fitted(estimator: Any) -> None:
    """Check that an object is a fitted estimator of scikit-learn.

    Raises:
        ModelError: if it is not an estimator, or not fitted.
        MissingExtraError: if scikit-learn is not installed.
    """
    check = sklearn("utils.validation", "reading an estimator").check_is_fitted
    unfitted = sklearn("exceptions", "reading an estimator").NotFittedError
    try:
        check(estimator)
    except unfitted:
        raise ModelError(
            f"estimator: got a {type(estimator).__name__} that is not fitted, allowed a fitted one"
        ) from None
    except TypeError:
        raise ModelError(
            f"estimator: got a {type(estimator).__name__}, allowed an estimator of scikit-learn"
        ) from None


def unpack(estimator: Any, width: int) -> tuple[Array, Array, Any]:
    """Split a pipeline into the scaling and the last estimator.

    Args:
        estimator: a fitted pipeline, or a fitted estimator alone.
        width: number of inputs d.

    Returns:
        (mean (d,), scale (d,), last estimator). The input of the last one is (x - mean) /
        scale.

    Raises:
        ModelError: if it is not fitted, the number of inputs differs, or a step is not a
            scaler.
        MissingExtraError: if scikit-learn is not installed.
    """
    require_fitted(estimator)
    mean, scale = np.zeros(width), np.ones(width)
    got = getattr(estimator, "n_features_in_", width)
    if got != width:
        raise ModelError(f"estimator: got one of {got} inputs, allowed {width}, one per coordinate")
    while hasattr(estimator, "steps"):
        for _, step in estimator.steps[:-1]:
            if step is not None and step != "passthrough":
                shift, factor = affine(step, width)
                mean, scale = mean + scale * shift, scale * factor
        estimator = estimator.steps[-1][1]
    return mean, scale, estimator


def named(estimator: Any, coordinates: Sequence[str], extra: int = 0) -> tuple[str, ...]:
    """Return the names of the inputs in the order in which an estimator was fitted.

    An estimator that was fitted with a table keeps the names of its columns. They decide the order
    in which its numbers are read; `order_of` brings them into the stated one. Names in which no
    coordinate is found say nothing.

    Args:
        estimator: a fitted pipeline, or a fitted estimator alone.
        coordinates: names of the inputs, as stated.
        extra: number of columns after the inputs, such as the score of a mixture.

    Raises:
        ModelError: if the columns are other coordinates than those stated, or are in degrees.
    """
    stated, columns = tuple(coordinates), _columns(estimator)
    fitted = [_plain(name) for name in columns[: len(columns) - extra]]
    known = {*stated, *JOINTS}
    if in_degrees := [name for name in fitted if name[:-4] in known and name.endswith("_deg")]:
        raise ModelError(
            f"estimator: got one that was fitted with {in_degrees[0]}, allowed columns in radians"
        )
    if not known.intersection(fitted):
        return stated
    if sorted(fitted) != sorted(stated):
        other = sorted(set(fitted).symmetric_difference(stated))
        raise ModelError(
            f"estimator: got one that was fitted with the columns {', '.join(fitted)}, allowed the"
            f" stated coordinates: {', '.join(other)} differ"
        )
    return tuple(fitted)


def order_of(stated: Sequence[str], fitted: Sequence[str]) -> list[int]:
    """Return the index of each stated input among those of a fit, the names of `named`."""
    places = {name: i for i, name in enumerate(fitted)}
    return [places[name] for name in stated]


def _columns(estimator: Any) -> list[str]:
    """Return the names of the columns of a fit, or nothing."""
    parts = [estimator, *(step for _, step in getattr(estimator, "steps", ()))]
    parts += [getattr(part, "regressor_", None) for part in parts]
    parts += [step for part in parts for _, step in getattr(part, "steps", ())]
    found = (getattr(part, "feature_names_in_", None) for part in parts)
    return [str(name) for name in next((names for names in found if names is not None), ())]


def _plain(column: str) -> str:
    """Return the name of a column as coordinates are written: ``"Trunk flexion [rad]"``."""
    words = re.sub(r"\W+", "_", column.lower().replace("\N{DEGREE SIGN}", " deg")).strip("_")
    return words.removesuffix("_rad")


def check_radians(
    names: Sequence[str], last: Any, mean: Array | float = 0.0, scale: Array | float = 1.0
) -> None:
    """Check that an estimator of joint angles was not fitted to degrees.

    Args:
        names: names of its inputs.
        last: the last estimator, which keeps some or all of the points of its fit.
        mean: subtracted from the inputs before it.
        scale: divides the result.

    Raises:
        ModelError: if the points are typically beyond a full turn.
    """
    if names[0] not in JOINTS:
        return
    kept = (getattr(last, name, None) for name in ("support_vectors_", "X_fit_", "X_train_"))
    found = next((dense(points) for points in kept if points is not None), None)
    if found is None and hasattr(last, "means_"):
        found = np.asarray(last.means_, dtype=float)[:, : len(names)]
    if found is None or found.shape[-1] != len(names):
        # Only the scaling is known, which gives numbers of about 0.5.
        found = np.full((1, len(names)), 0.5 * np.any(mean))
    sizes = np.sqrt(np.mean((mean + scale * found) ** 2, axis=0))
    largest = int(np.argmax(sizes))
    if sizes[largest] > 2 * np.pi:
        raise ModelError(
            f"estimator: got one that was fitted to values of about {sizes[largest]:.3g} for"
            f" {names[largest]}, allowed radians (degrees?)"
        )


def affine(scaler: Any, width: int) -> tuple[Array, Array]:
    """Return (mean, scale) of a fitted scaler, which computes (x - mean) / scale.

    Raises:
        ModelError: if it is not one of `SCALERS`, or if it clips.
    """
    kind = type(scaler).__name__
    if kind not in SCALERS:
        raise ModelError(
            f"estimator: got the step {kind}, allowed before the last one: {', '.join(SCALERS)}"
        )
    if getattr(scaler, "clip", False):
        raise ModelError(f"estimator: got a {kind} that clips, allowed scalers without clip")
    scale = np.ones(width) if scaler.scale_ is None else np.array(scaler.scale_, dtype=float)
    if kind == "MinMaxScaler":
        return -scaler.min_ / scale, 1 / scale
    shift = getattr(scaler, "mean_" if kind == "StandardScaler" else "center_", None)
    # A StandardScaler has a mean even if it does not subtract it.
    used = shift is not None and getattr(scaler, "with_mean", True)
    return np.array(shift, dtype=float) if used else np.zeros(width), scale


def dense(values: Any) -> Array:
    """Return an array of an estimator as a dense one. It is sparse if the data of the fit were."""
    return np.asarray(values.toarray() if hasattr(values, "toarray") else values, dtype=float)


_LEAST_NOISE: Final = 1e-4
"""Smallest noise variance relative to the labels'. It keeps the kernel matrix positive definite."""

_MOST_SIGNAL: Final = 4.0
"""Largest s^2, relative to the variance of the labels.

Without it, a nearly linear effect would become a kernel with almost no relevance and a huge
factor. A machine with bounded weights cannot represent that.
"""

_RANGE: Final = (-16.0, 6.0)
"""Range of the logarithms of the relevances."""


def relevance(
    points: Array,
    labels: Array,
    seed: int = 0,
    count: int = 1000,
    rounds: int = 40,
    progress: Progress = unseen,
) -> tuple[Array, Array, float]:
    """Find the relevance of each column on a random part of the data.

    Args:
        points: (n, d), each column with a variance near 1.
        labels: (n,).
        seed: seed of the random part.
        count: number of points of the part; time grows with its cube.
        rounds: iterations of the search (L-BFGS).
        progress: called with the share that is done; the search may end early.

    Returns:
        r (d,) per squared unit of the column; the prior standard deviation of the slope of the
        label along each column, sqrt(2 r) s (d,); and the negative log likelihood per point: the
        lower, the better the columns explain the labels.
    """
    from scipy.optimize import minimize

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
    return found[:d], np.sqrt(2 * found[:d] * found[d]), float(best.fun)


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
