"""A person who weighs everything against everything: hands, feet, balance and ease."""

from __future__ import annotations

from functools import cached_property
from typing import ClassVar

import numpy as np

from ergoqp.human import Body
from ergoqp.joints import INDEX, JOINTS, SIDES
from ergoqp.simulation.people.body_tasks import BASE, BodyTasks
from ergoqp.simulation.people.grasp import Work
from ergoqp.simulation.people.habits import Habits
from ergoqp.simulation.people.person import Person
from ergoqp.simulation.people.senses import Senses
from ergoqp.simulation.people.soft_holding import SoftHolding

_PELVIS = np.full(BASE, 0.25)
"""How far the pelvis moves as readily as joints go by their spread [m], [rad]."""


class SoftPerson(Person):
    """A person by whole-body inverse kinematics with soft tasks.

    Args:
        body: lengths and mass.
        work: what the person does.
        habits: how they like to hold themselves.
        senses: what lies between them and the controller.

    Attributes:
        tasks: the body's kinematics, at one placement after another.
        grips: names of the sites that hold.
        stiffness: of ease, per entry of the placement (36,).
        damping: the same times the relaxation time [s].
        mobile: which entries may move (36,) bool.
        hanging: numbers of the joints of an arm that hangs.
    """

    kind: ClassVar[str]
    manner: ClassVar[str]
    holding: ClassVar[type[SoftHolding]] = SoftHolding
    """What people of the kind do from moment to moment."""

    def __init__(self, body: Body, work: Work, habits: Habits, senses: Senses) -> None:
        """Be this person."""
        self._body, self.work, self.habits, self._senses = body, work, habits, senses
        self.tasks = BodyTasks(body)
        self.grips = [f"{hand}_grip" for hand in work.hands]
        # 1/2 |q - comfort|^2 over spreads; the pelvis has no place of its own, only its damping.
        self.stiffness = np.concatenate([np.zeros(BASE), habits.spread**-2])
        self.damping = habits.relaxation * np.concatenate([_PELVIS**-2, habits.spread**-2])
        self.mobile = np.ones(BASE + len(JOINTS), dtype=bool)
        free_arms = set(SIDES) - set(work.hands)
        self.hanging = [INDEX[f"{side}_shoulder_flexion"] for side in sorted(free_arms)]
        if self.is_seated:
            self.mobile[:BASE] = self.mobile[BASE + 20 :] = False
            self.hanging = []

    @property
    def body(self) -> Body:
        """The person's body."""
        return self._body

    @property
    def comfort(self) -> np.ndarray:
        """Posture that the person takes with nothing to reach for (32,) [rad]."""
        return self.habits.comfort

    @property
    def senses(self) -> Senses:
        """What lies between the person and what the controller sees of them."""
        return self._senses

    @property
    def is_seated(self) -> bool:
        """Whether the person sits."""
        return self.work.stance == "seated"

    @cached_property
    def seat(self) -> float:
        """Height of the hip centres when seated [m]: as the problem says, or for their own legs."""
        given = self.work.seat_height
        return self.tasks.leg_height(self.comfort) if given is None else given

    @property
    def footing(self) -> str:
        """What carries the person, as a clause for people."""
        if self.is_seated:
            return f"the pelvis stays on its seat, {self.seat:.2f} m high"
        return "the soles stay where they stand"

    def placed(self, posture: np.ndarray) -> np.ndarray:
        """Return the placement (36,) of a posture (32,), see `BodyTasks`."""
        if self.is_seated:
            return self.tasks.seated(posture, self.seat)
        return self.tasks.standing(posture)

    def hold(self, posture: np.ndarray, senses: Senses | None = None, seed: int = 0) -> SoftHolding:
        """Return the person as they hold the object in a posture (32,) [rad], just now."""
        return self.holding(self, posture, senses or self.senses, seed)

    def reach(self, pose: np.ndarray) -> tuple[np.ndarray, bool]:
        """Return (posture at rest (32,) [rad], whether the object at `pose` is reached).

        The object is carried there straight from where comfort holds it.
        """
        held = self.hold(self.comfort)
        reached = held.carry(pose)
        return held.posture, reached

    def at(self, pose: np.ndarray, senses: Senses | None = None, seed: int = 0) -> SoftHolding:
        """Return the person at rest with the object at `pose` (4, 4), carried there from comfort.

        Whoever stepped on the way stands where they are then.
        """
        held = self.hold(self.comfort, senses, seed)
        held.carry(pose)
        return held


def draw_senses(rng: np.random.Generator) -> Senses:
    """Return how late a person follows, 0 to 300 ms, and what is seen of them."""
    return Senses(
        delay=float(rng.uniform(0.0, 0.3)),
        hand_time=float(rng.uniform(0.04, 0.12)),
        noise_deg=2.0,
        drift_deg=1.0,
        lost=0.01,
    )
