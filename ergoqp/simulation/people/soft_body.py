"""What there is of a person with soft tasks: body, work, habits, and how they stand."""

from __future__ import annotations

import math
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

SOLES = tuple(f"{side}_sole" for side in SIDES)

SOLE = np.repeat([3e-4, 3e-3], 3)
"""How far a sole strays as readily as joints go by their spread [m], [rad]."""

_PELVIS = np.full(BASE, 0.25)
"""How far the pelvis moves as readily as joints go by their spread [m], [rad]."""


_STANDS = 40
"""Steps in which the legs bring the soles down flat."""


class SoftBody(Person):
    """What there is of a person with soft tasks: body, work, habits and how they stand.

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

    def placed(self, posture: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
        """Return the placement (36,) of a posture (32,), and its soles (4, 4) each.

        Standing, the soles are flat on the floor; where the posture's are not, the legs are as near
        to it as that allows. Seated, the seat is as high as the problem says, or as the legs need.
        """
        tasks = self.tasks
        if self.is_seated:
            given = self.work.seat_height
            seat = tasks.leg_height(posture) if given is None else given
            placement = tasks.seated(posture, seat)
            return placement, [tasks.frame(name) for name in SOLES]
        placement = tasks.standing(posture)
        soles = [_flat(tasks.frame(name)) for name in SOLES]
        legs = np.ones(BASE + len(JOINTS), dtype=bool)
        legs[BASE : BASE + 20] = False
        wanted = placement.copy()
        for _ in range(_STANDS):
            tasks.place(placement)
            hessian, pull = np.diag(self.stiffness), self.stiffness * (wanted - placement)
            hessian[range(BASE), range(BASE)] += 1.0
            for name, sole in zip(SOLES, soles, strict=True):
                error, moves = tasks.toward(name, sole)
                moves /= SOLE[:, None]
                hessian += moves.T @ moves
                pull += (error / SOLE) @ moves
            step = tasks.step_within(placement, hessian, pull, legs)
            placement = placement + step * min(1.0, 0.2 / max(1e-12, float(np.abs(step).max())))
        tasks.place(placement)
        return placement, soles


def _flat(sole: np.ndarray) -> np.ndarray:
    """Return a sole's frame (4, 4) turned level and brought to the floor."""
    flat, yaw = np.eye(4), math.atan2(sole[1, 0], sole[0, 0])
    flat[:2, :2] = [[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]]
    flat[:2, 3] = sole[:2, 3]
    return flat
