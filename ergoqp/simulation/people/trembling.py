"""`trembling`: arms that shake, sensors that read wrong and lose frames."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar, Final

import numpy as np

from ergoqp.human import Body
from ergoqp.joints import JOINTS
from ergoqp.problem.problem import Problem
from ergoqp.simulation.people.anatomy import draw_body
from ergoqp.simulation.people.body_tasks import BASE
from ergoqp.simulation.people.grasp import Work
from ergoqp.simulation.people.habits import draw_habits
from ergoqp.simulation.people.senses import Senses
from ergoqp.simulation.people.soft_holding import SoftHolding
from ergoqp.simulation.people.soft_person import SoftPerson, draw_senses

TREMOR: Final = (float(np.radians(0.3)), float(np.radians(1.2)))
"""Least and largest amplitude of a joint's tremor [rad]."""

FREQUENCY: Final = (4.0, 8.0)
"""Of a tremor [Hz]."""

BIAS_DEG: Final = (4.0, 8.0)
"""Standard deviation of the error with which a joint reads all the time, and the most [deg]."""

LOST: Final = 0.05
"""Share of frames that do not arrive."""


class TremblingHolding(SoftHolding):
    """A person whose arms shake while they work; at rest, in judgement, they are held still."""

    def __init__(
        self, person: SoftPerson, posture: np.ndarray, senses: Senses, seed: int = 0
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
        """The person's true posture now (32,) [rad]."""
        steady = self.placement[BASE:]
        if not self._shakes:
            return steady.copy()
        turns = 2 * np.pi * self._frequency * self.time + self._phase
        return steady + self._amplitude * np.sin(turns)

    def follow(self, pose: np.ndarray, dt: float) -> None:
        """Follow, shaking."""
        self._shakes = True
        super().follow(pose, dt)

    def rest(self, pose: np.ndarray) -> bool:
        """Come to rest without a tremor."""
        self._shakes = False
        return super().rest(pose)


class TremblingPerson(SoftPerson):
    """Follows, shaking, and is seen badly."""

    kind: ClassVar[str] = "trembling"
    manner: ClassVar[str] = "whose arms shake, and whose angles read wrong"
    holding: ClassVar[type[SoftHolding]] = TremblingHolding


def draw(problem: Problem, seed: int, body: Body | None = None) -> TremblingPerson:
    """Return a person who trembles for a problem, the same for the same seed."""
    rng, work = np.random.default_rng([seed, 27]), Work.of(problem)
    habits, body = draw_habits(work, rng), body or draw_body(rng)
    sd, most = BIAS_DEG
    bias = np.clip(rng.normal(0.0, sd, len(JOINTS)), -most, most)
    biased = dict(zip(JOINTS, bias.tolist(), strict=True))
    senses = replace(draw_senses(rng), lost=LOST, bias_deg=biased)
    return TremblingPerson(body, work, habits, senses)
