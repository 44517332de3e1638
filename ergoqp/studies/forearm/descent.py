"""Gradient descent in the six coordinates, as in the EPFL report (section 4.2.3).

It is the baseline for the constraints of this package.

The variants of the report, in its order: the plain gradient, which changes the length of the
forearm (figure 20); the same with the length kept (21); with the gradient of a one-class SVM
added, to stay near the data (22, 23); and one one-class SVM per score, from class i toward the
class below (24, 25). Each is stopped where the estimated cost is 1.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

Slope = Callable[[Array], tuple[Array, Array]]
"""Points (n, 6) -> values (n,) and gradients (n, 6) of the function to descend."""


@dataclass(frozen=True, eq=False)
class Descent:
    """Many descents with the same number of steps.

    Attributes:
        path: all points on the way, shape (steps + 1, n, 6) [m]; a stopped descent stays where
            it is.
        values: values of the function along the way (steps + 1, n).
    """

    path: Array
    values: Array

    @property
    def ends(self) -> Array:
        """End of each descent (n, 6) [m]."""
        return self.path[-1]


def descend(
    slope: Slope,
    starts: Array,
    *,
    stop_at: float | None = 1.0,
    length: float | None = None,
    steps: int = 500,
    rate: float = 2e-3,
    longest: float = 0.01,
) -> Descent:
    """Follow the negative gradient from many starts at once.

    Args:
        slope: the function to descend.
        starts: shape (n, 6) [m].
        stop_at: a descent stops for good where the value is not above this; None: never.
        length: distance of elbow and wrist to keep [m]: after each step both points move along
            their line, each by half of the difference, which is the orthogonal projection;
            None: not kept.
        steps: number of steps.
        rate: step per gradient [m^2 per unit of the value].
        longest: largest length of a step, for both points together [m].
    """
    points = np.array(starts, dtype=float, ndmin=2)
    points = points if length is None else keep_length(points, length)
    value, gradient = slope(points)
    path, values = [points], [value]
    stopped = np.zeros(len(points), dtype=bool)
    for _ in range(steps):
        if stop_at is not None:
            stopped |= value <= stop_at
        step = -rate * gradient
        step *= np.minimum(
            1, longest / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-12)
        )
        step[stopped] = 0
        moved = points + step
        points = np.where(
            stopped[:, None], points, moved if length is None else keep_length(moved, length)
        )
        value, gradient = slope(points)
        path.append(points)
        values.append(value)
    return Descent(np.stack(path), np.stack(values))


def keep_length(points: Array, length: float) -> Array:
    """Return the nearest points (n, 6) to those given whose two ends are `length` apart [m]."""
    apart = points[:, 3:] - points[:, :3]
    distance = np.linalg.norm(apart, axis=1, keepdims=True)
    shift = apart * (length / distance - 1) / 2
    return points + np.hstack([-shift, shift])


def slope_of(function: ca.Function) -> Slope:
    """Return a CasADi function ``x (6,) -> value, gradient (6,)`` as a function of many points.

    An example is the `value_and_gradient` of a cost.
    """

    def slope(points: Array) -> tuple[Array, Array]:
        value, gradient = function.map(len(points))(points.T)
        return np.asarray(value).ravel(), np.asarray(gradient).T

    return slope


def added(cost: Slope, margin: Slope, weight: float) -> Slope:
    """Return the cost with the gradient of a one-class SVM added, which points inside.

    The value stays that of the cost.

    Args:
        cost: the cost to descend.
        margin: margin of the one-class SVM, positive inside.
        weight: weight of its gradient [points per unit of the margin].
    """

    def slope(points: Array) -> tuple[Array, Array]:
        value, gradient = cost(points)
        return value, gradient - weight * margin(points)[1]

    return slope


def toward_class_below(margins: Sequence[Slope], scores: Sequence[float]) -> Slope:
    """Return the slope that leads from class i into the one-class SVM of the class below.

    The class of a point is the lowest whose SVM contains it. If none does, it is the one with
    the largest margin. The value is the score of this class. In the lowest class the slope
    leads further into it.

    Args:
        margins: margins of the one-class SVMs, positive inside, by ascending score.
        scores: scores of the classes, ascending.
    """

    def slope(points: Array) -> tuple[Array, Array]:
        found = [margin(points) for margin in margins]
        values = np.stack([value for value, _ in found])
        inside = values >= 0
        current = np.where(inside.any(axis=0), inside.argmax(axis=0), values.argmax(axis=0))
        uphill = np.stack([gradient for _, gradient in found])[
            np.maximum(current - 1, 0), np.arange(len(points))
        ]
        return np.asarray(scores, dtype=float)[current], -uphill

    return slope
