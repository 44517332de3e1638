"""`pushed`: is pushed by others from time to time, and comes back."""

from __future__ import annotations

from typing import ClassVar, Final

import numpy as np

from ergoqp.simulation.people.senses import Senses
from ergoqp.simulation.people.soft_body import SoftBody
from ergoqp.simulation.people.soft_holding import SoftHolding, Wish
from ergoqp.simulation.people.soft_person import SoftPerson

EVERY: Final = (3.0, 7.0)
"""Least and longest time between two pushes [s]."""

LASTS: Final = 0.4
"""Duration of a push [s]."""

AWAY: Final = (0.04, 0.08)
"""Distance by which a push moves the base of the neck, parallel to the floor [m]."""

_FIRMLY: Final = 0.01
"""Deviation with the same cost as a joint that moves by its spread [m]. A push is firm."""


class PushedHolding(SoftHolding):
    """A person who is pushed at the shoulders from time to time."""

    def __init__(
        self, person: SoftBody, posture: np.ndarray, senses: Senses, seed: int = 0
    ) -> None:
        """Hold the object, and plan the first push."""
        super().__init__(person, posture, senses, seed)
        self._pushes = 0
        self._plan(0.0)

    def disturbance(self) -> list[Wish]:
        """Return the target of a push for the base of the neck, as a wish."""
        if self.time < self._next:
            return []
        tasks = self.person.tasks
        tasks.place(self.placement)
        have, moves = tasks.frame("trunk")[:2, 3], tasks.jacobian("trunk")[:2]
        begin = self._from = have.copy() if self._from is None else self._from
        gone = (self.time - self._next) / LASTS
        if gone >= 1.0:
            self._plan(self.time)
            return []
        return [((begin + gone * self._way - have) / _FIRMLY, moves / _FIRMLY)]

    def _plan(self, now: float) -> None:
        """Draw the next push. It depends on the seed only, not on the controller."""
        rng = np.random.default_rng([self.seed, 31, self._pushes])
        heading, self._pushes = rng.uniform(0, 2 * np.pi), self._pushes + 1
        self._next = now + float(rng.uniform(*EVERY))
        self._way = float(rng.uniform(*AWAY)) * np.array([np.cos(heading), np.sin(heading)])
        self._from: np.ndarray | None = None


class PushedPerson(SoftPerson):
    """Follows the object between pushes."""

    kind: ClassVar[str] = "pushed"
    manner: ClassVar[str] = "who is pushed every few seconds"
    holding: ClassVar[type[SoftHolding]] = PushedHolding


draw = PushedPerson.drawn
