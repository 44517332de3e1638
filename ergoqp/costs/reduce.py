"""Fewer kernels: a sum of hundreds of kernels that replaces one of thousands.

The difference is measured and kept with the cost.

Each control step evaluates every centre, so time grows with their number. Nearby centres are
nearly redundant. So some centres are selected, or replaced by the middles of groups. The
weights are then fitted to the values of the full sum, by least squares with a small ridge (the
subset of regressors that belongs to the Nystroem approximation).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Final, Literal, Protocol, Self, TypeVar, get_args, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from ergoqp.datasets.data import DataSet
from ergoqp.errors import ModelError
from ergoqp.learning.kernels import KernelSum
from ergoqp.learning.pipelines import sklearn

Array = NDArray[np.float64]

Method = Literal["clusters", "largest"]
"""How centres are chosen: middles of groups of centres, or the centres with the largest weights.

The groups are found by k-means, weighted by the absolute weights. Keeping the largest weights
is pruning.
"""

_RIDGE: Final = 1e-7
"""Ridge of the least squares, relative to the mean diagonal."""

_CHUNK: Final = 2000
"""Number of points whose kernels are in memory at once."""


@dataclass(frozen=True)
class Reduction:
    """Difference between a reduced sum and the full one, on the points of the fit.

    Attributes:
        method: how the centres were chosen.
        centres: number of centres that are left.
        of: number of centres of the full sum.
        rms: root mean square of the difference [points].
        largest: largest difference [points].
        points: number of points on which it was measured.
    """

    method: str
    centres: int
    of: int
    rms: float
    largest: float
    points: int

    def as_dict(self) -> dict[str, Any]:
        """Return the numbers by name."""
        return asdict(self)

    def __str__(self) -> str:
        """Return the difference as one line."""
        return (
            f"{self.centres} of {self.of} kernels ({self.method}): "
            f"{self.rms:.3g} points rms, {self.largest:.3g} at most, on {self.points} points"
        )


@runtime_checkable
class KernelCost(Protocol):
    """A cost that is one sum of kernels of some features.

    Attributes:
        model: the sum.
    """

    @property
    def model(self) -> Any:
        """The sum of kernels."""
        ...

    def seen(self, points: Array) -> Array:
        """Return the features (n, m) of inputs (n, d) that the kernels use."""
        ...

    def with_model(self, model: KernelSum, reduction: Reduction) -> Self:
        """Return the same cost with another sum."""
        ...


Kind = TypeVar("Kind", bound=KernelCost)


def reduced(
    cost: Kind, count: int, data: DataSet, seed: int = 0, method: Method = "clusters"
) -> tuple[Kind, Reduction]:
    """Replace the sum of kernels of a cost by a smaller one.

    Args:
        cost: `Svr`, or `SklearnCost` of one sum of kernels.
        count: centres to keep.
        data: points at which the two should agree, at least as many as centres; labels are not
            used.
        seed: seed of the groups.
        method: how the centres are chosen.

    Returns:
        (smaller cost, its difference from `cost`, which it keeps and saves).

    Raises:
        ModelError: if the cost is not a sum of kernels, has no more than `count` centres, or
            there are too few points.
        MissingExtraError: if scikit-learn is not installed.
    """
    full = cost.model if isinstance(cost, KernelCost) else None
    if not isinstance(full, KernelSum):
        raise ModelError(
            f"reduce: got a {type(cost).__name__}, allowed a cost that is a sum of kernels"
        )
    if method not in get_args(Method):
        raise ModelError(
            f"reduce: got the method {method!r}, allowed {', '.join(get_args(Method))}"
        )
    if not 1 <= count < len(full):
        raise ModelError(
            f"reduce: got {count} centres, allowed at least 1 and fewer than the {len(full)} that"
            " the cost has"
        )
    if len(data) < count:
        raise ModelError(
            f"reduce: got {len(data)} points, allowed at least {count}, one per centre"
        )
    points = cost.seen(data.points)
    target = full.values(points)
    centres = (
        _clusters(full, count, seed)
        if method == "clusters"
        else full.centres[np.argsort(-np.abs(full.weights))[:count]]
    )
    basis = KernelSum(full.kernel, centres, np.ones(count), 0.0, full.mean, full.scale)
    weights, bias = _least_squares(basis, points, target)
    small = KernelSum(full.kernel, centres, weights, bias, full.mean, full.scale)
    error = small.values(points) - target
    difference = Reduction(
        method,
        count,
        len(full),
        float(np.sqrt(np.mean(error**2))),
        float(np.abs(error).max()),
        len(data),
    )
    return cost.with_model(small, difference), difference


def _clusters(full: KernelSum, count: int, seed: int) -> Array:
    means = sklearn("cluster", "reducing a kernel cost").MiniBatchKMeans(
        count, random_state=seed, n_init=1, batch_size=4096, max_iter=20
    )
    return means.fit(full.centres, sample_weight=np.abs(full.weights)).cluster_centers_


def _least_squares(basis: KernelSum, points: Array, target: Array) -> tuple[Array, float]:
    """Return (weights, bias) of kernels at the centres of `basis`, in chunks of points."""
    count, middle = len(basis), float(target.mean())
    gram, right = np.zeros((count + 1, count + 1)), np.zeros(count + 1)
    for start in range(0, len(points), _CHUNK):
        features = basis.features(points[start : start + _CHUNK])
        features = np.column_stack([features, np.ones(len(features))])
        gram += features.T @ features
        right += features.T @ (target[start : start + _CHUNK] - middle)
    ridge = _RIDGE * np.trace(gram[:count, :count]) / count
    gram[np.diag_indices(count)] += ridge
    solution = np.asarray(np.linalg.solve(gram, right), dtype=float)
    return solution[:count], float(solution[count]) + middle
