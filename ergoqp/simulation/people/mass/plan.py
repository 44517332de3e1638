"""A wanted posture on its way to where steps lead it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from ergoqp.joints import JOINTS
from ergoqp.simulation.people.mass.anatomy import PERSON_DOFS

PERSON_QPOS: Final = 7 + len(JOINTS)
"""Pelvis position and quaternion, then the joints."""

_DAMPING: Final = 0.5
"""Least cost of a step itself, per rad^2 or m^2: a step leaves out how the frames turn with it."""

_MORE, _LESS = 4.0, 0.6
"""Where a step takes the last one back, as at the end of reach, the next costs more, else less."""

_BACK: Final = -0.3
"""Cosine between two steps of which the second takes the first one back."""

_ARRIVED: Final = 1e-3
"""Change of all joints below which a plan has arrived [rad]."""


@dataclass(frozen=True)
class Plan:
    """A wanted posture on its way.

    Attributes:
        qpos: pelvis and joints (39,).
        change: that the last step made (38,) [m, rad].
        damping: what the next step costs of itself.
    """

    qpos: np.ndarray
    change: np.ndarray = field(default_factory=lambda: np.full(PERSON_DOFS, np.inf))
    damping: float = _DAMPING

    @property
    def arrived(self) -> bool:
        """Whether the last step changed next to nothing."""
        return bool(np.abs(self.change).max() < _ARRIVED)

    def after(self, qpos: np.ndarray, change: np.ndarray) -> Plan:
        """Return the plan after a step to a state (39,) that changed it by so much (38,)."""
        sizes = float(np.linalg.norm(change) * np.linalg.norm(self.change))
        back = np.isfinite(sizes) and change @ self.change < _BACK * sizes
        damping = self.damping * _MORE if back else max(_DAMPING, self.damping * _LESS)
        return Plan(qpos, change, damping)
