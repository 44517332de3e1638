"""`dead_zone`: only the arm follows small changes. Large ones move the body too."""

from __future__ import annotations

from typing import ClassVar, Final

import numpy as np

from ergoqp.joints import JOINTS
from ergoqp.problem.way import pose_error
from ergoqp.simulation.people.body_tasks import BASE
from ergoqp.simulation.people.senses import Senses
from ergoqp.simulation.people.soft_body import SoftBody
from ergoqp.simulation.people.soft_holding import REACHED, SoftHolding, Wish
from ergoqp.simulation.people.soft_person import SoftPerson

SHIFT: Final = 0.03
TURN: Final = float(np.radians(10.0))
"""The arm alone follows as long as the object is within this distance [m] and angle [rad]."""

_SETTLED: Final = 0.005
"""The body stops moving once no joint is faster than this [rad/s]."""


_MISSES: Final = 5
"""Number of steps with a hand off its target after which the body starts to move."""

_NUMBERED: Final = tuple(enumerate(JOINTS))


class DeadZoneHolding(SoftHolding):
    """A person whose trunk and legs stay until the object is far from where they came to rest."""

    def __init__(
        self, person: SoftBody, posture: np.ndarray, senses: Senses, seed: int = 0
    ) -> None:
        """Hold the object, with the body at rest."""
        super().__init__(person, posture, senses, seed)
        self._settled_at, self._awake, self._in_vain = self.pose, False, 0
        arms = [number < 20 and joint.startswith(person.work.hands) for number, joint in _NUMBERED]
        self._arms = np.concatenate([np.zeros(BASE, dtype=bool), arms])

    def mobile(self) -> np.ndarray:
        """Return which entries of the placement may move now (36,) bool."""
        return super().mobile() if self._awake else self._arms

    def advance(self, target: np.ndarray, dt: float, besides: list[Wish] | None = None) -> float:
        """Take one step; the body moves for an object far from where the body came to rest."""
        error = pose_error(self._settled_at, target)
        far = np.linalg.norm(error[:3]) > SHIFT or np.linalg.norm(error[3:]) > TURN
        # If the arm alone does not reach the object in a few steps, the body moves too.
        self._in_vain = self._in_vain + 1 if self._miss > REACHED else 0
        self._awake = bool(self._awake or far or self._in_vain > _MISSES)
        change = super().advance(target, dt, besides)
        if self._awake and change < _SETTLED * dt:
            self._settled_at, self._awake = target, False
        return change


class DeadZonePerson(SoftPerson):
    """Follows the object with the arm, and with the body from time to time."""

    kind: ClassVar[str] = "dead_zone"
    manner: ClassVar[str] = "who follows small changes with the arm alone"
    holding: ClassVar[type[SoftHolding]] = DeadZoneHolding


draw = DeadZonePerson.drawn
