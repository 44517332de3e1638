"""Gradient descent in the six coordinates, as in the EPFL report (section 4.2.3).

The constraints are measured against it.

The report's ways, in its order: the plain gradient, which tears the forearm apart (figure 20); the
same with the length maintained (21); with the gradient of a one-class SVM added to stay near the
data (22, 23); and one one-class SVM per score, from class i toward the class below (24, 25). Each
is stopped by hand, where the estimated cost is 1.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

Slope = Callable[[Array], tuple[Array, Array]]
"""Points (n, 6) -> values (n,) and gradients (n, 6): what is descended."""


@dataclass(frozen=True, eq=False)
class Descent:
    """Many descents of one length.

    Attributes:
        path: every point on the way, shape (steps + 1, n, 6) [m]; who stopped stays.
        values: of what was descended (steps + 1, n).
    """

    path: Array
    values: Array

    @property
    def ends(self) -> Array:
        """Where each descent ended (n, 6) [m]."""
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
        slope: of what is descended.
        starts: shape (n, 6) [m].
        stop_at: a descent stops for good where the value is not above this; None: never.
        length: maintained distance of elbow and wrist [m]: after each step both points move along
            their line, each by half of what is missing, which is the orthogonal projection; None:
            not maintained.
        steps: number of steps.
        rate: step per gradient [m^2 per unit of the value].
        longest: a step's largest length, both points together [m].
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
    """Return points (n, 6) whose two ends are `length` apart [m], the nearest to those given."""
    apart = points[:, 3:] - points[:, :3]
    distance = np.linalg.norm(apart, axis=1, keepdims=True)
    shift = apart * (length / distance - 1) / 2
    return points + np.hstack([-shift, shift])


def slope_of(function: ca.Function) -> Slope:
    """Return a CasADi function ``x (6,) -> value, gradient (6,)`` for many points.

    It works as `value_and_gradient` of a cost.
    """

    def slope(points: Array) -> tuple[Array, Array]:
        value, gradient = function.map(len(points))(points.T)
        return np.asarray(value).ravel(), np.asarray(gradient).T

    return slope


def added(cost: Slope, margin: Slope, weight: float) -> Slope:
    """Return the cost with the gradient of a one-class SVM added: toward its inside.

    The value is still the cost's.

    Args:
        cost: what is to become low.
        margin: of the one-class SVM, positive inside.
        weight: of its gradient [points per unit of the margin].
    """

    def slope(points: Array) -> tuple[Array, Array]:
        value, gradient = cost(points)
        return value, gradient - weight * margin(points)[1]

    return slope


def toward_class_below(margins: Sequence[Slope], scores: Sequence[float]) -> Slope:
    """Return the slope that leads from class i into the one-class SVM of the class below it.

    A point's class is the lowest whose SVM contains it, and where none does the one whose margin is
    largest. The value is the score of this class; from the lowest class on the way leads further
    into it.

    Args:
        margins: of the one-class SVMs, positive inside, by ascending score.
        scores: of the classes, ascending.
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
