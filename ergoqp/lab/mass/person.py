"""People with mass: how they are drawn, take hold of the object, stand, and fall."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Final, Self

import mujoco
import numpy as np

from ergoqp.human import Body
from ergoqp.joints import JOINTS, LOWER, SIDES, UPPER
from ergoqp.lab.mass.body import (
    HABITS,
    PERSON_DOFS,
    ROBOT_GROUP,
    SOFT_ROBOT,
    SOFT_ROBOT_DECLARED,
    build,
    per_joint,
)
from ergoqp.lab.mass.control import (
    Control,
    Grasp,
    Support,
    contact_in,
    flat,
    reported,
    site_pose,
    upright,
)
from ergoqp.lab.mass.planner import PERSON_QPOS, Planner, Wishes
from ergoqp.lab.people.habits import AXIS, Sex, Work, draw_body, draw_habits, generators
from ergoqp.problem.geometry import between, pose_error
from ergoqp.problem.problem import Problem
from ergoqp.problem.settings import DeclaredRobot
from ergoqp.rest.person_protocol import LET_GO, Holding, Person, SensorModel, draw_senses

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


class MassHolding(Holding["Mass"]):
    """A person with mass who holds the object, and the robot that holds it too.

    Args:
        person: who takes hold of the object.
        qpos: pelvis and joints at that time (39,).
        soles: where they stand (4, 4) each [m]; None: they hang.
        senses: the delay of the person.

    Attributes:
        held_drift: largest displacement of a hand during the first 20 s of holding still [m].
        data: data of the simulation, for inspection.
    """

    def __init__(
        self,
        person: Mass,
        qpos: np.ndarray,
        soles: list[np.ndarray] | None,
        senses: SensorModel,
    ) -> None:
        """Take hold of the object, and hold it still for `STILL` seconds."""
        self.person, self.senses = person, senses
        self._hands, self._seated = person.traits.wishes.hands, person.traits.wishes.seated
        self.model = copy(person.model)
        self.data = data = mujoco.MjData(self.model)
        self._pelvis = int(self.model.body("pelvis").id)
        data.qpos[:PERSON_QPOS] = qpos
        data.qpos[-4] = 1.0
        mujoco.mj_kinematics(self.model, data)
        self._asked = contact_in(data, person.traits.work)
        data.qpos[-7:-4] = self._asked[:3, 3]
        mujoco.mju_mat2Quat(data.qpos[-4:], self._asked[:3, :3].ravel())
        mujoco.mj_forward(self.model, data)
        self._grasp = Grasp(self.model, self._hands)
        self._grasp.take(data)
        mujoco.mj_forward(self.model, data)
        self._support = Support(self.model, self._seated, soles is not None)
        share, points = person.traits.compensation, self._grasp.points
        self._control = Control(person.planner, self._support, share, senses.delay, data, points)
        self._clock, self._stood = 0.0, None
        self.held_drift = self._hold_still()

    def _hold_still(self) -> float:
        """Hold still for that time, and return the largest displacement of a hand [m]."""
        hands = [self.model.site(f"{side}_grip").id for side in self._hands]
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
        return not self._seated and bool(away.max() > _TIPS)

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
        self.fallen = has_fallen(data, self._seated, self.person.pelvis_height)


_OWN_EFFORT: Final = (0.5, 2.0)
"""Range of the factor on every joint's effort, drawn log-uniformly per person and joint."""

_BALANCE: Final = (200.0, 600.0)
"""Least and largest cost of the distance of the centre of mass from the soles' middle [per m^2]."""


@dataclass(frozen=True)
class Traits:
    """The properties of a person with mass.

    Attributes:
        body: lengths and mass.
        sex: sex, for the shares of mass.
        wishes: the costs by which they choose a posture.
        senses: their delay and simple sensors.
        compensation: share of gravity that the muscles compensate, 0.9 to 1.
        work: how they hold the object.
    """

    body: Body
    sex: Sex
    wishes: Wishes
    senses: SensorModel
    compensation: float
    work: Work


REACHED: Final = 0.02
"""A point of a hand within this distance of where it should hold counts as reached [m]."""


@dataclass(frozen=True)
class Mass(Person):
    """A person with mass.

    Attributes:
        traits: properties of the person.
    """

    traits: Traits
    kind: ClassVar[str] = "mass"
    manner: ClassVar[str] = "who has mass, muscles that yield and a grip that may slip"

    def __getstate__(self) -> dict[str, Any]:
        """Pickle as the fields: the models are rebuilt in the other process."""
        return {"traits": self.traits}

    @property
    def body(self) -> Body:
        """Body of the person."""
        return self.traits.body

    @property
    def senses(self) -> SensorModel:
        """Delay of the person, and simple sensors."""
        return self.traits.senses

    @property
    def robot(self) -> DeclaredRobot:
        """Declaration of the impedance that holds the object together with the person."""
        return SOFT_ROBOT_DECLARED

    @property
    def comfort(self) -> np.ndarray:
        """Posture of the person with nothing to reach for (32,) [rad]."""
        return self.traits.wishes.comfort

    @property
    def footing(self) -> str:
        """What supports the person, as a clause for people."""
        if not self.traits.wishes.seated:
            return "the person stands on both soles by friction and balance alone"
        feet = "stand on" if self.feet else "hang above"
        return f"the pelvis rests on a seat, {self.seat:.2f} m high, and the feet {feet} the floor"

    @cached_property
    def seat(self) -> float:
        """Height of the hip centres above the floor when seated [m]."""
        return self.traits.work.seat_height or self._hips_above_soles

    @property
    def feet(self) -> bool:
        """Whether the soles reach the floor."""
        return not self.traits.wishes.seated or self.seat - self._hips_above_soles < REACHED

    @cached_property
    def _hips_above_soles(self) -> float:
        """Height of the hip centres over the soles in comfort [m]."""
        model = self._built(None)
        data = mujoco.MjData(model)
        data.qpos[3], data.qpos[7:PERSON_QPOS] = 1.0, self.comfort
        mujoco.mj_kinematics(model, data)
        return float(-min(data.site(f"{side}_sole").xpos[2] for side in SIDES))

    @cached_property
    def model(self) -> mujoco.MjModel:
        """The model of the person with object, robot and seat. Copy it before changing it."""
        return self._built(self.seat if self.traits.wishes.seated else None)

    def _built(self, seat: float | None) -> mujoco.MjModel:
        traits = self.traits
        axis = np.array(AXIS[traits.work.tool])
        return build(
            self.body, traits.sex, traits.wishes.hands, axis, traits.work.free_about_tool, seat
        )

    @cached_property
    def planner(self) -> Planner:
        """Computes the posture that the person wants."""
        return Planner(self.model, self.traits.wishes)

    def hold(
        self, posture: np.ndarray, senses: SensorModel | None = None, seed: int = 0
    ) -> MassHolding:
        """Return the person holding the object in a posture (32,) [rad].

        They have held it still for `ergoqp.lab.mass.person.STILL` seconds.
        """
        qpos, soles = self.stand(posture)
        return MassHolding(self, qpos, soles, senses or self.senses)

    @property
    def pelvis_height(self) -> float:
        """Height of the pelvis on its seat, or in standing upright [m]."""
        return self.seat if self.traits.wishes.seated else self._hips_above_soles

    def stand(self, posture: np.ndarray) -> tuple[np.ndarray, list[np.ndarray] | None]:
        """Return pelvis and joints (39,) in a posture, and where the soles stand (4, 4) each.

        The soles are flat on the floor. If those of the posture are not, the legs change as
        little as possible. There are no soles if the feet hang.
        """
        qpos = np.zeros(PERSON_QPOS)
        qpos[3], qpos[7:] = 1.0, np.clip(posture, LOWER, UPPER)
        qpos[2] = self.seat if self.traits.wishes.seated else 0.0
        if not self.feet:
            return qpos, None
        soles = [site_pose(self.planner.look(qpos), f"{side}_sole") for side in SIDES]
        if not self.traits.wishes.seated:
            heading = upright(soles[0][:3, :3] + soles[1][:3, :3])
            middle = (soles[0][:3, 3] + soles[1][:3, 3]) / 2
            qpos[:3] = heading.T @ (qpos[:3] - middle)
            mujoco.mju_mat2Quat(qpos[3:7], heading.T.ravel())
            soles = [site_pose(self.planner.look(qpos), f"{side}_sole") for side in SIDES]
        soles = [flat(sole) for sole in soles]
        as_given = replace(self.traits.wishes, comfort=qpos[7:], balance=0.0)
        return Planner(self.model, as_given).settle(qpos, None, soles, steps=30).qpos, soles

    def reach(self, pose: np.ndarray) -> tuple[np.ndarray, bool]:
        """Plan, from comfort and not simulated, the posture with the object at `pose` (4, 4)."""
        qpos, soles = self.stand(self.comfort)
        points = self.planner.held(qpos)
        contact = contact_in(self.planner.look(qpos), self.traits.work)
        local = (points - contact[:3, 3]) @ contact[:3, :3]
        there = pose[:3, 3] + local @ pose[:3, :3].T
        plan = self.planner.settle(qpos, there, soles)
        qpos = plan.qpos
        reached = plan.arrived and self.planner.misses(qpos, there) < REACHED
        data = self.planner.look(qpos)
        if soles is not None:
            have = np.array([data.site(f"{side}_sole").xpos for side in SIDES])
            off = np.linalg.norm(have - [sole[:3, 3] for sole in soles], axis=1).max()
            reached = reached and bool(off < REACHED)
        return reported(data.body("pelvis").xmat.reshape(3, 3), qpos[7:]), reached


def draw(problem: Problem, seed: int, body: Body | None = None) -> Mass:
    """Return a random person with mass for a problem. The same seed gives the same person.

    Body, comfort and senses are drawn as for all kinds. The effort of every joint, the cost of
    imbalance and the share of gravity that the muscles compensate are drawn for this kind.

    Args:
        problem: only the description of the task by its response is used: hands, stance, tool
            and seat.
        seed: seed of the person.
        body: body of the person; None: it is drawn.

    Raises:
        InputError: if the response of the problem does not describe the task.
    """
    bodies, habits, senses = generators(Mass.kind, problem.name, seed)
    work = Work.of(problem)
    sex, drawn = draw_body(bodies)
    comfort = draw_habits(work, habits).comfort
    low, high = np.log(_OWN_EFFORT)
    factors = np.exp(habits.uniform(low, high, len(JOINTS)))
    wishes = Wishes(
        comfort=comfort,
        efforts=per_joint("effort") * factors,
        balance=float(habits.uniform(*_BALANCE)),
        hands=work.hands,
        seated=work.stance == "seated",
    )
    traits = Traits(
        body=body or drawn,
        sex=sex,
        wishes=wishes,
        senses=draw_senses(senses),
        compensation=float(habits.uniform(0.9, 1.0)),
        work=work,
    )
    return Mass(traits)
