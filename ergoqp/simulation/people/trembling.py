"""`trembling`: arms that shake, and sensors with errors and lost frames."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar, Final

import numpy as np

from ergoqp.joints import JOINTS
from ergoqp.simulation.people.body_tasks import BASE
from ergoqp.simulation.people.senses import Senses
from ergoqp.simulation.people.soft_body import SoftBody
from ergoqp.simulation.people.soft_holding import SoftHolding
from ergoqp.simulation.people.soft_person import SoftPerson

TREMOR: Final = (float(np.radians(0.3)), float(np.radians(1.2)))
"""Least and largest amplitude of a joint's tremor [rad]."""

FREQUENCY: Final = (4.0, 8.0)
"""Least and largest frequency of a tremor [Hz]."""

BIAS_DEG: Final = (4.0, 8.0)
"""Standard deviation and largest value of the constant error of each joint's angle [deg]."""

LOST: Final = 0.05
"""Share of frames that do not arrive."""


class TremblingHolding(SoftHolding):
    """A person whose arms shake while they work. At rest, for the judgement, they do not shake."""

    def __init__(
        self, person: SoftBody, posture: np.ndarray, senses: Senses, seed: int = 0
    ) -> None:
        """Hold the object."""
        super().__init__(person, posture, senses, seed)
        rng = np.random.default_rng([seed, 32])
        arms = np.array([joint.startswith(("right", "left")) for joint in JOINTS[:20]])
        self._amplitude = np.append(rng.uniform(*TREMOR, 20) * arms, np.zeros(12))
        self._frequency, self._phase = rng.uniform(*FREQUENCY, 32), rng.uniform(0, 2 * np.pi, 32)
        self._shakes = False

    @property
    def posture(self) -> np.ndarray:
        """True posture of the person now (32,) [rad]."""
        steady = self.placement[BASE:]
        if not self._shakes:
            return steady.copy()
        turns = 2 * np.pi * self._frequency * self.time + self._phase
        return steady + self._amplitude * np.sin(turns)

    def follow(self, pose: np.ndarray, dt: float) -> None:
        """Follow the object with a tremor."""
        self._shakes = True
        super().follow(pose, dt)

    def rest(self, pose: np.ndarray) -> bool:
        """Come to rest without a tremor."""
        self._shakes = False
        return super().rest(pose)


class TremblingPerson(SoftPerson):
    """Follows the object with a tremor, and is measured badly."""

    kind: ClassVar[str] = "trembling"
    manner: ClassVar[str] = "whose arms shake, and whose angles read wrong"
    holding: ClassVar[type[SoftHolding]] = TremblingHolding

    @classmethod
    def senses_of(cls, senses: Senses, rng: np.random.Generator) -> Senses:
        """Return the senses of these people: constant errors of all joints, and lost frames."""
        sd, most = BIAS_DEG
        bias = np.round(np.clip(rng.normal(0.0, sd, len(JOINTS)), -most, most), 1)
        return replace(senses, lost=LOST, bias_deg=dict(zip(JOINTS, bias.tolist(), strict=True)))


draw = TremblingPerson.drawn
