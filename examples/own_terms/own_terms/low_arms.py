"""A cost: the upper arms hang, the elbows are bent."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ergoqp.joints import INDEX

_ANGLES = {
    "right_shoulder_flexion": 0.0,
    "right_shoulder_abduction": 0.0,
    "right_elbow_flexion": 1.4,
}
_AT = [INDEX[name] for name in _ANGLES]
_REST = np.array(list(_ANGLES.values()))


@dataclass(frozen=True)
class LowArms:
    """1 + weight * (squared distance of the right arm's angles from rest) [points]."""

    weight: float = 2.0
    name = "low arms"
    minimum = 1.0

    def expression(self, q: ca.MX) -> ca.MX:
        """Return V of a posture (32,) [rad]."""
        return 1 + self.weight * ca.sumsqr(q[_AT] - _REST)

    def __call__(self, postures: ArrayLike) -> np.ndarray:
        """Return V of each posture (n, 32) [rad]."""
        return 1 + self.weight * ((np.atleast_2d(postures)[:, _AT] - _REST) ** 2).sum(axis=1)
