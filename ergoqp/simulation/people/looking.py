"""`looking`: keeps the eyes on the work; neck and trunk go where the eyes need them."""

from __future__ import annotations

import math
from typing import ClassVar, Final

import numpy as np

from ergoqp.simulation.people.soft_holding import SoftHolding, Wish
from ergoqp.simulation.people.soft_person import SoftPerson

EYES: Final = np.array([0.090, 0.0, 0.060])
"""Where the eyes are in the head of a person of 1.75 m, ahead of the top of the neck and up [m]."""

AT_EASE: Final = float(np.radians(15.0))
"""The eyes rest this far below the head's level [rad] (the normal line of sight)."""

RANGE: Final = np.radians([15.0, 15.0])
"""And turn this far up or down, and sideways, before the head goes along [rad]."""

_FIRM: Final = float(np.radians(5.0))
"""How far beyond that they look as readily as joints go by their spread [rad]."""


class LookingHolding(SoftHolding):
    """A person who looks at what the hands do."""

    def wishes(self, target: np.ndarray) -> list[Wish]:
        """Return what the person wants beside ease: to see the work too."""
        return [*super().wishes(target), self._gaze(target[:3, 3])]

    def _gaze(self, work: np.ndarray) -> Wish:
        """Return how far the eyes must turn beyond their range (2,): down, to the left."""
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
        # How the work moves in the head when the head turns and the eyes are carried along.
        turns, shifts = turn.T @ moves[3:], turn.T @ (moves[:3] - _cross(offset) @ moves[3:])
        helps = slopes / -far @ (_cross(seen) @ turns - shifts)
        helps[beyond == 0] = 0.0
        return beyond / _FIRM, helps / _FIRM


def _cross(vector: np.ndarray) -> np.ndarray:
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


class LookingPerson(SoftPerson):
    """Follows, with the eyes on the work."""

    kind: ClassVar[str] = "looking"
    manner: ClassVar[str] = "who keeps the eyes on the work"
    holding: ClassVar[type[SoftHolding]] = LookingHolding


draw = LookingPerson.drawn
