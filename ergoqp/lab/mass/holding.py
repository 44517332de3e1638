"""The state of a person with mass: the simulation, what is measured of it, and falls."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import Final, Self

import mujoco
import numpy as np

from ergoqp.joints import SIDES
from ergoqp.lab.mass.body import HABITS, PERSON_DOFS, ROBOT_GROUP, SOFT_ROBOT
from ergoqp.lab.mass.control import Control, Grasp, Support, contact_in, reported, upright
from ergoqp.lab.mass.planner import PERSON_QPOS, Planner
from ergoqp.problem.geometry import between, pose_error
from ergoqp.rest.person import LET_GO, Holding, Person, Senses

_LOWEST: Final = 0.3
"""A standing person has fallen if the pelvis is below this share of its upright height.

It is deeper than anybody crouches on flat soles.
"""

_OFF_SEAT: Final = 0.10
"""A seated person has fallen if the pelvis is this far below the height of its seat [m]."""

_TILTED: Final = float(np.cos(np.radians(80.0)))
"""Anybody has fallen if the cosine of the tilt of the pelvis is below this."""

_LOWEST_HEAD: Final = 0.25
"""Anybody has fallen if the top of the head is below this height [m]."""


def has_fallen(data: mujoco.MjData, seated: bool, height: float) -> bool:
    """Return whether a person has fallen.

    Args:
        data: kinematics.
        seated: whether they sat.
        height: height of the pelvis on its seat, or in standing upright [m].
    """
    pelvis = data.body("pelvis")
    lowest = height - _OFF_SEAT if seated else _LOWEST * height
    return bool(
        pelvis.xpos[2] < lowest
        or pelvis.xmat[8] < _TILTED
        or data.site("head_top").xpos[2] < _LOWEST_HEAD
    )


STILL: Final = 20.0
"""Time for which every person first holds still, before anything counts [s]."""

RESTS: Final = 6.0
"""Longest time to wait for rest [s]."""

CARRY_SPEED: Final = 0.15
CARRY_TURN: Final = 0.4
"""Speeds at which an object is carried to a place [m/s], [rad/s]."""

_HELD: Final = 0.02
"""A hand within this distance of where it took hold of the object still holds it [m]."""

_TIPS: Final = 0.002
"""A sole further than this from where it stood is lifting off the floor, or sliding on it [m]."""

_AT_REST: Final = 0.02
"""Largest joint speed, and distance to the planned posture, of a person at rest [rad/s], [rad]."""

_CALM: Final = 10
"""Number of periods for which this must hold."""

_KEPT: Final = 4
"""Number of periods after which a place on the way counts as reached."""

_PERIOD: Final = 0.05
"""Period of the simulation while the person is not in a loop [s]."""


@dataclass(frozen=True)
class Beginning:
    """Who takes hold of the object, and how they stand at that time.

    Attributes:
        person: the person.
        model: model of the person, the object and the robot; not changed.
        planner: computes the posture that the person wants.
        hands: hands that hold.
        tool: axis of the tool in the hand.
        seated: whether the pelvis is on a seat.
        compensation: share of gravity that the muscles compensate.
        qpos: pelvis and joints (39,).
        soles: where they stand (4, 4) each [m]; None: they hang.
        height: height of the pelvis on its seat, or in standing upright [m].
    """

    person: Person
    model: mujoco.MjModel
    planner: Planner
    hands: tuple[str, ...]
    tool: str
    seated: bool
    compensation: float
    qpos: np.ndarray
    soles: list[np.ndarray] | None
    height: float


class MassHolding(Holding):
    """A person with mass who holds the object, and the robot that holds it too.

    Args:
        beginning: the person, and how they stand.
        senses: the delay of the person.

    Attributes:
        held_drift: largest displacement of a hand during the first 20 s of holding still [m].
        data: data of the simulation, for inspection.
    """

    def __init__(self, beginning: Beginning, senses: Senses) -> None:
        """Take hold of the object, and hold it still for `STILL` seconds."""
        self._is, self.senses = beginning, senses
        self.model = copy(beginning.model)
        self.data = data = mujoco.MjData(self.model)
        self._pelvis = int(self.model.body("pelvis").id)
        data.qpos[:PERSON_QPOS] = beginning.qpos
        data.qpos[-4] = 1.0
        mujoco.mj_kinematics(self.model, data)
        self._asked = contact_in(data, beginning.hands, beginning.tool)
        data.qpos[-7:-4] = self._asked[:3, 3]
        mujoco.mju_mat2Quat(data.qpos[-4:], self._asked[:3, :3].ravel())
        mujoco.mj_forward(self.model, data)
        self._grasp = Grasp(self.model, beginning.hands)
        self._grasp.take(data)
        mujoco.mj_forward(self.model, data)
        self._support = Support(self.model, beginning.seated, beginning.soles is not None)
        self._control = Control(
            beginning.planner,
            self._support,
            beginning.compensation,
            senses.delay,
            data,
            self._grasp.points,
        )
        self._clock, self._stood = 0.0, None
        self.held_drift = self._hold_still()

    def _hold_still(self) -> float:
        """Hold still for that time, and return the largest displacement of a hand [m]."""
        hands = [self.model.site(f"{side}_grip").id for side in self._is.hands]
        before, drift = self.data.site_xpos[hands].copy(), 0.0
        for _ in range(round(STILL / _PERIOD)):
            self.follow(self._asked, _PERIOD)
            away = np.linalg.norm(self.data.site_xpos[hands] - before, axis=1)
            drift = max(drift, float(away.max()))
        self.count_from_here()
        return drift

    def count_from_here(self) -> None:
        """Reset the number of slips, and the sliding distance of the soles."""
        self.slipped, self.slid, self._grasp.slipped = 0, 0.0, 0
        self._stood = self._soles()

    def _soles(self) -> np.ndarray:
        """Return the positions of the soles (2, 3) [m]."""
        return np.array([self.data.site(f"{side}_sole").xpos for side in SIDES])

    @property
    def person(self) -> Person:
        """The person."""
        return self._is.person

    @property
    def posture(self) -> np.ndarray:
        """True posture of the person now (32,) [rad]."""
        return self._posture

    @property
    def base(self) -> np.ndarray:
        """Pelvis in the world, upright (4, 4) [m]."""
        pose = np.eye(4)
        pose[:3, :3] = upright(self.data.xmat[self._pelvis].reshape(3, 3))
        pose[:3, 3] = self.data.xpos[self._pelvis]
        return pose

    def follow(self, pose: np.ndarray, dt: float) -> None:
        """Advance by `dt` seconds, while the robot moves the object to `pose` (4, 4) [m].

        A person who has fallen is not simulated any further.
        """
        before, begin = self._asked, self._clock
        self._asked = pose.copy()
        if self.fallen:
            self.pose = pose.copy()
            return
        self._clock += dt
        step = self.model.opt.timestep
        due = round((self._clock - self.data.time) / step)
        while due > 0:
            steps = min(round(HABITS.tick / step), due)
            share = min(1.0, (self.data.time + steps * step - begin) / dt)
            self._live(between(before, pose, share) if share < 1.0 else pose, steps)
            due -= steps
        self._see()

    def rest(self, pose: np.ndarray) -> bool:
        """Come to rest with the object at `pose` (4, 4). It is carried there if it is elsewhere."""
        for part in self._way(pose):
            self.follow(part, _PERIOD)
        quiet, end = 0, self._clock + RESTS
        while self._clock < end and quiet < _CALM and not self.fallen:
            self.follow(pose, _PERIOD)
            speed = float(np.abs(self.data.qvel[6:PERSON_DOFS]).max())
            missing = float(np.abs(self._control.plan.qpos[7:] - self._control.wanted).max())
            quiet = quiet + 1 if max(speed, missing) < _AT_REST else 0
        return self.gap < _HELD and not self.fallen and not self.unbalanced

    def carry(self, pose: np.ndarray) -> bool:
        """Follow the object straight to `pose` (4, 4), undisturbed, and come to rest there.

        It goes only as far as the hand stays on the object and the soles on the floor. A
        person who would have to step does not go further.
        """
        last, stood = self.copy(), self._soles()
        for number, part in enumerate(self._way(pose)):
            self.follow(part, _PERIOD)
            if self.gap > _HELD or self.fallen or self._tips(stood):
                break
            if number % _KEPT == 0:
                last = self.copy()
        else:
            if self.rest(pose):
                return True
        vars(self).update(vars(last))
        self.rest(self._asked)
        return False

    def _tips(self, stood: np.ndarray) -> bool:
        """Return whether a standing person leaves the earlier positions of the soles (2, 3) [m]."""
        away = np.linalg.norm(self._soles() - stood, axis=1)
        return not self._is.seated and bool(away.max() > _TIPS)

    def copy(self) -> Self:
        """Return an independent copy of the state."""
        other = copy(self)
        other.model = copy(self.model)
        other.data = mujoco.MjData(other.model)
        mujoco.mj_copyData(other.data, other.model, self.data)
        other._grasp = self._grasp.copy(other.model)
        other._control = self._control.copy()
        return other

    def release(self) -> None:
        """Make the robot let go of the object. From now on the hands carry it alone."""
        self.model.opt.disableactuator |= 1 << ROBOT_GROUP

    def _way(self, pose: np.ndarray) -> list[np.ndarray]:
        """Return the poses of the straight path to a pose, a period apart."""
        way, begin = pose_error(self._asked, pose), self._asked
        shift, turn = float(np.linalg.norm(way[:3])), float(np.linalg.norm(way[3:]))
        parts = int(np.ceil(max(shift / CARRY_SPEED, turn / CARRY_TURN) / _PERIOD))
        return [between(begin, pose, part / parts) for part in range(1, parts + 1)]

    def _live(self, pose: np.ndarray, steps: int) -> None:
        """Simulate some steps between two commands to the muscles."""
        model, data = self.model, self.data
        data.mocap_pos[0] = pose[:3, 3]
        mujoco.mju_mat2Quat(data.mocap_quat[0], pose[:3, :3].ravel())
        # The robot carries the object, so it compensates the stretch of its springs by the
        # weight.
        data.ctrl[-6:-3] = pose[2, :3] * SOFT_ROBOT.load * 9.81 / SOFT_ROBOT.stiffness
        mujoco.mj_step1(model, data)
        alone = bool(model.opt.disableactuator & 1 << ROBOT_GROUP)
        self._control.command(data, self._grasp, alone, steps * model.opt.timestep)
        mujoco.mj_step2(model, data)
        if steps > 1:
            mujoco.mj_step(model, data, nstep=steps - 1)
        self._grasp.slide(data)

    def _see(self) -> None:
        """Update everything that others see of the person and the object."""
        data = self.data
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_comPos(self.model, data)
        self._posture = reported(data.xmat[self._pelvis].reshape(3, 3), data.qpos[7:PERSON_QPOS])
        held = data.body("object")
        self.pose = np.eye(4)
        self.pose[:3, :3], self.pose[:3, 3] = held.xmat.reshape(3, 3), held.xpos
        self.gap = self._grasp.gap(data)
        if self.gap > LET_GO:
            self._grasp.let_go()
        if self._stood is not None:
            away = np.linalg.norm(self._soles() - self._stood, axis=1)
            self.slid = max(self.slid, float(away.max()))
        self.force = self._grasp.wrench(data)
        self.slipped = self._grasp.slipped
        self.unbalanced = not self._support.carries(data)
        self.fallen = has_fallen(data, self._is.seated, self._is.height)
