"""Descents of learned costs over postures as in the EPFL report, and judges of where they end."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.spatial import KDTree

from ergoqp.coordinates import Coordinates
from ergoqp.costs.cost import LearnedCost
from ergoqp.datasets.data import DataSet
from ergoqp.joints import LOWER, UPPER
from ergoqp.sheets import reba

Array = NDArray[np.float64]
Slopes = Callable[[Array], tuple[Array, Array]]


def slopes_of(cost: LearnedCost, count: int) -> Slopes:
    """Return a function of `count` inputs (count, d) that gives V (count,) and dV/dx (count, d)."""
    x = ca.MX.sym("x", len(cost.coordinates))
    function = ca.Function("slopes", [x], ca.cse([cost.value(x), ca.densify(cost.slope(x))])).map(
        count
    )

    def slopes(points: Array) -> tuple[Array, Array]:
        values, gradients = function(points.T)
        return np.asarray(values).ravel(), np.asarray(gradients).T

    return slopes


def follow(
    slopes: Slopes,
    starts: Array,
    rate: float = 0.01,
    steps: int = 2000,
    *,
    box: tuple[Array, Array] | None = None,
    stop_below: float | None = None,
    every: int = 1,
) -> Array:
    """Follow the gradient with a constant rate, as the EPFL report does.

    Args:
        slopes: gives values and gradients.
        starts: first points (n, d).
        rate: step per unit of gradient [rad^2 per point].
        steps: number of steps.
        box: lower and upper ends (d,) of the inputs, None for none.
        stop_below: a point whose value is below stays where it is.
        every: keep the points of every so many steps.

    Returns:
        The points on the way, shape (1 + steps // every, n, d): those at the start, and after every
        so many steps.
    """
    points, path = starts, [starts]
    for i in range(1, steps + 1):
        values, gradients = slopes(points)
        moving = np.ones(len(starts), dtype=bool) if stop_below is None else values >= stop_below
        points = points - rate * gradients * moving[:, np.newaxis]
        if box is not None:
            points = np.clip(points, *box)
        if i % every == 0:
            path.append(points)
    return np.array(path)


def to_the_bottom(cost: LearnedCost, starts: Array, box: tuple[Array, Array]) -> Array:
    """Return the local minima (n, d) within a box, by L-BFGS-B.

    Neither step size nor patience plays a part.
    """
    slopes = slopes_of(cost, 1)

    def one(x: Array) -> tuple[float, Array]:
        value, gradient = slopes(x[np.newaxis])
        return float(value[0]), gradient[0]

    bounds = list(zip(*box, strict=True))
    return np.array(
        [minimize(one, start, jac=True, method="L-BFGS-B", bounds=bounds).x for start in starts]
    )


def balanced_rows(data: DataSet, per_score: int) -> NDArray[np.int64]:
    """Return the first `per_score` row numbers of each score: the starts all methods share."""
    return np.concatenate(
        [np.flatnonzero(data.labels == score)[:per_score] for score in np.unique(data.labels)]
    )


def joint_ranges(coordinates: tuple[str, ...]) -> tuple[Array, Array]:
    """Return the lower and upper ends of the ranges of joints, (d,) each [rad]."""
    indices = Coordinates(coordinates).indices
    return LOWER[indices], UPPER[indices]


def true_scores(points: Array, coordinates: tuple[str, ...]) -> NDArray[np.int64]:
    """Return the sheet's scores (n,) of inputs (n, d); joints that are no inputs are at zero.

    Angles beyond half a turn are read as half a turn: the sheet's outer bands go on.
    """
    postures = Coordinates(coordinates).spread(points)
    return reba.assess(np.clip(postures, -np.pi, np.pi)).final


def nearest_scores(points: Array, data: DataSet) -> Array:
    """Return the label (n,) of the data point nearest to each point (n, d).

    This is the EPFL report's judge.
    """
    return data.labels[KDTree(data.points).query(points)[1]]
