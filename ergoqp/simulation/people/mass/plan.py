"""A wanted posture on the way to its optimum."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from ergoqp.joints import JOINTS
from ergoqp.simulation.people.mass.anatomy import PERSON_DOFS

PERSON_QPOS: Final = 7 + len(JOINTS)
"""Number of coordinates: pelvis position and quaternion, then the joints."""

_DAMPING: Final = 0.5
"""Least cost of a step itself, per rad^2 or m^2, because a step ignores how the frames turn."""

_MORE, _LESS = 4.0, 0.6
"""Factors on this cost: if a step reverses the last one, as at the end of reach, and if not."""

_BACK: Final = -0.3
"""A step with a lower cosine to the last step counts as reversing it."""

_ARRIVED: Final = 1e-3
"""Change of all joints below which a plan has arrived [rad]."""


@dataclass(frozen=True)
class Plan:
    """A wanted posture on the way to its optimum.

    Attributes:
        qpos: pelvis and joints (39,).
        change: change by the last step (38,) [m, rad].
        damping: cost of the next step itself.
    """

    qpos: np.ndarray
    change: np.ndarray = field(default_factory=lambda: np.full(PERSON_DOFS, np.inf))
    damping: float = _DAMPING

    @property
    def arrived(self) -> bool:
        """Whether the last step changed almost nothing."""
        return bool(np.abs(self.change).max() < _ARRIVED)

    def after(self, qpos: np.ndarray, change: np.ndarray) -> Plan:
        """Return the plan after a step to a state (39,) with this change (38,)."""
        sizes = float(np.linalg.norm(change) * np.linalg.norm(self.change))
        back = np.isfinite(sizes) and change @ self.change < _BACK * sizes
        damping = self.damping * _MORE if back else max(_DAMPING, self.damping * _LESS)
        return Plan(qpos, change, damping)
