"""People with mass: how they are drawn, and how they take hold of the object."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Final

import mujoco
import numpy as np

from ergoqp.human import Body
from ergoqp.joints import JOINTS, LOWER, SIDES, UPPER
from ergoqp.lab.mass.body import SOFT_ROBOT_DECLARED, build, per_joint
from ergoqp.lab.mass.control import contact_in, reported, site_pose, upright
from ergoqp.lab.mass.holding import Beginning, MassHolding
from ergoqp.lab.mass.planner import PERSON_QPOS, Planner, Wishes
from ergoqp.lab.people.body_tasks import AXIS, Work
from ergoqp.lab.people.habits import Sex, draw_body, draw_habits, generators
from ergoqp.problem.problem import Problem
from ergoqp.problem.settings import DeclaredRobot
from ergoqp.rest.person import Person, Senses, draw_senses

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
    senses: Senses
    compensation: float
    work: Work


def draw_traits(kind: str, problem: Problem, seed: int, body: Body | None = None) -> Traits:
    """Return a random person for a problem. The same seed gives the same person.

    Body, comfort and senses are drawn as for all kinds. The effort of every joint, the cost of
    imbalance and the share of gravity that the muscles compensate are drawn for this kind.

    Args:
        kind: name of the kind.
        problem: the problem; only its work is used.
        seed: seed of the person.
        body: body of the person; None: it is drawn.

    Raises:
        InputError: if the problem does not describe how the object is held.
    """
    bodies, habits, senses = generators(kind, problem.name, seed)
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
    return Traits(
        body=body or drawn,
        sex=sex,
        wishes=wishes,
        senses=draw_senses(senses),
        compensation=float(habits.uniform(0.9, 1.0)),
        work=work,
    )


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
    def senses(self) -> Senses:
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

    def hold(self, posture: np.ndarray, senses: Senses | None = None, seed: int = 0) -> MassHolding:
        """Return the person holding the object in a posture (32,) [rad].

        They have held it still for `ergoqp.lab.mass.holding.STILL` seconds.
        """
        qpos, soles = self.stand(posture)
        return MassHolding(
            Beginning(
                person=self,
                model=self.model,
                planner=self.planner,
                hands=self.traits.wishes.hands,
                tool=self.traits.work.tool,
                seated=self.traits.wishes.seated,
                compensation=self.traits.compensation,
                qpos=qpos,
                soles=soles,
                height=self.seat if self.traits.wishes.seated else self._hips_above_soles,
            ),
            senses or self.senses,
        )

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
        flat = []
        for sole in soles:
            stands = np.eye(4)
            stands[:3, :3], stands[:2, 3] = upright(sole[:3, :3]), sole[:2, 3]
            flat.append(stands)
        as_given = replace(self.traits.wishes, comfort=qpos[7:], balance=0.0)
        return Planner(self.model, as_given).settle(qpos, None, flat, steps=30).qpos, flat

    def reach(self, pose: np.ndarray) -> tuple[np.ndarray, bool]:
        """Plan, from comfort and not simulated, the posture with the object at `pose` (4, 4)."""
        qpos, soles = self.stand(self.comfort)
        points = self.planner.held(qpos)
        contact = contact_in(
            self.planner.look(qpos), self.traits.wishes.hands, self.traits.work.tool
        )
        local = (points - contact[:3, 3]) @ contact[:3, :3]
        there = pose[:3, 3] + local @ pose[:3, :3].T
        plan = self.planner.settle(qpos, there, soles)
        qpos = plan.qpos
        reached = plan.arrived and self.planner.misses(qpos, there) < REACHED
        data = self.planner.look(qpos)
        if soles is not None:
            off = max(
                float(np.linalg.norm(site_pose(data, f"{side}_sole")[:3, 3] - sole[:3, 3]))
                for side, sole in zip(SIDES, soles, strict=True)
            )
            reached = reached and off < REACHED
        return reported(data.body("pelvis").xmat.reshape(3, 3), qpos[7:]), reached


def draw(problem: Problem, seed: int, body: Body | None = None) -> Mass:
    """Return a person with mass for a problem. The same seed gives the same person.

    Args:
        problem: only the description of the task by its response is used: hands, stance, tool
            and seat.
        seed: seed of the person.
        body: body of the person; None: it is drawn.

    Raises:
        InputError: if the response of the problem does not describe the task.
    """
    return Mass(draw_traits(Mass.kind, problem, seed, body))
