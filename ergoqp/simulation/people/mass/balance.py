"""The support of a person, and the joint torques that hold the body up on it."""

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np

from ergoqp.joints import SIDES
from ergoqp.simulation.people.mass.anatomy import PERSON_DOFS
from ergoqp.simulation.people.mass.ground import shared
from ergoqp.simulation.people.mass.vectors import cross

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
