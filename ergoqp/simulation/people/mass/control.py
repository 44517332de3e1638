"""The control of a person with mass, from tick to tick: the plan and the commands to muscles."""

from __future__ import annotations

from collections import deque
from copy import copy
from typing import Final, Self

import mujoco
import numpy as np

from ergoqp.joints import JOINTS, SIDES
from ergoqp.simulation.people.mass.anatomy import PERSON_DOFS
from ergoqp.simulation.people.mass.angles import upright
from ergoqp.simulation.people.mass.balance import Support
from ergoqp.simulation.people.mass.contact_frame import site_pose
from ergoqp.simulation.people.mass.grasp import Grasp
from ergoqp.simulation.people.mass.plan import PERSON_QPOS, Plan
from ergoqp.simulation.people.mass.planner import Planner
from ergoqp.simulation.people.mass.table import HABITS, SOFT_ROBOT, per_joint

_STEPS: Final = 2
"""Steps of the planner in one update of the plan."""

_STIFFNESS: Final = per_joint("stiffness")
_DAMPING: Final = per_joint("damping")

_ARMS: Final = np.arange(6, 20)

_FOLLOWS: Final = np.array(
    [HABITS.arm_time if i in _ARMS else HABITS.body_time for i in range(len(JOINTS))]
)
"""Time constant with which every joint follows the planned posture (32,) [s]."""


class Control:
    """The plan and the commands of a person.

    Args:
        planner: computes the posture that the person wants.
        support: support of the person.
        compensation: share of gravity that the muscles compensate.
        delay: delay with which the person follows the object's motion [s].
        data: data of the simulation when the person takes hold.
        points: number of points at which the hands hold.
    """

    def __init__(
        self,
        planner: Planner,
        support: Support,
        compensation: float,
        delay: float,
        data: mujoco.MjData,
        points: int,
    ) -> None:
        """Start with the present posture as the wanted one."""
        self._planner, self._support, self._compensation = planner, support, compensation
        self._delay = round(delay / HABITS.plan_period)
        self.plan = Plan(data.qpos[:PERSON_QPOS].copy())
        self.wanted = self.plan.qpos[7:].copy()
        self._toward = self.wanted.copy()
        self._over = self._planned_over = support.centre(data)
        self._felt = self._lifts = np.zeros((points, 3))
        self._carried, self._ticks = 0.0, 0
        self._late: deque[np.ndarray] = deque()

    def copy(self) -> Self:
        """Return an independent copy of the state."""
        other = copy(self)
        other._late = self._late.copy()
        return other

    def command(self, data: mujoco.MjData, grasp: Grasp, alone: bool, dt: float) -> None:
        """Set the commands to the muscles.

        Args:
            data: kinematics and bias forces now; its controls are written.
            grasp: grasp of the object.
            alone: whether the person carries the object without the robot.
            dt: time until the next command [s].
        """
        if self._ticks % round(HABITS.plan_period / HABITS.tick) == 0:
            self._think(data, grasp, alone)
        self._ticks += 1
        change = (1.0 - np.exp(-dt / _FOLLOWS)) * (self._toward - self.wanted)
        self.wanted = self.wanted + change
        self._over = self._over + _share(dt, HABITS.body_time) * (self._planned_over - self._over)
        feel = _share(dt, HABITS.load_time)
        self._carried += feel * (alone - self._carried)
        self._felt = self._felt + feel * (grasp.forces(data) - self._felt)
        ready = np.zeros_like(self._felt)
        ready[:, 2] = -self._carried * SOFT_ROBOT.load * 9.81 / len(ready)
        felt = ready + HABITS.bracing * (self._felt - ready)
        loads = grasp.on_person(data, np.stack([ready, felt]))
        # A person who is pulled leans the other way, so that the pressure under the soles
        # stays in place.
        over = self._over - self._support.shift(data, loads[1])
        sway = HABITS.sway_stiffness * (over - self._support.centre(data))
        sway -= HABITS.sway_damping * self._support.speed(data)
        torque = self._support.torques(data, sway, ready=loads[0], felt=loads[1])
        # The rest angle of a muscle's spring is such that its torque at the wanted angle
        # carries the body. The damping acts only on motion that is not wanted.
        torque = self._compensation * torque + _DAMPING * change / dt
        data.ctrl[: PERSON_DOFS - 6] = self.wanted + torque / _STIFFNESS

    def _think(self, data: mujoco.MjData, grasp: Grasp, alone: bool) -> None:
        """Update the plan toward the object's pose before the person's delay.

        A person who carries it alone keeps it there, and lifts it by as much as it sinks.
        """
        places = grasp.places(data)
        if alone:
            self._lifts = self._lifts + _share(HABITS.plan_period, HABITS.lift_time) * (
                self._late[0] - places
            )
        else:
            self._late.append(places)
            while len(self._late) > self._delay + 1:
                self._late.popleft()
        soles = None
        if self._support.on_feet:
            soles = [_flat(site_pose(data, f"{side}_sole")) for side in SIDES]
        points = self._late[0] + self._lifts
        for _ in range(_STEPS):
            self.plan = self._planner.step(self.plan, points, soles)
        self._planned_over = self._support.centre(self._planner.look(self.plan.qpos))
        # The body takes time to get there. Meanwhile the arms compensate.
        now = data.qpos[:PERSON_QPOS].copy()
        now[7:][_ARMS] = self.wanted[_ARMS]
        self._toward = self.plan.qpos[7:].copy()
        # A hand feels at once where it is led, without the person's delay.
        felt = points if alone else places
        self._toward[_ARMS] = self._planner.arms(now, felt, self.plan)[_ARMS]


def _share(dt: float, time: float) -> float:
    """Return the share of a way that is done in `dt` with a time constant [s]."""
    return 1.0 - float(np.exp(-dt / time))


def _flat(sole: np.ndarray) -> np.ndarray:
    """Return where a sole stands (4, 4): level, and on the floor."""
    stands = np.eye(4)
    stands[:3, :3], stands[:2, 3] = upright(sole[:3, :3]), sole[:2, 3]
    return stands
