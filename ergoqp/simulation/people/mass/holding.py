"""A person with mass from moment to moment: the simulation, its muscles, and what is seen of it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Final, Self

import mujoco
import numpy as np

from ergoqp.joints import JOINTS
from ergoqp.simulation.people.mass.anatomy import PERSON_DOFS, ROBOT_GROUP
from ergoqp.simulation.people.mass.angles import reported, upright
from ergoqp.simulation.people.mass.balance import Support
from ergoqp.simulation.people.mass.contact_frame import contact_in, site_pose
from ergoqp.simulation.people.mass.grasp import Grasp
from ergoqp.simulation.people.mass.planner import PERSON_QPOS, Planner
from ergoqp.simulation.people.mass.table import HABITS, SOFT_ROBOT, per_joint
from ergoqp.simulation.people.person import LET_GO, Holding
from ergoqp.simulation.people.senses import Senses
from ergoqp.simulation.people.way import between, pose_error

STILL: Final = 20.0
"""For how long everybody holds still before it counts [s]."""

RESTS: Final = 6.0
"""Longest time that coming to rest is waited for [s]."""

CARRY_SPEED: Final = 0.15
CARRY_TURN: Final = 0.4
"""How fast an object is carried to a place [m/s], [rad/s]."""

_HELD: Final = 0.02
"""A hand within this distance of where it took the object holds it [m]."""

_AT_REST: Final = 0.02
"""Joint speeds below which a person is at rest [rad/s]."""

_LOWEST: Final = 0.45
"""Who stands has fallen when the pelvis is below this share of a leg's length above the soles ..."""

_TILTED: Final = np.cos(np.radians(80.0))
"""... or the pelvis is tilted further than this, or the head's top is within 0.25 m of the floor."""

_LOWEST_HEAD: Final = 0.25
_OFF_SEAT: Final = 0.10
"""Who sits has fallen when the pelvis is this far below its seat's height [m]."""

_STIFFNESS: Final = per_joint("stiffness")
_FOLLOWS: Final = np.array(
    [HABITS.arm_time if 6 <= i < 20 else HABITS.body_time for i in range(len(JOINTS))]
)
"""In what time every joint follows the planned posture (32,) [s]."""


@dataclass(frozen=True)
class Beginning:
    """Who takes hold of the object, and how they stand then.

    Attributes:
        model: of the person, the object and the robot; not changed.
        planner: which posture the person wants.
        hands: that hold.
        tool: axis of the tool in the hand.
        seated: whether the pelvis is on a seat.
        compensation: share of gravity that the muscles hold of themselves.
        qpos: pelvis and joints (39,).
        soles: where they stand (4, 4) each [m]; None: they hang.
    """

    model: mujoco.MjModel
    planner: Planner
    hands: tuple[str, ...]
    tool: str
    seated: bool
    compensation: float
    qpos: np.ndarray
    soles: list[np.ndarray] | None


class MassHolding(Holding):
    """A person with mass, the object in hand and the robot that holds it too.

    Args:
        beginning: who, and how they stand.
        senses: how late they follow.

    Attributes:
        held_drift: how far a hand went at most during the first 20 s of holding still [m].
        data: of the simulation, to be looked at.
    """

    def __init__(self, beginning: Beginning, senses: Senses) -> None:
        """Take hold of the object, and hold it still for `STILL` seconds."""
        self._is, self.senses = beginning, senses
        self.model = _copied(beginning.model)
        self.data = mujoco.MjData(self.model)
        self._pelvis = int(self.model.body("pelvis").id)
        self._support = Support(self.model, beginning.seated, beginning.soles is not None)
        self._grasp = Grasp(self.model, beginning.hands)
        data = self.data
        data.qpos[:PERSON_QPOS] = beginning.qpos
        data.qpos[-4] = 1.0
        mujoco.mj_kinematics(self.model, data)
        self._asked = contact_in(data, beginning.hands, beginning.tool)
        data.qpos[-7:-4] = self._asked[:3, 3]
        mujoco.mju_mat2Quat(data.qpos[-4:], self._asked[:3, :3].ravel())
        mujoco.mj_forward(self.model, data)
        self._grasp.take(data)
        self._leg = float(data.xpos[self._pelvis][2])
        self._plan = beginning.qpos.copy()
        self._wanted = self._plan[7:].copy()
        self._over = data.subtree_com[self._pelvis][:2].copy()
        self._plan_over = self._over.copy()
        self._carried = 0.0
        self._felt = np.zeros((len(self._grasp.points(data)), 3))
        self._late: deque[np.ndarray] = deque()
        self._clock, self._ticks = 0.0, 0
        self._begin_still()

    def _begin_still(self) -> None:
        hands = [f"{side}_grip" for side in self._is.hands]
        before = np.array([self.data.site(name).xpos for name in hands])
        drift = 0.0
        for _ in range(round(STILL / 0.05)):
            self.follow(self._asked, 0.05)
            now = np.array([self.data.site(name).xpos for name in hands])
            drift = max(drift, float(np.linalg.norm(now - before, axis=1).max()))
        self.held_drift = drift
        self.slipped = self._grasp.slipped = 0

    @property
    def base(self) -> np.ndarray:
        """Pelvis in the world, upright (4, 4) [m]."""
        pose = np.eye(4)
        pose[:3, :3] = upright(self.data.xmat[self._pelvis].reshape(3, 3))
        pose[:3, 3] = self.data.xpos[self._pelvis]
        return pose

    def follow(self, pose: np.ndarray, dt: float) -> None:
        """Live on for `dt` seconds while the robot takes the object to `pose` (4, 4) [m]."""
        before, begin = self._asked, self._clock
        self._clock += dt
        step = self.model.opt.timestep
        ticks = max(1, round(HABITS.tick / step))
        due = round((self._clock - self.data.time) / step)
        while due > 0:
            steps = min(ticks, due)
            now = self.data.time + steps * step
            share = min(1.0, (now - begin) / dt)
            self._live(between(before, pose, share) if share < 1.0 else pose, steps)
            due -= steps
        self._asked = pose.copy()
        self._see()

    def rest(self, pose: np.ndarray) -> bool:
        """Come to rest with the object at `pose` (4, 4), to which it is carried where it is not."""
        self._carry_toward(pose)
        quiet, begin = 0, self._clock
        while self._clock < begin + RESTS and quiet < 10 and not self.fallen:
            self.follow(pose, 0.05)
            speed = float(np.abs(self.data.qvel[6:PERSON_DOFS]).max())
            planned = float(np.abs(self._plan[7:] - self._wanted).max())
            quiet = quiet + 1 if speed < _AT_REST and planned < _AT_REST else 0
        return self.gap < _HELD and not self.fallen

    def carry(self, pose: np.ndarray) -> bool:
        """Follow the object straight to `pose` (4, 4), undisturbed, and come to rest there."""
        last, way = self.copy(), pose_error(self._asked, pose)
        if self._carry_toward(pose, last) and self.rest(pose):
            return True
        del way
        vars(self).update(vars(last))
        self.rest(self._asked)
        return False

    def copy(self) -> Self:
        """Return another who goes on from the same moment."""
        other = object.__new__(type(self))
        vars(other).update(vars(self))
        other.model = _copied(self.model)
        other.data = mujoco.MjData(other.model)
        mujoco.mj_copyData(other.data, other.model, self.data)
        other._grasp = self._grasp.copy(other.model)
        other._late = self._late.copy()
        return other

    def release(self) -> None:
        """Have the robot let go of the object: from now on the hands carry it alone."""
        self.model.opt.disableactuator |= 1 << ROBOT_GROUP

    def _live(self, pose: np.ndarray, steps: int) -> None:
        """Simulate some steps between two commands to the muscles."""
        data = self.data
        data.mocap_pos[0] = pose[:3, 3]
        mujoco.mju_mat2Quat(data.mocap_quat[0], pose[:3, :3].ravel())
        # The robot carries the object, so its springs are stretched by the weight alone.
        weight = SOFT_ROBOT.load * 9.81 / SOFT_ROBOT.stiffness
        data.ctrl[-6:-3] = pose[2, :3] * weight
        mujoco.mj_step1(self.model, data)
        self._command(steps * self.model.opt.timestep)
        mujoco.mj_step2(self.model, data)
        if steps > 1:
            mujoco.mj_step(self.model, data, nstep=steps - 1)
        self._grasp.slide(data)

    def _command(self, dt: float) -> None:
        """Tell the muscles where to pull to."""
        data, habits = self.data, HABITS
        if self._ticks % round(habits.plan_period / habits.tick) == 0:
            self._think()
        self._ticks += 1
        self._wanted += (1.0 - np.exp(-dt / _FOLLOWS)) * (self._plan[7:] - self._wanted)
        follow = 1.0 - float(np.exp(-dt / habits.body_time))
        self._over += follow * (self._plan_over - self._over)
        mujoco.mj_subtreeVel(self.model, data)
        sway = habits.sway_stiffness * (self._over - data.subtree_com[self._pelvis][:2])
        sway -= habits.sway_damping * data.subtree_linvel[self._pelvis][:2]
        feel = 1.0 - float(np.exp(-dt / habits.load_time))
        alone = bool(self.model.opt.disableactuator & 1 << ROBOT_GROUP)
        self._carried += feel * (alone - self._carried)
        self._felt += feel * (self._grasp.forces(data) - self._felt)
        ready = np.zeros_like(self._felt)
        ready[:, 2] = -self._carried * SOFT_ROBOT.load * 9.81 / len(ready)
        beyond = habits.bracing * (self._felt - ready)
        torque = self._support.torques(
            data,
            sway,
            self._grasp.on_person(data, ready),
            self._grasp.on_person(data, ready + beyond),
        )
        data.ctrl[: PERSON_DOFS - 6] = self._wanted + self._is.compensation * torque / _STIFFNESS

    def _think(self) -> None:
        """Move the plan a step on, toward where the object was before the person's delay."""
        data, delay = self.data, round(self.senses.delay / HABITS.plan_period)
        place = np.eye(4)
        place[:3, :3], place[:3, 3] = self._object()
        self._late.append(place)
        while len(self._late) > delay + 1:
            self._late.popleft()
        there = self._late[0]
        points = there[:3, 3] + self._grasp.points(data) @ there[:3, :3].T
        soles = None
        if self._is.soles is not None:
            soles = [_flat(site_pose(data, f"{side}_sole")) for side in ("right", "left")]
        for _ in range(2):
            self._plan, _ = self._is.planner.step(self._plan, points, soles)
        seen = self._is.planner.look(self._plan)
        self._plan_over = seen.subtree_com[self._pelvis][:2].copy()

    def _object(self) -> tuple[np.ndarray, np.ndarray]:
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, self.data.qpos[-4:])
        return turn.reshape(3, 3), self.data.qpos[-7:-4].copy()

    def _see(self) -> None:
        """Read off what others see of the person and the object."""
        data = self.data
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_comPos(self.model, data)
        turn = data.xmat[self._pelvis].reshape(3, 3)
        self.posture = reported(turn, data.qpos[7:PERSON_QPOS])
        self.pose = np.eye(4)
        self.pose[:3, :3], self.pose[:3, 3] = self._object()
        self.gap = self._grasp.gap(data)
        if self.gap > LET_GO:
            self._grasp.let_go()
        self.force = self._grasp.wrench(data)
        self.slipped = self._grasp.slipped
        self.unbalanced = not self._support.carries(data)
        self.fallen = self.fallen or self._is_down()

    def _is_down(self) -> bool:
        data = self.data
        height = float(data.xpos[self._pelvis][2])
        if self._is.seated:
            low = height < self._leg - _OFF_SEAT
        else:
            low = height < _LOWEST * self._leg
        upward = float(data.xmat[self._pelvis][8])
        return low or upward < _TILTED or float(data.site("head_top").xpos[2]) < _LOWEST_HEAD

    def _carry_toward(self, pose: np.ndarray, last: MassHolding | None = None) -> bool:
        """Have the object carried straight to a pose; keep in `last` where it was still held."""
        way = pose_error(self._asked, pose)
        seconds = max(
            float(np.linalg.norm(way[:3])) / CARRY_SPEED,
            float(np.linalg.norm(way[3:])) / CARRY_TURN,
        )
        begin, parts = self._asked, int(np.ceil(seconds / 0.05))
        for part in range(1, parts + 1):
            self.follow(between(begin, pose, part / parts), 0.05)
            if self.gap > _HELD or self.fallen:
                return False
            if last is not None and part % 4 == 0:
                vars(last).update(vars(self.copy()))
        return True


def _copied(model: mujoco.MjModel) -> mujoco.MjModel:
    from copy import copy

    return copy(model)


def _flat(sole: np.ndarray) -> np.ndarray:
    """Return where a sole stands (4, 4): level, on the floor."""
    stands = np.eye(4)
    stands[:3, :3], stands[:2, 3] = upright(sole[:3, :3]), sole[:2, 3]
    return stands
