"""Whether an answer of a QP solver is one, in plain NumPy: no solver's word is taken for it.

The three residuals are those of qpbenchmark (Caron and others, 2024), absolute and in the infinity
norm; a fourth looks at the signs of the multipliers, which those three do not see.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from ergoqp.solvers.sequence import Array, Qp
from ergoqp.solvers.session import QpAnswer

TOLERANCES: Final = (1e-3, 1e-6, 1e-9)
"""The accuracies of qpbenchmark: low, middle and high."""

SHIFT: Final = 10e-6
"""Shift of the geometric mean of times [s]: about the fastest solver's time.

So no outlier at either end decides.
"""


@dataclass(frozen=True)
class Residuals:
    """How far an answer is from being one.

    Attributes:
        primal: by how much rows and bounds are broken.
        dual: largest entry of H x + g + A' rows + box.
        gap: difference of the primal and the dual objective.
        sign: largest multiplier that pulls from the farther end of its row, or from an end that is
            not there; where that end is nearer than the multiplier is large, its distance: between
            ends that all but meet either may pull.
    """

    primal: float
    dual: float
    gap: float
    sign: float

    @property
    def worst(self) -> float:
        """The largest of the four; infinity where the answer holds no numbers."""
        return max(self.primal, self.dual, self.gap, self.sign)

    def relative(self, qp: Qp) -> float:
        """Return the largest of the four with the dual ones relative to 1 + max |g|.

        The control step judges in the same way.
        """
        scale = 1.0 + float(np.abs(qp.g).max())
        return max(self.primal, self.dual / scale, self.gap / scale, self.sign / scale)


NOTHING: Final = Residuals(np.inf, np.inf, np.inf, np.inf)


def judge(qp: Qp, answer: QpAnswer) -> Residuals:
    """Return the residuals of an answer."""
    x, rows, box = answer.x, answer.rows, answer.box
    if not (np.isfinite(x).all() and np.isfinite(rows).all() and np.isfinite(box).all()):
        return NOTHING
    value = np.concatenate([qp.A @ x, x])
    least, most = np.concatenate([qp.lbA, qp.lb]), np.concatenate([qp.ubA, qp.ub])
    multiplier = np.concatenate([rows, box])
    below, above = value - least, most - value
    primal = float(max(0.0, -below.min(), -above.min()))
    dual = float(np.abs(qp.H @ x + qp.g + qp.A.T @ rows + box).max())
    at_most = np.where(np.isfinite(most), most, 0.0) @ np.maximum(multiplier, 0.0)
    at_least = np.where(np.isfinite(least), least, 0.0) @ np.minimum(multiplier, 0.0)
    gap = float(abs(x @ qp.H @ x + qp.g @ x + at_most + at_least))
    return Residuals(primal, dual, gap, _wrong_sign(multiplier, below, above))


def _wrong_sign(multiplier: Array, below: Array, above: Array) -> float:
    up = np.where(above > below, np.minimum(np.maximum(multiplier, 0.0), above), 0.0)
    down = np.where(below > above, np.minimum(np.maximum(-multiplier, 0.0), below), 0.0)
    return float(max(up.max(), down.max(), 0.0))


def tidy(tolerance: float) -> str:
    """Return a tolerance as in the names of figures, ``1e-6``."""
    return np.format_float_scientific(tolerance, trim="-", exp_digits=1)


def shifted_geometric_mean(seconds: Array, shift: float = SHIFT) -> float:
    """Return exp(mean(log(t + shift))) - shift of times [s]."""
    return float(np.exp(np.log(np.asarray(seconds) + shift).mean()) - shift)
