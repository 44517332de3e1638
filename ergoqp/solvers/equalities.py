"""Equal bounds as equalities, for solvers that need a feasible set with an interior.

Other solvers need it because they lose multipliers between equal bounds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ergoqp.solvers.sequence import Array, Qp

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Pattern:
    """Which bounds of a QP are equal, and which are finite.

    The shapes of a solver's data depend on it.

    Attributes:
        fixed_rows: rows whose bounds are equal (m,).
        fixed: unknowns whose bounds are equal (n,).
        above: other rows that have an upper bound (m,).
        below: other rows that have a lower bound (m,).
        high: other unknowns that have an upper bound (n,).
        low: other unknowns that have a lower bound (n,).
    """

    fixed_rows: Mask
    fixed: Mask
    above: Mask
    below: Mask
    high: Mask
    low: Mask

    @property
    def key(self) -> bytes:
        """Bytes that are the same for the same pattern."""
        return np.concatenate(
            [self.fixed_rows, self.fixed, self.above, self.below, self.high, self.low]
        ).tobytes()

    def equalities(self, qp: Qp) -> tuple[Array, Array]:
        """Return C and d of C x = d: the fixed rows, then the fixed unknowns."""
        matrix = np.concatenate([qp.A[self.fixed_rows], np.eye(len(self.fixed))[self.fixed]])
        return matrix, np.concatenate([qp.ubA[self.fixed_rows], qp.ub[self.fixed]])

    def inequalities(self, qp: Qp) -> tuple[Array, Array]:
        """Return G and h of G x <= h: rows above, rows below, unknowns above, unknowns below."""
        unit = np.eye(len(self.fixed))
        matrix = np.concatenate(
            [qp.A[self.above], -qp.A[self.below], unit[self.high], -unit[self.low]]
        )
        bounds = (
            qp.ubA[self.above],
            -qp.lbA[self.below],
            qp.ub[self.high],
            -qp.lb[self.low],
        )
        return matrix, np.concatenate(bounds)

    def multipliers(self, equal: Array, unequal: Array) -> tuple[Array, Array]:
        """Return row and unknown multipliers from those of `equalities` and `inequalities`."""
        rows, box = np.zeros(len(self.fixed_rows)), np.zeros(len(self.fixed))
        count = int(self.fixed_rows.sum())
        rows[self.fixed_rows], box[self.fixed] = equal[:count], equal[count:]
        ends = np.cumsum([mask.sum() for mask in (self.above, self.below, self.high)])
        above, below, high, low = np.split(unequal, ends)
        rows[self.above] += above
        rows[self.below] -= below
        box[self.high] += high
        box[self.low] -= low
        return rows, box


def pattern_of(qp: Qp) -> Pattern:
    """Return the pattern of a QP's bounds."""
    fixed_rows, fixed = qp.lbA == qp.ubA, qp.lb == qp.ub
    return Pattern(
        fixed_rows,
        fixed,
        np.isfinite(qp.ubA) & ~fixed_rows,
        np.isfinite(qp.lbA) & ~fixed_rows,
        np.isfinite(qp.ub) & ~fixed,
        np.isfinite(qp.lb) & ~fixed,
    )
