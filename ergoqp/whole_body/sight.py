"""Where person, arm and object are, how they move together, and what is near to what."""

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
        scene: of person, robot and object.
        person: in it.
        configuration: mink's view of the scene, which is kept up to date.
        distance: to be kept [m]; None: none.
        reserve: kept beyond it [m].
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
        """Return the contact frame (4, 4), and its Jacobian after the arm's joints (6, k).

        The Jacobian is that in the middle of the coming period.

        The arm turns while it moves: with the Jacobian of the begin the object would leave its
        straight way by what the Jacobian changes in half a period, again and again to the same
        side.

        Args:
            posture: of the person (32,) [rad].
            positions: of the arm (k,) [rad].
            after: where the last speeds bring the arm by the middle of the period (k,) [rad].
        """
        scene, site = self._scene, self._scene.contact_site
        data = self.place(posture, positions)
        contact, jacobian = np.eye(4), np.zeros((6, scene.model.nv))
        contact[:3, :3], contact[:3, 3] = data.site_xmat[site].reshape(3, 3), data.site_xpos[site]
        data = self.place(posture, after)
        mujoco.mj_jacSite(scene.model, data, jacobian[:3], jacobian[3:], site)
        return contact, jacobian[:, scene.arm]

    def place(self, posture: np.ndarray, positions: np.ndarray) -> mujoco.MjData:
        """Put person and arm where they are."""
        pelvis = np.array(self._pelvis(posture)[0]).ravel()
        self._configuration.update(self._scene.qpos(pelvis, posture, positions))
        return self._configuration.data

    def near(self) -> tuple[Closeness | None, float]:
        """Return what is near, and the smallest distance [m], where everything was put last."""
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

        They are what is left, over the object's time to stop from full speed: so the distance is
        come to ever more slowly, with no more deceleration than the object has. Nearer than that,
        the robot retreats, as fast as its joints allow and at most by 0.05 m/s.

        Args:
            close: the pairs that are near.
            low: least speeds of the arm's joints (k,) [rad/s].
            high: greatest ones.
        """
        left = close.distances - (self._distance or 0.0) - self._reserve
        allowed = np.where(left >= 0, left, np.maximum(left, -_RETREAT * self._pace)) / self._pace
        arm = -close.gradients[:, self._scene.arm]
        least = np.minimum(arm * low, arm * high).sum(axis=1)
        return np.maximum(allowed, least)
