"""`looking`: keeps the eyes on the work; neck and trunk go where the eyes need them."""

from __future__ import annotations

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
        x, y, z = turn.T @ (work - head[:3, 3] - offset)
        down, left = np.arctan2(-z, np.hypot(x, y)), np.arctan2(y, x)
        asked = np.array([down - AT_EASE, left])
        beyond = asked - np.clip(asked, -RANGE, RANGE)
        # Turning the head helps, and so does moving the eyes across the line of sight.
        turns, shifts = turn.T @ moves[3:], turn.T @ (moves[:3] - _cross(offset) @ moves[3:])
        distance = max(0.15, float(np.sqrt(x * x + y * y + z * z)))
        helps = np.array([turns[1] - shifts[2] / distance, turns[2] + shifts[1] / distance])
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
