"""Check of a QP solver's answer in plain NumPy, independent of the status of the solver.

Three residuals are those of qpbenchmark (Caron and others, 2024), absolute and in the infinity
norm. A fourth checks the signs of the multipliers, which those three do not show.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from ergoqp.solvers.sequence import Array, Qp
from ergoqp.solvers.session import QpAnswer

TOLERANCES: Final = (1e-3, 1e-6, 1e-9)
"""The tolerances of qpbenchmark: low, middle and high accuracy."""

SHIFT: Final = 10e-6
"""Shift of the geometric mean of times [s], about the time of the fastest solver.

So no outlier dominates the mean.
"""


@dataclass(frozen=True)
class Residuals:
    """Residuals of an answer.

    Attributes:
        primal: largest violation of rows and bounds.
        dual: largest entry of H x + g + A' rows + box.
        gap: difference of the primal and the dual objective.
        sign: largest multiplier at the farther end of its row, or at an infinite end. If the
            distance to that end is smaller than the multiplier, it is that distance, because
            between almost equal ends either end may be active.
    """

    primal: float
    dual: float
    gap: float
    sign: float

    @property
    def worst(self) -> float:
        """The largest of the four; infinity if the answer has no numbers."""
        return max(self.primal, self.dual, self.gap, self.sign)

    def relative(self, qp: Qp) -> float:
        """Return the largest of the four, with the dual ones relative to 1 + max |g|.

        The control step uses the same scale.
        """
        scale = 1.0 + float(np.abs(qp.g).max())
        return max(self.primal, self.dual / scale, self.gap / scale, self.sign / scale)


NOTHING: Final = Residuals(np.inf, np.inf, np.inf, np.inf)


def judge(qp: Qp, answer: QpAnswer) -> Residuals:
    """Return the residuals of an answer.

    Args:
        qp: the QP.
        answer: x (n,) and multipliers of rows (m,) and bounds (n,), in the units of the QP.

    Source:
        Caron and others, qpbenchmark, 2024: primal and dual residual and duality gap.

    Example:
        >>> import numpy as np
        >>> from ergoqp.solvers.judge import judge
        >>> from ergoqp.solvers.sequence import Qp
        >>> from ergoqp.solvers.session import QpAnswer
        >>> one = np.ones(1)
        >>> qp = Qp(one[:, None], -2 * one, one[:, None], -one, one, -5 * one, 5 * one)
        >>> judge(qp, QpAnswer(one, one, 0 * one, "solved")).worst
        0.0
        >>> judge(qp, QpAnswer(2 * one, 0 * one, 0 * one, "solved")).primal
        1.0
    """
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
