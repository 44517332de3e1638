"""Sums of kernels, f(x) = sum_j w_j k(u, s_j) + bias with u = (x - mean) / scale.

They are computed in numpy, and as dense CasADi matrices.

Support vector regression, kernel ridge regression and Gaussian processes all predict such a
sum. It may have thousands of centres s_j, and it is evaluated at every control step. So the
expression is a few operations on whole matrices: one product with the matrix of centres gives
all distances, and one more gives the slope.

The kernels, with t = |u - s|^2 for the radial ones and p = u . s for the others:

========  ============================================================
rbf       exp(-gamma t)
matern32  (1 + a) exp(-a), a = sqrt(3 gamma t)
matern52  (1 + a + a^2 / 3) exp(-a), a = sqrt(5 gamma t)
rational  (1 + gamma t / alpha)^-alpha
linear    p
poly      (gamma p + offset)^degree
sigmoid   tanh(gamma p + offset)
========  ============================================================
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
from typing import Any, Final

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ergoqp.arguments import are_shares
from ergoqp.errors import ModelError
from ergoqp.learning.pipelines import sklearn

RADIAL: Final = ("rbf", "matern32", "matern52", "rational")
"""Kernels that depend on the distance."""

PRODUCT: Final = ("linear", "poly", "sigmoid")
"""Kernels that depend on the inner product."""

_CHUNK: Final = 4_000_000
"""Number of entries of a kernel matrix that numpy holds at once."""

_TINY: Final = 1e-30
"""Keeps the square root of a distance differentiable at zero."""

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Kernel:
    """One kernel and its parameters. Parameters that it does not use have no effect.

    Attributes:
        kind: one of `RADIAL` or `PRODUCT`.
        gamma: factor of the squared distance or of the product.
        offset: offset of the product.
        degree: degree of the polynomial.
        alpha: parameter of the rational kernel.
    """

    kind: str
    gamma: float = 1.0
    offset: float = 0.0
    degree: float = 3.0
    alpha: float = 1.0

    def __post_init__(self) -> None:
        """Check the kind and the numbers.

        Raises:
            ModelError: if the kind is unknown, a number is not finite, or one that must be
                positive is not.
        """
        if self.kind not in RADIAL + PRODUCT:
            raise ModelError(f"kernel: got {self.kind!r}, allowed {', '.join(RADIAL + PRODUCT)}")
        if not np.isfinite([self.gamma, self.offset, self.degree, self.alpha]).all():
            raise ModelError(f"kernel: got {self}, allowed finite numbers")
        if self.radial and not (self.gamma > 0 and self.alpha > 0):
            raise ModelError(
                f"kernel: got gamma {self.gamma!r} and alpha {self.alpha!r}, allowed positive"
                " numbers"
            )

    @property
    def radial(self) -> bool:
        """Whether it is a function of the distance."""
        return self.kind in RADIAL

    def profile(self, t: Any, lib: Any) -> tuple[Any, Any]:
        """Return the kernel and its derivative at t, the squared distance or the product.

        Args:
            t: array or expression.
            lib: `numpy` or `casadi`, the library of the functions.
        """
        gamma = self.gamma
        match self.kind:
            case "rbf":
                value = lib.exp(-gamma * t)
                return value, -gamma * value
            case "matern32":
                a = lib.sqrt(3 * gamma * lib.fmax(t, 0) + _TINY)
                decay = lib.exp(-a)
                return (1 + a) * decay, -1.5 * gamma * decay
            case "matern52":
                a = lib.sqrt(5 * gamma * lib.fmax(t, 0) + _TINY)
                decay = lib.exp(-a)
                slow = (1 + a) * decay
                return slow + a * a / 3 * decay, -5 / 6 * gamma * slow
            case "rational":
                base = 1 + gamma / self.alpha * t
                value = base**-self.alpha
                return value, -gamma * value / base
            case "linear":
                return t, 1 + 0 * t
            case "poly":
                base = gamma * t + self.offset
                return base**self.degree, gamma * self.degree * base ** (self.degree - 1)
            case _:
                value = lib.tanh(gamma * t + self.offset)
                return value, gamma * (1 - value * value)


_SUM_ARRAYS: Final = ("centres", "weights", "mean", "scale")
"""The arrays of a `KernelSum`."""


@dataclass(frozen=True, eq=False)
class KernelSum:
    """f(x) = sum_j w_j k((x - mean) / scale, s_j) + bias.

    Attributes:
        kernel: the kernel k.
        centres: s_j, scaled like the input of the kernel (n, d).
        weights: w_j (n,).
        bias: constant that is added.
        mean: subtracted from x (d,).
        scale: divides the result (d,).
    """

    kernel: Kernel
    centres: Array
    weights: Array
    bias: float
    mean: Array
    scale: Array

    def __post_init__(self) -> None:
        """Check that the parts fit together.

        Raises:
            ModelError: if not, or if a number is not finite; the message names the shapes or
                the fault.
        """
        for name in _SUM_ARRAYS:
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), dtype=float))
        object.__setattr__(self, "bias", float(self.bias))
        n, d = self.centres.shape if self.centres.ndim == 2 else (0, 0)
        shapes = (self.weights.shape, self.mean.shape, self.scale.shape)
        if not n or not d or shapes != ((n,), (d,), (d,)):
            raise ModelError(
                "kernels: got centres, weights, mean, scale of shapes"
                f" {(self.centres.shape, *shapes)}, allowed (n, d), (n,), (d,), (d,), n at least 1"
            )
        numbers = (self.centres, self.weights, self.mean, self.scale, np.array([self.bias]))
        if not all(np.isfinite(part).all() for part in numbers) or not (self.scale > 0).all():
            raise ModelError(
                "kernels: got numbers that are not finite or a scale that is not positive, allowed"
                " finite ones"
            )

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields only; another process builds the expressions again."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    def __len__(self) -> int:
        """Return the number of centres."""
        return len(self.weights)

    @cached_property
    def origin(self) -> Array:
        """Vector that is subtracted from x before scaling (d,).

        Distances do not change when all centres are shifted to lie around zero. The rounding
        error is smallest there.
        """
        return (
            self.mean + self.scale * self.centres.mean(axis=0) if self.kernel.radial else self.mean
        )

    @cached_property
    def points(self) -> Array:
        """The centres relative to `origin` (n, d)."""
        return self.centres - self.centres.mean(axis=0) if self.kernel.radial else self.centres

    def values(self, points: ArrayLike) -> Array:
        """Return f (n,) of inputs (n, d)."""
        rows = self.scaled_rows(points)
        return self.in_chunks(rows, lambda part: self._features(part) @ self.weights) + self.bias

    def scaled_rows(self, points: ArrayLike) -> Array:
        """Return inputs (n, d) relative to `origin`, scaled."""
        return (np.atleast_2d(np.asarray(points, dtype=float)) - self.origin) / self.scale

    def in_chunks(self, rows: Array, evaluate: Callable[[Array], Array]) -> Array:
        """Return the values (n,) of rows (n, d), of so many at a time that they fit in memory."""
        size = max(1, _CHUNK // len(self))
        parts = [evaluate(rows[i : i + size]) for i in range(0, len(rows), size)]
        return np.concatenate([*parts, np.empty(0)])

    def _features(self, rows: Array) -> Array:
        """Return the kernel of scaled rows (n, d) with each centre (n, centres)."""
        t = rows @ self.points.T
        if self.kernel.radial:
            t = np.maximum(
                (rows**2).sum(axis=1)[:, np.newaxis] + (self.points**2).sum(axis=1) - 2 * t, 0
            )
        return self.kernel.profile(t, np)[0]

    def features(self, points: ArrayLike) -> Array:
        """Return the kernel of inputs (n, d) with each centre (n, centres).

        f is this times the weights, plus the bias.
        """
        return self._features(self.scaled_rows(points))

    @cached_property
    def _matrix(self) -> ca.MX:
        # Value and slope share one constant. CasADi copies it once per evaluation, which takes
        # a tenth of the time.
        return ca.MX(ca.DM(-2 * self.points if self.kernel.radial else self.points).T)

    @cached_property
    def _lengths(self) -> ca.MX:
        return ca.MX(ca.DM((self.points**2).sum(axis=1)))

    @cached_property
    def _weights(self) -> ca.MX:
        return ca.MX(ca.DM(self.weights))

    def _scaled(self, x: ca.MX) -> ca.MX:
        if x.shape[0] != len(self.scale):
            raise ModelError(
                f"kernels: got an expression of shape {x.shape}, allowed ({len(self.scale)}, k)"
            )
        origin, scale = (
            ca.repmat(ca.DM(part), 1, x.shape[1]) for part in (self.origin, self.scale)
        )
        return (x - origin) / scale

    def _arguments(self, u: ca.MX) -> list[ca.MX]:
        """Return t of `Kernel.profile` for all centres (n,), per column of scaled points (d, k)."""
        # Rows times a matrix whose columns are the centres: all that is read lies side by side.
        columns = [each.T for each in ca.vertsplit(u.T @ self._matrix)]
        if not self.kernel.radial:
            return columns
        return [
            t + (self._lengths + ca.sumsqr(one))
            for t, one in zip(columns, ca.horzsplit(u), strict=True)
        ]

    def expression(self, x: ca.MX) -> ca.MX:
        """Return f (1, k) at k points, the columns of (d, k).

        This is a tenth to a seventh faster than k expressions of one point.

        Raises:
            ModelError: if the expression has a wrong number of rows.
        """
        values = [
            ca.dot(self._weights, self.kernel.profile(t, ca)[0])
            for t in self._arguments(self._scaled(x))
        ]
        return ca.horzcat(*values) + self.bias

    def value_and_slope(self, x: ca.MX) -> tuple[ca.MX, ca.MX]:
        """Return f and its gradient (d,) at one point (d,).

        With t_j = |u - s_j|^2 and the kernel phi(t), the gradient by u is 2 u sum_j w_j
        phi'(t_j) - 2 S' (w phi'(t)). The matrix of centres is used twice and every exponential
        once.

        Raises:
            ModelError: if the expression has a wrong shape.
        """
        if x.shape[1] != 1:
            raise ModelError(
                f"kernels: got an expression of shape {x.shape}, allowed ({len(self.scale)}, 1)"
            )
        u = self._scaled(x)
        value, rate = self.kernel.profile(self._arguments(u)[0], ca)
        pull = self._weights * rate
        slope = self._matrix @ pull
        if self.kernel.radial:
            slope += 2 * u * ca.sum1(pull)
        return ca.dot(self._weights, value) + self.bias, slope / ca.DM(self.scale)

    def scaled(self, factor: float, offset: float) -> KernelSum:
        """Return `factor` times this sum, plus `offset`."""
        return replace(self, weights=factor * self.weights, bias=factor * self.bias + offset)

    def parts(self) -> tuple[dict[str, Any], dict[str, Array]]:
        """Return (settings for JSON, arrays): everything that `from_parts` needs."""
        arrays = {name: getattr(self, name) for name in _SUM_ARRAYS}
        return {"kernel": asdict(self.kernel), "bias": self.bias}, arrays

    @classmethod
    def from_parts(cls, settings: Mapping[str, Any], arrays: Mapping[str, Array]) -> KernelSum:
        """Return the sum with these `parts`."""
        centres, weights, mean, scale = (arrays[name] for name in _SUM_ARRAYS)
        return cls(Kernel(**settings["kernel"]), centres, weights, settings["bias"], mean, scale)


_LEAVES: Final = 8
"""Largest number of bands of one input."""

_LEAST_SHARE: Final = 0.01
"""Least share of the data in a band."""

_PRICE: Final = 2.0
"""Least improvement by a step, in units of noise variance times log n.

One unit is for the place of the step and one for its height (Schwarz).
"""

_ROUNDS: Final = 4
"""Iterations of backfitting."""


@dataclass(frozen=True)
class Columns:
    """Some of the inputs, unchanged.

    Attributes:
        used: their numbers.
    """

    used: tuple[int, ...]

    def __len__(self) -> int:
        """Return the number of features."""
        return len(self.used)

    def part(self, features: Sequence[int]) -> Columns:
        """Return some of the features, by number."""
        return Columns(tuple(self.used[i] for i in features))

    def values(self, points: Array) -> Array:
        """Return the features (n, m) of inputs (n, d)."""
        return points[:, self.used]

    def expression(self, x: ca.MX) -> ca.MX:
        """Return the features (m,) of inputs (d,), an expression."""
        return x if self.used == tuple(range(x.shape[0])) else x[list(self.used)]

    def parts(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Return (settings for JSON, arrays): everything that `features_from` needs."""
        return {"used": list(self.used)}, {}


_STEP_ARRAYS: Final = ("column", "place", "height", "spread")
"""The arrays of `Steps`, one entry for each step."""


@dataclass(frozen=True, eq=False)
class Steps:
    """Soft steps of some inputs: one feature for each input with steps.

    Attributes:
        column: input of each step, ascending (m,).
        place: c of each step (m,).
        height: h of each step (m,).
        spread: standard deviation of the input of each step (m,).
        widths: widths of the soft steps, in units of the spread.
        shares: shares of the widths; the sum is 1.
    """

    column: NDArray[np.int64]
    place: Array
    height: Array
    spread: Array
    widths: tuple[float, ...]
    shares: tuple[float, ...]

    def __post_init__(self) -> None:
        """Check the widths.

        Raises:
            ModelError: if a width is not positive, or the shares do not add up to 1.
        """
        widths, shares = tuple(map(float, self.widths)), tuple(map(float, self.shares))
        if not widths or min(widths) <= 0 or not are_shares(shares, len(widths)):
            raise ModelError(
                f"steps: got widths {widths} with shares {shares}, "
                "allowed positive widths and as many shares, not negative, adding up to 1"
            )
        object.__setattr__(self, "widths", widths)
        object.__setattr__(self, "shares", shares)

    @classmethod
    def fit(
        cls, points: Array, labels: Array, widths: Sequence[float], shares: Sequence[float]
    ) -> Steps:
        """Find the steps in points (n, d) with labels (n,). There may be none.

        Raises:
            ModelError: if widths or shares are not allowed.
            MissingExtraError: if scikit-learn is not installed.
        """
        tree = sklearn("tree", "fitting a kernel cost").DecisionTreeRegressor
        n, d = points.shape
        effects, found = np.zeros((n, d)), [(np.empty(0), np.empty(0))] * d
        for _ in range(_ROUNDS):
            for j in range(d):
                rest = labels - labels.mean() - effects.sum(axis=1) + effects[:, j]
                fitted = tree(
                    max_leaf_nodes=_LEAVES,
                    min_samples_leaf=max(1, round(_LEAST_SHARE * n)),
                    ccp_alpha=_PRICE * rest.var() * np.log(n) / n,
                ).fit(points[:, [j]], rest)
                places = np.sort(fitted.tree_.threshold[fitted.tree_.feature >= 0])
                band = np.searchsorted(places, points[:, j])
                levels = np.bincount(band, rest, len(places) + 1) / np.bincount(
                    band, minlength=len(places) + 1
                )
                effects[:, j] = levels[band]
                found[j] = places, np.diff(levels)
        column = np.repeat(np.arange(d), [len(places) for places, _ in found])
        place, height = (np.concatenate([pair[i] for pair in found]) for i in (0, 1))
        return cls(column, place, height, points.std(axis=0)[column], tuple(widths), tuple(shares))

    @cached_property
    def used(self) -> list[int]:
        """Inputs that have steps, in the order of the features."""
        return sorted(set(self.column.tolist()))

    def __len__(self) -> int:
        """Return the number of features."""
        return len(self.used)

    def part(self, features: Sequence[int]) -> Steps:
        """Return some of the features, by number."""
        kept = np.isin(self.column, [self.used[i] for i in features])
        arrays = (getattr(self, name)[kept] for name in _STEP_ARRAYS)
        return Steps(*arrays, widths=self.widths, shares=self.shares)

    @cached_property
    def _heights(self) -> Array:
        """Half the heights, as a matrix (features, steps)."""
        return np.array([np.where(self.column == j, self.height / 2, 0.0) for j in self.used])

    def values(self, points: Array) -> Array:
        """Return the features (n, features) of inputs (n, d)."""
        away = (points[:, self.column] - self.place) / self.spread
        soft = sum(
            share * np.tanh(away / width)
            for width, share in zip(self.widths, self.shares, strict=True)
        )
        return (1 + soft) @ self._heights.T

    def expression(self, x: ca.MX) -> ca.MX:
        """Return the features of inputs (d,), an expression."""
        away = (x[self.column.tolist()] - ca.DM(self.place)) / ca.DM(self.spread)
        soft = ca.MX(1)
        for width, share in zip(self.widths, self.shares, strict=True):
            soft += share * ca.tanh(away / width)
        return ca.sparsify(ca.DM(self._heights)) @ soft

    def parts(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Return (settings for JSON, arrays): everything that `features_from` needs."""
        arrays = {name: getattr(self, name) for name in _STEP_ARRAYS}
        return {"widths": list(self.widths), "shares": list(self.shares)}, arrays


def features_from(
    settings: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]
) -> Columns | Steps:
    """Return the features with these `parts`."""
    if "used" in settings:
        return Columns(tuple(settings["used"]))
    column, place, height, spread = (arrays[name] for name in _STEP_ARRAYS)
    return Steps(column, place, height, spread, settings["widths"], settings["shares"])
