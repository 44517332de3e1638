"""The control of a person with mass, from tick to tick: plan, support, and commands to muscles."""

from __future__ import annotations

from collections import deque
from copy import copy
from typing import Final, Self

import daqp
import mujoco
import numpy as np

from ergoqp.joints import INDEX, JOINTS, SIDES
from ergoqp.lab.mass.body import (
    FRICTION,
    HABITS,
    HAND_GROUP,
    ON_OBJECT,
    PERSON_DOFS,
    SOFT_ROBOT,
    cross,
    holding_points,
    per_joint,
)
from ergoqp.lab.mass.planner import PERSON_QPOS, Plan, Planner
from ergoqp.lab.people.habits import Work

# Columns of the joints that take up the tilt of a pelvis, and the signs of their axes relative
# to y, x, z.
_CARRIERS: Final = tuple(
    (np.array([INDEX[name] for name in names]), np.array(signs, dtype=float))
    for names, signs in (
        (("trunk_flexion", "trunk_side_bend", "trunk_twist"), (1, -1, 1)),
        (("right_hip_flexion", "right_hip_abduction", "right_hip_rotation"), (-1, -1, 1)),
        (("left_hip_flexion", "left_hip_abduction", "left_hip_rotation"), (-1, 1, -1)),
    )
)


def upright(rotation: np.ndarray) -> np.ndarray:
    """Return the upright frame (3, 3) with the heading of a pelvis (3, 3)."""
    x, y = rotation[0, 0], rotation[1, 0]
    if np.hypot(x, y) < 0.1:  # Face down or up: its left side gives the heading.
        x, y = rotation[1, 1], -rotation[0, 1]
    x, y = np.array([x, y]) / np.hypot(x, y)
    return np.array([[x, -y, 0.0], [y, x, 0.0], [0.0, 0.0, 1.0]])


def reported(rotation: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Return the posture (32,) with an upright pelvis and all other segments in the same pose.

    Args:
        rotation: rotation of the pelvis in the world (3, 3).
        angles: angles of the simulated hinges (32,) [rad].
    """
    tilt = upright(rotation).T @ rotation
    posture = angles.copy()
    for columns, signs in _CARRIERS:
        a, b, c = angles[columns] * signs
        r = tilt @ _turn(a, b, c)
        posture[columns] = signs * [
            np.arctan2(r[0, 2], r[2, 2]),
            np.arcsin(np.clip(-r[1, 2], -1.0, 1.0)),
            np.arctan2(r[1, 0], r[1, 1]),
        ]
    return posture


def _turn(a: float, b: float, c: float) -> np.ndarray:
    """Return the rotation (3, 3) by a about y, then b about its x, then c about its z [rad]."""
    ca, cb, cc = np.cos((a, b, c))
    sa, sb, sc = np.sin((a, b, c))
    return np.array(
        [
            [ca * cc + sa * sb * sc, -ca * sc + sa * sb * cc, sa * cb],
            [cb * sc, cb * cc, -sb],
            [-sa * cc + ca * sb * sc, sa * sc + ca * sb * cc, ca * cb],
        ]
    )


_EDGES: Final = np.array(
    [[x, y, 1.0] for x, y in HABITS.grip_used * FRICTION * np.vstack([np.eye(2), -np.eye(2)])]
)
"""Edges of a pyramid within the friction cone (4, 3). Every push is a sum of them."""

_SCALE: Final = np.array([1.0, 1.0, 10.0, 4.0, 4.0, 4.0])
"""Weights of the missing force and torque [1/m].

The weight of the body comes first. If not everything is possible, the trunk rather turns than
the centre of mass is given up.
"""

_SPREAD: Final = 1e-3
"""Cost of force itself: enough that all corners share, and too little to miss the wrench by 1 N."""


def shared(points: np.ndarray, wrench: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """Return the forces (k, 3) [N] at points whose sum is nearest to a wrench.

    No force pulls, and none needs more friction than there is. So if the wrench is not
    possible, the centre of pressure stays at the edge of the support.

    Args:
        points: points relative to the reference of the torque (k, 3) [m].
        wrench: wanted force and torque (6,) [N, N m].
        shares: relative share of each point (k,).
    """
    columns = np.empty((6, len(points), len(_EDGES)))
    columns[:3] = _EDGES.T[:, None]
    columns[3:] = np.moveaxis(cross(points[:, None], _EDGES), -1, 0)
    rows = columns.reshape(6, -1) * _SCALE[:, None]
    size = rows.shape[1]
    hessian = rows.T @ rows
    hessian[np.diag_indices(size)] += np.repeat(_SPREAD / shares, len(_EDGES))
    along = daqp.solve(
        hessian,
        -rows.T @ (_SCALE * wrench),
        np.zeros((0, size)),
        np.full(size, np.inf),
        np.zeros(size),
        np.zeros(size, dtype=np.int32),
    )[0]
    return along.reshape(-1, len(_EDGES)) @ _EDGES


_SEAT_SHARE: Final = 8.0
"""How much more a point of the seat carries than one of a sole."""

_MOST_ACCELERATION: Final = 2.0
"""Largest acceleration of the centre of mass that the person demands of the floor [m/s^2]."""


class Support:
    """The corners on which a person stands or sits, and the forces on them.

    Args:
        model: model of the person.
        seated: whether the pelvis is on a seat.
        feet: whether the soles reach the floor.

    Attributes:
        on_feet: whether the soles reach the floor.
        bodies: numbers of the supporting bodies.
    """

    def __init__(self, model: mujoco.MjModel, seated: bool, feet: bool) -> None:
        """Read the corners from the boxes of the model."""
        self._model, self._pelvis = model, int(model.body("pelvis").id)
        self.on_feet = feet
        self.bodies, self._corners, self._shares = [], [], []
        for side in SIDES if feet else ():
            heel, ball = _under(model, f"{side}_heel"), _under(model, f"{side}_ball")
            self.bodies.append(int(model.body(f"{side}_foot").id))
            self._corners.append(np.vstack([heel[:2], ball[2:], heel[2:], ball[:2]]))
            self._shares.append(1.0)
        if seated:
            self.bodies.append(self._pelvis)
            self._corners.append(_under(model, "buttocks"))
            self._shares.append(_SEAT_SHARE)

    def corners(self, data: mujoco.MjData) -> list[np.ndarray]:
        """Return the corners of every supporting body in the world (k, 3) [m], outer ones first."""
        return [
            data.xpos[body] + corners @ data.xmat[body].reshape(3, 3).T
            for body, corners in zip(self.bodies, self._corners, strict=True)
        ]

    def centre(self, data: mujoco.MjData) -> np.ndarray:
        """Return the place on the floor below the centre of mass (2,) [m]."""
        return data.subtree_com[self._pelvis][:2].copy()

    def speed(self, data: mujoco.MjData) -> np.ndarray:
        """Return the velocity of this place (2,) [m/s]."""
        mujoco.mj_subtreeVel(self._model, data)
        return data.subtree_linvel[self._pelvis][:2].copy()

    def carries(self, data: mujoco.MjData) -> bool:
        """Return whether the centre of mass is above the base of support."""
        away = np.vstack(self.corners(data))[:, :2] - self.centre(data)
        angles = np.sort(np.arctan2(away[:, 1], away[:, 0]))
        gaps = np.diff(np.append(angles, angles[0] + 2 * np.pi))
        return bool(gaps.max() < np.pi)

    def shift(self, data: mujoco.MjData, load: np.ndarray) -> np.ndarray:
        """Return how far a load shifts the pressure from below the centre of mass (2,) [m].

        Args:
            data: kinematics.
            load: load on the person's coordinates (38,).
        """
        below = np.append(self.centre(data), 0.0)
        torque = data.xmat[self._pelvis].reshape(3, 3) @ load[3:6]
        torque += cross(data.xpos[self._pelvis] - below, load[:3])
        weight = 9.81 * float(self._model.body_subtreemass[self._pelvis]) - load[2]
        return np.array([torque[1], -torque[0]]) / weight

    def push(self, data: mujoco.MjData, wrench: np.ndarray) -> list[np.ndarray]:
        """Return the push of each body (6,), at its origin, that together give a wrench.

        The corners share it by least squares, and none pulls.

        Args:
            data: kinematics.
            wrench: wanted force and torque about the origin of the pelvis (6,) [N, N m].
        """
        outer = [points[:4] for points in self.corners(data)]
        levers = np.vstack(outer) - data.xpos[self._pelvis]
        forces = shared(levers, wrench, np.repeat(self._shares, 4))
        pushes = []
        for number, body in enumerate(self.bodies):
            own = forces[4 * number : 4 * number + 4]
            torque = cross(outer[number] - data.xpos[body], own).sum(axis=0)
            pushes.append(np.concatenate([own.sum(axis=0), torque]))
        return pushes

    def torques(
        self, data: mujoco.MjData, sway: np.ndarray, ready: np.ndarray, felt: np.ndarray
    ) -> np.ndarray:
        """Return the joint torques (32,) [N m] that carry the body on its support.

        Args:
            data: kinematics and bias forces.
            sway: wanted acceleration of the centre of mass (2,) [m/s^2].
            ready: load that the arms are ready to carry, on the person's coordinates (38,).
            felt: load that the legs brace against (38,).
        """
        bias = data.qfrc_bias[:PERSON_DOFS]
        turn = data.xmat[self._pelvis].reshape(3, 3)
        mass = float(self._model.body_subtreemass[self._pelvis])
        limited = sway * min(1.0, _MOST_ACCELERATION / (float(np.linalg.norm(sway)) + 1e-9))
        force = mass * np.array([limited[0], limited[1], 0.0])
        lever = data.subtree_com[self._pelvis] - data.xpos[self._pelvis]
        wrench = np.concatenate([bias[:3] - felt[:3], turn @ (bias[3:6] - felt[3:6])])
        wrench += np.concatenate([force, cross(lever, force)])
        needed = bias[6:] - ready[6:]
        jacobian = np.zeros((6, self._model.nv))
        for body, push in zip(self.bodies, self.push(data, wrench), strict=True):
            if body != self._pelvis:
                mujoco.mj_jacBody(self._model, data, jacobian[:3], jacobian[3:], body)
                needed = needed - jacobian[:, 6:PERSON_DOFS].T @ push
        return needed


def _under(model: mujoco.MjModel, name: str) -> np.ndarray:
    """Return the lower corners (4, 3) of a box in its body's frame, the two in the back first."""
    geom = model.geom(name)
    x, y, z = geom.size
    return geom.pos + np.array([[-x, -y, -z], [-x, y, -z], [x, -y, -z], [x, y, -z]])


def contact_in(data: mujoco.MjData, work: Work) -> np.ndarray:
    """Return the contact frame (4, 4) [m] of a person's hands."""
    return work.contact([site_pose(data, f"{side}_grip") for side in work.hands])


def site_pose(data: mujoco.MjData, name: str) -> np.ndarray:
    """Return the pose (4, 4) of a frame of a person's model [m]."""
    site, pose = data.site(name), np.eye(4)
    pose[:3, :3], pose[:3, 3] = site.xmat.reshape(3, 3), site.xpos
    return pose


_ANOTHER: Final = 0.5
"""A hand that slides again after this time counts as another slip [s]."""


class Grasp:
    """The points at which the hands hold the object, on the hands and on the object.

    Args:
        model: model of the person, which belongs to this holding alone: the points on the
            object are written to it.
        hands: hands that hold.
    """

    def __init__(self, model: mujoco.MjModel, hands: tuple[str, ...]) -> None:
        """Look up the points."""
        self.model = model
        self._object = int(model.body("object").id)
        names = holding_points(model)
        self._on_hand = np.array([model.site(name).id for name in names])
        self._on_object = np.array([model.site(f"{name}{ON_OBJECT}").id for name in names])
        self._springs = np.array(
            [[model.actuator(f"{name}_{axis}").id for axis in "xyz"] for name in names]
        )
        self._hand = np.array([hands.index(name.split("_")[0]) for name in names])
        self._most = HABITS.slip_force * len(hands) / len(names)
        self._stiffness = HABITS.grasp_stiffness * len(hands) / len(names)
        self._grasped = np.zeros((len(names), 3))
        self._slid = np.full(len(hands), -np.inf)
        self.slipped = 0

    def take(self, data: mujoco.MjData) -> None:
        """Take hold of the object with hands and object where they are now."""
        pose, turn = self._frame(data)
        self._grasped = (data.site_xpos[self._on_hand] - pose) @ turn
        self.model.site_pos[self._on_object] = self._grasped
        self.slipped = 0

    def copy(self, model: mujoco.MjModel) -> Grasp:
        """Return the same grasp in a copy of the model."""
        other = object.__new__(Grasp)
        vars(other).update(vars(self), model=model, _slid=self._slid.copy())
        return other

    @property
    def points(self) -> int:
        """Number of points."""
        return len(self._on_hand)

    def places(self, data: mujoco.MjData) -> np.ndarray:
        """Return the points on the object where the hands hold, in the world (k, 3) [m]."""
        return data.site_xpos[self._on_object].copy()

    def gap(self, data: mujoco.MjData) -> float:
        """Return the largest distance of a hand from where it took hold of the object [m]."""
        pose, turn = self._frame(data)
        away = data.site_xpos[self._on_hand] - (pose + self._grasped @ turn.T)
        means = [away[self._hand == hand].mean(axis=0) for hand in np.unique(self._hand)]
        return float(np.linalg.norm(means, axis=1).max())

    def slide(self, data: mujoco.MjData) -> None:
        """Let the points with more force than a hand can hold slide along the object."""
        turn = self._frame(data)[1]
        stretch = data.site_xpos[self._on_hand] - data.site_xpos[self._on_object]
        length = np.linalg.norm(stretch, axis=1)
        longest = self._most / self._stiffness
        sliding = length > longest
        if not sliding.any():
            return
        # Slide only by the excess, which within a tick of the muscles is less than the
        # stretch.
        way = stretch * (1 - longest / np.maximum(length, longest))[:, None]
        self.model.site_pos[self._on_object] += way @ turn
        for hand in np.unique(self._hand[sliding]):
            self.slipped += int(data.time - self._slid[hand] > _ANOTHER)
            self._slid[hand] = data.time

    def let_go(self) -> None:
        """Open the hands."""
        self.model.opt.disableactuator |= 1 << HAND_GROUP

    def forces(self, data: mujoco.MjData) -> np.ndarray:
        """Return the force of the object on the hands at every point (k, 3), in the world [N]."""
        return data.actuator_force[self._springs] @ self._frame(data)[1].T

    def wrench(self, data: mujoco.MjData) -> np.ndarray:
        """Return the object's wrench on the hands (6,) at its frame, world-aligned [N, N m]."""
        forces = self.forces(data)
        levers = data.site_xpos[self._on_hand] - self._frame(data)[0]
        return np.concatenate([forces.sum(axis=0), cross(levers, forces).sum(axis=0)])

    def on_person(self, data: mujoco.MjData, forces: np.ndarray) -> np.ndarray:
        """Return the generalised forces (..., 38) of forces (..., k, 3) at the points."""
        jacobian = np.zeros((self.points, 3, self.model.nv))
        for site, part in zip(self._on_hand, jacobian, strict=True):
            mujoco.mj_jacSite(self.model, data, part, None, site)
        rows = jacobian[:, :, :PERSON_DOFS].reshape(-1, PERSON_DOFS)
        return forces.reshape(*forces.shape[:-2], -1) @ rows

    def _frame(self, data: mujoco.MjData) -> tuple[np.ndarray, np.ndarray]:
        return data.xpos[self._object], data.xmat[self._object].reshape(3, 3)


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
            share = _share(HABITS.plan_period, HABITS.lift_time)
            self._lifts = self._lifts + share * (self._late[0] - places)
        else:
            self._late.append(places)
            while len(self._late) > self._delay + 1:
                self._late.popleft()
        soles = None
        if self._support.on_feet:
            soles = [flat(site_pose(data, f"{side}_sole")) for side in SIDES]
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


def flat(sole: np.ndarray) -> np.ndarray:
    """Return where a sole stands (4, 4): level, and on the floor."""
    stands = np.eye(4)
    stands[:3, :3], stands[:2, 3] = upright(sole[:3, :3]), sole[:2, 3]
    return stands
