"""Poses of person, arm and object, the Jacobian of the contact frame, and the near pairs."""

from __future__ import annotations

from typing import Final

import mink
import mujoco
import numpy as np

from ergoqp.responses.ik import IkResponse
from ergoqp.whole_body.scene import Scene
from ergoqp.whole_body.separation import Closeness, Separation
from ergoqp.whole_body.terms import pelvis_function

_RETREAT: Final = 0.05
_LOOK: Final = 0.15


class Sight:
    """One scene as a step sees it.

    Args:
        scene: scene of person, robot and object.
        person: person in it.
        configuration: mink's copy of the positions, which is kept up to date.
        distance: distance to keep [m]. None: none.
        reserve: distance kept in addition [m].
        pace: the object's time to stop from full speed [s].
    """

    def __init__(
        self,
        scene: Scene,
        person: IkResponse,
        configuration: mink.Configuration,
        distance: float | None,
        reserve: float,
        pace: float,
    ) -> None:
        """Build the functions once."""
        self._scene, self._configuration = scene, configuration
        self._pelvis, self._separation = pelvis_function(person), Separation(scene)
        self._distance, self._reserve, self._pace = distance, reserve, pace

    def look(
        self, posture: np.ndarray, positions: np.ndarray, after: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the contact frame (4, 4), and its Jacobian for the arm's joints (6, k).

        The Jacobian is that of the middle of the coming period.

        The arm turns while it moves. With the Jacobian of the start, the object would leave its
        straight path by the change of the Jacobian in half a period, always to the same side.

        Args:
            posture: posture of the person (32,) [rad].
            positions: positions of the arm's joints (k,) [rad].
            after: positions after half a period at the last speeds (k,) [rad].
        """
        scene, site = self._scene, self._scene.contact_site
        data = self.place(posture, positions)
        contact, jacobian = np.eye(4), np.zeros((6, scene.model.nv))
        contact[:3, :3], contact[:3, 3] = data.site_xmat[site].reshape(3, 3), data.site_xpos[site]
        data = self.place(posture, after)
        mujoco.mj_jacSite(scene.model, data, jacobian[:3], jacobian[3:], site)
        return contact, jacobian[:, scene.arm]

    def place(self, posture: np.ndarray, positions: np.ndarray) -> mujoco.MjData:
        """Set the positions of person and arm."""
        pelvis = np.array(self._pelvis(posture)[0]).ravel()
        self._configuration.update(self._scene.qpos(pelvis, posture, positions))
        return self._configuration.data

    def near(self) -> tuple[Closeness | None, float]:
        """Return the near pairs and the smallest distance [m] at the positions set last."""
        if self._distance is None:
            return None, float("inf")
        data = self._configuration.data
        close = self._separation.near(data, self._distance + self._reserve + _LOOK)
        least = (
            float(close.distances.min()) if len(close.pairs) else self._separation.smallest(data)[0]
        )
        return close, least

    def approach(self, close: Closeness, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Return the largest speeds of approach (m,) [m/s].

        They are the remaining distance over the object's time to stop from full speed. So the
        approach becomes ever slower, with no more deceleration than the object has. If the distance
        is already too small, the robot retreats, as fast as its joints allow and at most at 0.05
        m/s.

        Args:
            close: the near pairs.
            low: lower bounds of the speeds of the arm's joints (k,) [rad/s].
            high: upper bounds of these speeds (k,) [rad/s].
        """
        left = close.distances - (self._distance or 0.0) - self._reserve
        allowed = np.where(left >= 0, left, np.maximum(left, -_RETREAT * self._pace)) / self._pace
        arm = -close.gradients[:, self._scene.arm]
        least = np.minimum(arm * low, arm * high).sum(axis=1)
        return np.maximum(allowed, least)
