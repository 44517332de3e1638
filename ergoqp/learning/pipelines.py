"""Reading fitted scikit-learn pipelines: the last estimator, and the affine scaling before it."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ergoqp.errors import MissingExtraError, ModelError

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
