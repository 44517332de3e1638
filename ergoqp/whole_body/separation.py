"""Distances between robot, object and person, and their derivatives with respect to every joint."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from ergoqp.whole_body.scene import Scene


@dataclass(frozen=True)
class Closeness:
    """The near pairs.

    Attributes:
        pairs: rows of `Scene.pairs` (m,).
        distances: distance of each pair (m,) [m], negative if they overlap.
        gradients: derivative of each distance with respect to all velocities (m, nv) [m/rad]; zero
            if both touch at a point.
    """

    pairs: np.ndarray
    distances: np.ndarray
    gradients: np.ndarray


class Separation:
    """Measures the pairs of a scene.

    MuJoCo gives the nearest points of a pair. The rate of the distance is the relative motion of
    both points along the line between them, with the opposite sign if they overlap.
    """

    def __init__(self, scene: Scene) -> None:
        """Compute the data of the first test: the bounding spheres of all geoms."""
        self.scene = scene
        model = scene.model
        self._first, self._second = scene.pairs.T
        self._radii = model.geom_rbound[self._first] + model.geom_rbound[self._second]
        self._points, self._jacobians = np.zeros(6), np.zeros((2, 3, model.nv))

    def near(self, data: mujoco.MjData, range_: float) -> Closeness:
        """Return the pairs within a range [m], with gradients.

        `data` must be up to date (`mj_kinematics`, `mj_comPos`).
        """
        rows, distances, gradients = [], [], []
        for row in self._candidates(data, range_):
            distance, points = self._distance(data, int(row), range_)
            if distance < range_:
                rows.append(row)
                distances.append(distance)
                gradients.append(self._gradient(data, int(row), distance, points))
        shape = (len(rows), self.scene.model.nv)
        return Closeness(
            np.array(rows, dtype=int), np.array(distances), np.array(gradients).reshape(shape)
        )

    def smallest(self, data: mujoco.MjData, range_: float = 1.0) -> tuple[float, int]:
        """Return the smallest distance of all pairs [m] and its row in `Scene.pairs`.

        If no pair is within the range, return (range, -1).
        """
        least, which = range_, -1
        for row in self._candidates(data, range_):
            distance, _ = self._distance(data, int(row), least)
            if distance < least:
                least, which = distance, int(row)
        return least, which

    def _candidates(self, data: mujoco.MjData, range_: float) -> np.ndarray:
        apart = data.geom_xpos[self._first] - data.geom_xpos[self._second]
        return np.flatnonzero(np.einsum("ij,ij->i", apart, apart) <= (self._radii + range_) ** 2)

    def _distance(self, data: mujoco.MjData, row: int, range_: float) -> tuple[float, np.ndarray]:
        pair = int(self._first[row]), int(self._second[row])
        distance = mujoco.mj_geomDistance(self.scene.model, data, *pair, range_, self._points)
        return distance, self._points

    def _gradient(
        self, data: mujoco.MjData, row: int, distance: float, points: np.ndarray
    ) -> np.ndarray:
        model, pair = self.scene.model, (int(self._first[row]), int(self._second[row]))
        for jacobian, point, geom in zip(self._jacobians, points.reshape(2, 3), pair, strict=True):
            mujoco.mj_jac(model, data, jacobian, None, point, int(model.geom_bodyid[geom]))
        line = points[3:] - points[:3]
        length = float(np.linalg.norm(line))
        if length < 1e-9:
            return np.zeros(model.nv)
        return np.sign(distance) * (line / length) @ (self._jacobians[1] - self._jacobians[0])
