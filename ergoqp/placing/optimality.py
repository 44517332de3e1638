"""How far a solution is from optimal, computed from the expressions of the program."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

Ends = tuple[np.ndarray, np.ndarray]
"""Lower and upper ends."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Result of a solver.

    Attributes:
        values: values of all unknowns (n,).
        residual: largest violation of the optimality conditions, recomputed from the
            expressions of the program.
    """

    values: np.ndarray
    residual: float


def optimality_function(nlp: Mapping[str, Any]) -> ca.Function:
    """Return ``(x, p, on_rows, on_bounds) -> (slope of the Lagrangian, rows)`` of a program.

    Args:
        nlp: ``x``, ``p``, ``f`` and ``g``, as `casadi.nlpsol` takes them.
    """
    kind = type(nlp["x"])
    on_rows, on_bounds = (
        kind.sym("on_rows", nlp["g"].numel()),
        kind.sym("on_bounds", nlp["x"].numel()),
    )
    slope = ca.gradient(nlp["f"] + ca.dot(on_rows, nlp["g"]), nlp["x"]) + on_bounds
    return ca.Function("optimality", [nlp["x"], nlp["p"], on_rows, on_bounds], [slope, nlp["g"]])


def violation(slope: np.ndarray, bounded: Iterable[tuple[Ends, np.ndarray, np.ndarray]]) -> float:
    """Return the largest violation of the optimality conditions; inf if any is not a number.

    Args:
        slope: slope of the Lagrangian (n,) [points per unit].
        bounded: for the unknowns and for the rows: their ends, values, and multipliers; a
            positive multiplier belongs to the upper end.
    """
    worst = [np.abs(slope).max()]
    for (low, high), values, multipliers in bounded:
        worst.append(np.maximum(low - values, values - high).max(initial=0.0))
        end = np.where(multipliers > 0, high - values, values - low)
        # Without an end the multiplier must be zero.
        worst.append(np.abs(multipliers * np.where(np.isfinite(end), end, 1.0)).max(initial=0.0))
    largest = float(np.max(worst))
    return largest if np.isfinite(largest) else float("inf")
