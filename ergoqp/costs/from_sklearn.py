"""A fitted scikit-learn regressor as a cost: its parts are read, its prediction is an expression.

These can be read: scalers, followed by SVR, KernelRidge, GaussianProcessRegressor (constant
times RBF, Matern or rational quadratic, with or without white noise), MLPRegressor,
GaussianMixture (as regression: its last column is the score) or OneClassSVM (the cost is minus
its decision function: lower is further inside). They may also be inside a
TransformedTargetRegressor that scales the score. The estimator itself is not kept, and nothing
is ever unpickled.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Final, Self

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ergoqp.costs.cost import Arrays, LearnedCost, Settings
from ergoqp.costs.gmr import Gmr
from ergoqp.costs.svr import KernelCost, Reduction
from ergoqp.errors import ModelError
from ergoqp.learning.kernels import Kernel, KernelSum
from ergoqp.learning.pipelines import affine, check_radians, dense, named, order_of, unpack

Array = NDArray[np.float64]

ACTIVATIONS: Final[dict[str, Callable[[Any, Any], Any]]] = {
    "identity": lambda z, lib: z,
    "logistic": lambda z, lib: (1 + lib.tanh(z / 2)) / 2,
    "tanh": lambda z, lib: lib.tanh(z),
    "relu": lambda z, lib: lib.fmax(z, 0),
}
"""Activations of the hidden layers of MLPRegressor, in numpy or CasADi."""

_ALLOWED: Final = (
    "SVR, KernelRidge, GaussianProcessRegressor, MLPRegressor, GaussianMixture, OneClassSVM"
)


class SklearnCost(KernelCost):
    """V(q) as predicted by an estimator of scikit-learn, made by `from_sklearn`.

    Attributes:
        model: a sum of kernels, or a network.
        coordinates: names of the inputs.
        minimum: V_min, the lowest cost that a posture should have [points].
        reduction: how a reduced set of kernels differs from the full one; None for a full set.

    Example:
        >>> import numpy as np
        >>> from sklearn.svm import SVR
        >>> from ergoqp.costs.from_sklearn import from_sklearn
        >>> x = np.linspace(-1, 1, 21)[:, None]
        >>> cost = from_sklearn(SVR().fit(x, 1 + x[:, 0] ** 2), ["trunk_flexion"])
        >>> cost.name, cost(np.zeros((4, 32))).shape
        ('sklearn', (4,))
    """

    name = "sklearn"

    def value(self, x: ca.MX) -> ca.MX:
        """Return V, a scalar expression of the inputs (d,)."""
        return self.model.expression(x)

    def values(self, x: ca.MX) -> ca.MX:
        """Return V (1, k) of k columns of inputs (d, k), an expression."""
        return self.model.expression(x) if isinstance(self.model, KernelSum) else super().values(x)

    def slope(self, x: ca.MX) -> ca.MX:
        """Return dV/dx (d,), an expression."""
        if isinstance(self.model, KernelSum):
            return self.model.value_and_slope(x)[1]
        return super().slope(x)

    def parts(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Return (settings, arrays)."""
        settings, arrays = self.model.parts()
        form = "kernels" if isinstance(self.model, KernelSum) else "layers"
        reduction = self.reduction and asdict(self.reduction)
        return {"form": form, "reduction": reduction, **settings}, arrays

    @classmethod
    def from_parts(
        cls, settings: Settings, arrays: Arrays, coordinates: Sequence[str], minimum: float
    ) -> Self:
        """Return the cost with these `parts`. The arrays must have the same shapes."""
        form = KernelSum if settings["form"] == "kernels" else Layers
        model = form.from_parts(settings, arrays)
        reduction = settings["reduction"] and Reduction(**settings["reduction"])
        return cls(model, coordinates, minimum, reduction)


@dataclass(eq=False)
class Layers:
    """A network of dense layers with one activation and a linear last layer.

    Attributes:
        weights: weights of each layer (rows, columns), inputs first.
        biases: biases of each layer (columns,).
        activation: a key of `ACTIVATIONS`.
        mean: subtracted from the inputs (d,).
        scale: divides the result (d,).
    """

    weights: Sequence[Array]
    biases: Sequence[Array]
    activation: str
    mean: Array
    scale: Array

    def __post_init__(self) -> None:
        """Read the layers."""
        self.weights = [np.asarray(w, float) for w in self.weights]
        self.biases = [np.asarray(b, float) for b in self.biases]

    def values(self, points: Array) -> Array:
        """Return the output (n,) of inputs (n, d)."""
        h, act = (points - self.mean) / self.scale, ACTIVATIONS[self.activation]
        for weights, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            h = act(h @ weights + bias, np)
        return (h @ self.weights[-1] + self.biases[-1])[:, 0]

    def expression(self, x: ca.MX) -> ca.MX:
        """Return the output, a scalar expression of the inputs (d,)."""
        h, act = (x - ca.DM(self.mean)) / ca.DM(self.scale), ACTIVATIONS[self.activation]
        for weights, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            h = act(ca.MX(ca.DM(weights.T)) @ h + ca.DM(bias), ca)
        return ca.MX(ca.DM(self.weights[-1].T)) @ h + ca.DM(self.biases[-1])

    def scaled(self, factor: float, offset: float) -> Layers:
        """Return the network whose output is `factor` times this one's, plus `offset`."""
        weights = [*self.weights[:-1], factor * self.weights[-1]]
        biases = [*self.biases[:-1], factor * self.biases[-1] + offset]
        return replace(self, weights=weights, biases=biases)

    def parts(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Return (settings, arrays)."""
        arrays = {"mean": self.mean, "scale": self.scale}
        for number, (weights, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            arrays |= {f"W{number}": weights, f"b{number}": bias}
        return {"activation": self.activation, "layers": len(self.weights)}, arrays

    @classmethod
    def from_parts(cls, settings: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Layers:
        """Return the network with these `parts`."""
        weights, biases = (
            [arrays[f"{letter}{i}"] for i in range(settings["layers"])] for letter in "Wb"
        )
        return cls(weights, biases, settings["activation"], arrays["mean"], arrays["scale"])


def from_sklearn(estimator: Any, coordinates: Sequence[str], minimum: float = 1.0) -> LearnedCost:
    """Return a cost with the prediction of a fitted estimator, or of scalers and one in a pipeline.

    Args:
        estimator: the fitted estimator; the top of this file lists what can be read.
        coordinates: names of the inputs of the cost. If the estimator was fitted with a table that
            names its columns, they may be in any order; else they are in the order of the fit.
        minimum: V_min, the lowest cost that a posture should have [points].

    Raises:
        ModelError: if the estimator, a kernel or a step cannot be read, it is not fitted, or
            the number of inputs differs; if it was fitted to other columns than the coordinates,
            or to degrees.
        MissingExtraError: if scikit-learn is not installed.

    Example:
        >>> import numpy as np
        >>> from sklearn.svm import SVR
        >>> from ergoqp.costs.from_sklearn import from_sklearn
        >>> x = np.linspace(-1, 1, 21)[:, None]
        >>> estimator = SVR().fit(x, 1 + x[:, 0] ** 2)
        >>> cost = from_sklearn(estimator, ["trunk_flexion"])
        >>> bool(np.allclose(cost.predict(x), estimator.predict(x)))
        True
    """
    if type(estimator).__name__ == "GaussianMixture":
        return Gmr.from_estimator(estimator, coordinates, minimum)
    parts = unpack(estimator, len(tuple(coordinates)))
    fitted = named(estimator, coordinates)
    model = _model(fitted, *parts)
    return SklearnCost(_ordered(model, order_of(coordinates, fitted)), coordinates, minimum)


def _ordered(model: KernelSum | Layers, order: list[int]) -> KernelSum | Layers:
    """Return a model whose inputs are those of another one, in another order."""
    scaling = {"mean": model.mean[order], "scale": model.scale[order]}
    if isinstance(model, KernelSum):
        return replace(model, centres=model.centres[:, order], **scaling)
    return replace(model, weights=[model.weights[0][order], *model.weights[1:]], **scaling)


def _model(names: Sequence[str], mean: Array, scale: Array, last: Any) -> KernelSum | Layers:
    """Return the prediction of an estimator from (x - mean) / scale."""
    kind = type(last).__name__
    if kind == "GaussianMixture":
        raise ModelError(
            "estimator: got a GaussianMixture after other steps, allowed one by itself: it holds"
            " the score too"
        )
    if kind == "TransformedTargetRegressor":
        offset, factor = _target(last.transformer_)
        more, finer, inner = unpack(last.regressor_, len(mean))
        return _model(names, mean + scale * more, scale * finer, inner).scaled(factor, offset)
    if kind not in _READERS:
        raise ModelError(f"estimator: got a {kind}, allowed {_ALLOWED}")
    check_radians(names, last, mean, scale)
    return _READERS[kind](last, mean, scale)


def _target(scaler: Any) -> tuple[float, float]:
    """Return (offset, factor) that map the scaled score back."""
    if (
        type(scaler).__name__ == "FunctionTransformer"
        and scaler.func is None
        and scaler.inverse_func is None
    ):
        return 0.0, 1.0
    mean, scale = affine(scaler, 1)
    return float(mean[0]), float(scale[0])


def _svr(svr: Any, mean: Array, scale: Array) -> KernelSum:
    weights = dense(svr.dual_coef_).ravel()
    # The gamma that "scale" stands for has no public name.
    kernel = _kernel(svr.kernel, svr._gamma, svr.coef0, svr.degree)
    return _sum(kernel, dense(svr.support_vectors_), weights, float(svr.intercept_[0]), mean, scale)


def _sum(
    kernel: Kernel, centres: Array, weights: Array, bias: float, mean: Array, scale: Array
) -> KernelSum:
    if kernel.kind == "linear":
        # With a linear kernel the weighted sum of all centres is enough.
        centres, weights = weights[np.newaxis] @ centres, np.ones(1)
    return KernelSum(kernel, centres, weights, bias, mean, scale)


def _ridge(ridge: Any, mean: Array, scale: Array) -> KernelSum:
    gamma = 1.0 / len(mean) if ridge.gamma is None else ridge.gamma
    kernel = _kernel(ridge.kernel, gamma, ridge.coef0, ridge.degree)
    weights = _single(ridge.dual_coef_)
    return _sum(kernel, dense(ridge.X_fit_), weights, 0.0, mean, scale)


def _process(process: Any, mean: Array, scale: Array) -> KernelSum:
    factor, kernel, lengths = _covariance(process.kernel_)
    spread = float(np.ravel(process._y_train_std)[0])
    offset = float(np.ravel(process._y_train_mean)[0])
    weights, centres = factor * spread * _single(process.alpha_), dense(process.X_train_) / lengths
    return KernelSum(kernel, centres, weights, offset, mean, scale * lengths)


def _network(mlp: Any, mean: Array, scale: Array) -> Layers:
    if mlp.activation not in ACTIVATIONS:
        raise ModelError(
            f"MLPRegressor: got the activation {mlp.activation!r}, allowed {', '.join(ACTIVATIONS)}"
        )
    if mlp.out_activation_ != "identity":
        raise ModelError(f"MLPRegressor: got the loss {mlp.loss!r}, allowed 'squared_error'")
    if mlp.n_outputs_ != 1:
        raise ModelError(f"MLPRegressor: got {mlp.n_outputs_} outputs, allowed 1")
    return Layers(mlp.coefs_, mlp.intercepts_, mlp.activation, mean, scale)


_READERS: Final[dict[str, Callable[[Any, Array, Array], KernelSum | Layers]]] = {
    "SVR": _svr,
    "KernelRidge": _ridge,
    "GaussianProcessRegressor": _process,
    "MLPRegressor": _network,
    "OneClassSVM": lambda svm, mean, scale: _svr(svm, mean, scale).scaled(-1.0, 0.0),
}


def _kernel(name: Any, gamma: float, offset: float, degree: float) -> Kernel:
    """Return the kernel with this scikit-learn name."""
    kind = {"polynomial": "poly"}.get(name, name)
    if kind not in ("rbf", "linear", "poly", "sigmoid"):
        raise ModelError(f"estimator: got the kernel {name!r}, allowed rbf, linear, poly, sigmoid")
    return Kernel(kind, float(gamma), float(offset), float(degree))


def _covariance(kernel: Any) -> tuple[float, Kernel, Array]:
    """Return (constant factor, kernel, length scales (d,) or (1,)) of a Gaussian process kernel."""
    kind = type(kernel).__name__
    if kind == "Sum":
        # White noise has no covariance between different points, so it does not affect a
        # prediction.
        rest = [part for part in (kernel.k1, kernel.k2) if type(part).__name__ != "WhiteKernel"]
        if len(rest) == 1:
            return _covariance(rest[0])
    elif kind == "Product":
        for constant, other in ((kernel.k1, kernel.k2), (kernel.k2, kernel.k1)):
            if type(constant).__name__ == "ConstantKernel":
                factor, found, lengths = _covariance(other)
                return factor * float(constant.constant_value), found, lengths
    elif kind == "RBF":
        return 1.0, Kernel("rbf", 0.5), np.atleast_1d(np.asarray(kernel.length_scale, dtype=float))
    elif kind == "Matern" and kernel.nu in (1.5, 2.5):
        name = "matern32" if kernel.nu == 1.5 else "matern52"
        return 1.0, Kernel(name, 1.0), np.atleast_1d(np.asarray(kernel.length_scale, dtype=float))
    elif kind == "RationalQuadratic":
        rational = Kernel("rational", 0.5, alpha=float(kernel.alpha))
        return 1.0, rational, np.atleast_1d(float(kernel.length_scale))
    raise ModelError(
        f"GaussianProcessRegressor: got the kernel {kernel}, allowed a constant times RBF, Matern"
        " (nu 1.5 or 2.5) or RationalQuadratic, with or without WhiteKernel"
    )


def _single(coefficients: Any) -> Array:
    weights = np.asarray(coefficients, dtype=float)
    if weights.ndim > 1 and weights.shape[1] != 1:
        raise ModelError(f"estimator: got {weights.shape[1]} outputs, allowed 1")
    return weights.ravel()
