"""The constant parts of a person with soft tasks: body, work, habits, and how they stand."""

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
"""Displacement of a sole with the same cost as a joint that moves by its spread [m], [rad]."""

_PELVIS = np.full(BASE, 0.25)
"""Displacement of the pelvis with the same cost as a joint that moves by its spread [m], [rad]."""


_STANDS = 40
"""Number of steps in which the legs put the soles flat on the floor."""


class SoftBody(Person):
    """The constant parts of a person with soft tasks: body, work, habits, and how they stand.

    Args:
        body: lengths and mass.
        work: how the person works on the object.
        habits: preferred posture and stiffness.
        senses: sensors between the person and the controller.

    Attributes:
        tasks: kinematics of the body at a placement.
        grips: names of the sites that hold the object.
        stiffness: stiffness toward ease, per entry of the placement (36,).
        damping: stiffness times the relaxation time [s].
        mobile: entries that may move (36,) bool.
        hanging: numbers of the joints of a hanging arm.
    """

    kind: ClassVar[str]
    manner: ClassVar[str]

    def __init__(self, body: Body, work: Work, habits: Habits, senses: Senses) -> None:
        """Store the parts, and compute stiffness and damping."""
        self._body, self.work, self.habits, self._senses = body, work, habits, senses
        self.tasks = BodyTasks(body)
        self.grips = [f"{hand}_grip" for hand in work.hands]
        # 1/2 |q - comfort|^2 over spreads. The pelvis has no preferred place, only damping.
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
        """Body of the person."""
        return self._body

    @property
    def comfort(self) -> np.ndarray:
        """Posture of the person with nothing to reach for (32,) [rad]."""
        return self.habits.comfort

    @property
    def senses(self) -> Senses:
        """Sensors between the person and the controller."""
        return self._senses

    @property
    def is_seated(self) -> bool:
        """Whether the person sits."""
        return self.work.stance == "seated"

    @cached_property
    def seat(self) -> float:
        """Height of the hip centres when seated [m]: the problem's, or else that of the legs."""
        given = self.work.seat_height
        return self.tasks.leg_height(self.comfort) if given is None else given

    @property
    def footing(self) -> str:
        """What supports the person, as a clause for people."""
        if self.is_seated:
            return f"the pelvis stays on its seat, {self.seat:.2f} m high"
        return "the soles stay where they stand"

    def placed(self, posture: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
        """Return the placement (36,) of a posture (32,), and the soles (4, 4) each.

        When standing, the soles are flat on the floor. If those of the posture are not, the
        legs change as little as possible. When seated, the seat has the height of the problem,
        or the height that the legs need.
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
    """Return the frame (4, 4) of a sole, levelled and moved to the floor."""
    flat, yaw = np.eye(4), math.atan2(sole[1, 0], sole[0, 0])
    flat[:2, :2] = [[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]]
    flat[:2, 3] = sole[:2, 3]
    return flat
