"""The soft grasp of the object by the hands: its forces, and how it slides."""

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np

from ergoqp.simulation.people.mass.anatomy import (
    HAND_GROUP,
    ON_OBJECT,
    PERSON_DOFS,
    holding_points,
)
from ergoqp.simulation.people.mass.table import HABITS
from ergoqp.simulation.people.mass.vectors import cross

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
