"""Features of a kernel cost: some of the inputs, or soft steps of them.

A score from a sheet is piecewise constant, and each joint counts by its band. A kernel of
plain angles cannot represent that 19 and 21 deg differ more than 1 and 19. So the bands are
found from the data. An additive model with one small regression tree per input is fitted by
backfitting. Each tree is a series of steps at c_k with the height h_k. The feature of the
input is this series made smooth,

    u_j = sum_k h_jk sum_w share_w S((x_j - c_jk) / (width_w s_j)),   S(z) = (1 + tanh z) / 2,

where s_j is the standard deviation of the input. Narrow steps follow the data closely, wide
ones give a slope far away. Both are used, as in `ergoqp.costs.smooth_reba`. Beyond the
outermost step a feature is flat, so a cost of features does not grow without bound where there
were no data.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ergoqp.errors import ModelError
from ergoqp.learning.pipelines import sklearn

Array = NDArray[np.float64]

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
        if (
            not widths
            or len(widths) != len(shares)
            or min(widths) <= 0
            or min(shares) < 0
            or abs(sum(shares) - 1) > 1e-9
        ):
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
        arrays = {
            "place": self.place[kept],
            "height": self.height[kept],
            "spread": self.spread[kept],
        }
        return Steps(self.column[kept], **arrays, widths=self.widths, shares=self.shares)

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
        arrays = {
            "column": self.column,
            "place": self.place,
            "height": self.height,
            "spread": self.spread,
        }
        return {"widths": list(self.widths), "shares": list(self.shares)}, arrays


def features_from(
    settings: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]
) -> Columns | Steps:
    """Return the features with these `parts`."""
    if "used" in settings:
        return Columns(tuple(settings["used"]))
    column, place, height, spread = (
        arrays[name] for name in ("column", "place", "height", "spread")
    )
    return Steps(
        column, place, height, spread, tuple(settings["widths"]), tuple(settings["shares"])
    )
