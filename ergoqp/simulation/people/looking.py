"""`looking`: keeps the eyes on the work. Neck and trunk follow as the eyes need."""

from __future__ import annotations

import math
from typing import ClassVar, Final

import numpy as np

from ergoqp.simulation.people.soft_holding import SoftHolding, Wish
from ergoqp.simulation.people.soft_person import SoftPerson

EYES: Final = np.array([0.090, 0.0, 0.060])
"""Position of the eyes in the head of a person of 1.75 m, relative to the top of the neck [m]."""

AT_EASE: Final = float(np.radians(15.0))
"""Angle of the eyes at rest below the level of the head [rad] (the normal line of sight)."""

RANGE: Final = np.radians([15.0, 15.0])
"""Turn of the eyes up or down, and sideways, before the head follows [rad]."""

_FIRM: Final = float(np.radians(5.0))
"""Gaze error with the same cost as a joint that moves by its spread [rad]."""


class LookingHolding(SoftHolding):
    """A person who looks at what the hands do."""

    def wishes(self, target: np.ndarray) -> list[Wish]:
        """Return the wishes besides ease, including the wish to see the work."""
        return [*super().wishes(target), self._gaze(target[:3, 3])]

    def _gaze(self, work: np.ndarray) -> Wish:
        """Return the turn of the eyes beyond their range (2,): down, to the left, as a wish."""
        tasks, scale = self.person.tasks, self.person.body.stature / 1.75
        head, moves = tasks.frame("head"), tasks.jacobian("head")
        turn, offset = head[:3, :3], head[:3, :3] @ EYES * scale
        seen = turn.T @ (work - head[:3, 3] - offset)
        x, y, z = seen
        level, far = math.hypot(x, y), float(seen @ seen)
        asked = np.array([math.atan2(-z, level) - AT_EASE, math.atan2(y, x)])
        beyond = asked - np.clip(asked, -RANGE, RANGE)
        slopes = np.array(
            [[z * x / level, z * y / level, -level], [-y * far / level**2, x * far / level**2, 0.0]]
        )
        # Motion of the work in the frame of the head when the head moves with the eyes.
        turns, shifts = turn.T @ moves[3:], turn.T @ (moves[:3] - _cross(offset) @ moves[3:])
        helps = slopes / -far @ (_cross(seen) @ turns - shifts)
        helps[beyond == 0] = 0.0
        return beyond / _FIRM, helps / _FIRM


def _cross(vector: np.ndarray) -> np.ndarray:
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


class LookingPerson(SoftPerson):
    """Follows the object and keeps the eyes on the work."""

    kind: ClassVar[str] = "looking"
    manner: ClassVar[str] = "who keeps the eyes on the work"
    holding: ClassVar[type[SoftHolding]] = LookingHolding


draw = LookingPerson.drawn
