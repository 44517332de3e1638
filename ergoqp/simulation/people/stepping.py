"""`stepping`: leans toward an object that is away, and steps after one that is far."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar, Final

import numpy as np

from ergoqp.joints import INDEX
from ergoqp.simulation.people.grasp import Work
from ergoqp.simulation.people.habits import Habits
from ergoqp.simulation.people.senses import Senses
from ergoqp.simulation.people.soft_body import SoftBody
from ergoqp.simulation.people.soft_holding import SoftHolding, Wish
from ergoqp.simulation.people.soft_person import SoftPerson

STEP: Final = 0.20
"""Distance of the object from its place at ease beyond which the person steps after it [m]."""

FARTHEST: Final = 0.60
"""Largest distance of the person from where they began [m], because the robot is there."""

_SWING: Final = 0.5
"""Time in which one foot is moved [s]; then the other."""

_LIFT: Final = 0.05
"""Height to which a foot is lifted [m]."""

_HESITATES: Final = 0.4
"""Time for which the object is away before the person steps [s]."""

_PART: Final = 0.1
"""Longest time step in which a foot moves [s]."""

_LONGEST_WAY: Final = 100
"""Number of such steps after which every foot has arrived."""

_LEANS: Final = {"trunk_flexion": 1.6, "trunk_side_bend": 1.6, "knee_flexion": 0.6}
"""Factors on the spread of joints: the trunk leans before the knees bend."""


class SteppingHolding(SoftHolding):
    """A person whose feet follow the object."""

    def __init__(
        self, person: SoftBody, posture: np.ndarray, senses: Senses, seed: int = 0
    ) -> None:
        """Hold the object with both feet on the floor. Its place at ease is relative to them."""
        super().__init__(person, posture, senses, seed)
        own = SoftHolding(person, person.comfort, senses)
        self._at_ease = own.pose[:2, 3]
        self.feet = np.zeros(2)
        self._home = [sole.copy() for sole in self.soles]
        self._seat = self.placement[:2].copy()
        self._away, self._swing, self._way = 0.0, np.inf, np.zeros(2)
        person.tasks.place(self.placement)

    def advance(self, target: np.ndarray, dt: float, besides: list[Wish] | None = None) -> float:
        """Take one step of time. The feet follow an object that is away for long."""
        while dt > _PART and np.isfinite(self._swing):
            # A foot moves in parts, however long a step of time is.
            self._advance(target, _PART, besides)
            dt -= _PART
        return self._advance(target, dt, besides)

    def _advance(self, target: np.ndarray, dt: float, besides: list[Wish] | None) -> float:
        if np.isfinite(self._swing):
            self._put_feet(dt)
        else:
            away = target[:2, 3] - self._at_ease - self.feet
            distance = float(np.linalg.norm(away))
            self._away = self._away + dt if distance > STEP else 0.0
            way = away * (STEP / max(distance, STEP))
            if self._away > _HESITATES and np.linalg.norm(self.feet + way) <= FARTHEST:
                self._way, self._swing, self._away = way, 0.0, 0.0
        return super().advance(target, dt, besides)

    def rest(self, pose: np.ndarray) -> bool:
        """Come to rest, with the feet first."""
        self._arrive(pose)
        for _ in range(_LONGEST_WAY):
            self.advance(pose, _PART)
            if np.isinf(self._swing) and self._away == 0.0:
                break
        return super().rest(pose)

    def _put_feet(self, dt: float) -> None:
        """Move one foot, then the other. A stool rolls with both."""
        self._swing += dt
        gone = [np.clip(self._swing / _SWING - number, 0.0, 1.0) for number in range(2)]
        if self._swing >= 2 * _SWING:
            self.feet, self._way, self._swing = self.feet + self._way, np.zeros(2), np.inf
        smooth = [share * share * (3 - 2 * share) for share in gone]
        if self.person.is_seated:
            # Copies share this array, so make a new one.
            placement = self.placement.copy()
            placement[:2] = self._seat + self.feet + np.mean(smooth) * self._way
            self.placement = placement
            return
        self.soles = [sole.copy() for sole in self._home]
        for sole, share, part in zip(self.soles, smooth, gone, strict=True):
            sole[:2, 3] += self.feet + share * self._way
            sole[2, 3] += _LIFT * np.sin(np.pi * part)


class SteppingPerson(SoftPerson):
    """Follows the object with the feet too."""

    kind: ClassVar[str] = "stepping"
    manner: ClassVar[str] = "who leans toward the object and steps after it"
    holding: ClassVar[type[SoftHolding]] = SteppingHolding

    @classmethod
    def habits_of(cls, habits: Habits, work: Work, rng: np.random.Generator) -> Habits:
        """Return the habits of these people: they lean."""
        spread = habits.spread.copy()
        for joint, number in INDEX.items():
            spread[number] *= next((by for name, by in _LEANS.items() if joint.endswith(name)), 1.0)
        return replace(habits, spread=spread)

    @property
    def footing(self) -> str:
        """What supports the person, as a clause for people."""
        if self.is_seated:
            return f"the pelvis stays on a stool that rolls, {self.seat:.2f} m high"
        return f"the soles step after an object more than {100 * STEP:.0f} cm away"


draw = SteppingPerson.drawn
