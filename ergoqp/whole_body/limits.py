"""Limits of the whole body as limits of mink.

They are rows on the displacement of one period, G Delta <= h.
"""

from __future__ import annotations

import mink
import numpy as np

from ergoqp.solvers.solver import FREE
from ergoqp.whole_body.moment import Moment
from ergoqp.whole_body.scene import ModelColumns


class _MomentLimit(mink.Limit):
    """A limit that reads the data of the present step."""

    def __init__(self, scene: ModelColumns) -> None:
        """Keep the columns of the model."""
        self.scene = scene
        self.moment: Moment | None = None

    def _now(self) -> Moment:
        assert self.moment is not None  # set at the start of every step
        return self.moment

    def _on_arm(self, rows: np.ndarray, bounds: np.ndarray, dt: float) -> mink.Constraint:
        """Return rows on the speeds of the arm, without infinite bounds."""
        real = bounds < FREE / 2
        if not real.any():
            return mink.Constraint()
        G = np.zeros((int(real.sum()), self.scene.model.nv))
        G[:, self.scene.arm] = rows[real]
        return mink.Constraint(G, dt * bounds[real])


class TwistBounds(_MomentLimit):
    """Speed and acceleration of the object, axis by axis."""

    def compute_qp_inequalities(
        self, configuration: mink.Configuration, dt: float
    ) -> mink.Constraint:
        """Return two rows per axis that can move."""
        now = self._now()
        free = now.high - now.low >= 1e-12
        J, aside = now.jacobian[free], now.offset[free]
        return self._on_arm(
            np.vstack([J, -J]), np.concatenate([now.high[free] + aside, -now.low[free] - aside]), dt
        )


class ProblemRows(_MomentLimit):
    """The rows of the control step (joints, workspace, tool axis ...), lower <= A xi <= upper.

    If the step relaxes a row because braking itself would violate it, the row is widened by the
    slack of the step.
    """

    def __init__(self, scene: ModelColumns) -> None:
        """Start without slack."""
        super().__init__(scene)
        self.slack: np.ndarray | float = 0.0

    def compute_qp_inequalities(
        self, configuration: mink.Configuration, dt: float
    ) -> mink.Constraint:
        """Return up to two rows per row of the step."""
        now = self._now()
        rows = now.terms["A"] @ now.jacobian
        moved = now.terms["side"] * self.slack + now.terms["A"] @ now.offset
        upper, lower = now.terms["ubA"] + moved, now.terms["lbA"] + moved
        return self._on_arm(np.vstack([rows, -rows]), np.concatenate([upper, -lower]), dt)


class ArmBounds(_MomentLimit):
    """Ranges with the exact stopping bound, rates and accelerations of the arm.

    See `ergoqp.whole_body.stopping`.
    """

    def compute_qp_inequalities(
        self, configuration: mink.Configuration, dt: float
    ) -> mink.Constraint:
        """Return two rows per joint."""
        now = self._now()
        eye = np.eye(len(now.arm_high))
        return self._on_arm(
            np.vstack([eye, -eye]), np.concatenate([now.arm_high, -now.arm_low]), dt
        )


class Distance(_MomentLimit):
    """Near pairs approach each other no faster than allowed.

    Each pair with the person has two rows. In one the person follows as in the model. In the other
    the person has not reacted yet and stands still.
    """

    def compute_qp_inequalities(
        self, configuration: mink.Configuration, dt: float
    ) -> mink.Constraint:
        """Return the rows in displacements: the rate times the period."""
        now = self._now()
        if now.close is None or not len(now.close.pairs):
            return mink.Constraint()
        following = -now.close.gradients
        standing = following.copy()
        standing[:, self.scene.person] = 0.0
        return mink.Constraint(np.vstack([following, standing]), dt * np.tile(now.approach, 2))
