"""The terms of the cost of a posture: residuals, their Jacobians and their weights."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import mujoco
import numpy as np

from ergoqp.joints import INDEX, JOINTS, SIDES
from ergoqp.problem.way import turn_between
from ergoqp.simulation.people.mass.anatomy import PERSON_DOFS
from ergoqp.simulation.people.mass.table import HABITS
from ergoqp.simulation.people.mass.vectors import cross

_HANDS: Final = 1e4
_SOLES: Final = 2e4
_TURNED_SOLES: Final = 500.0
_GAZE: Final = 6.0
_HANGING: Final = 20.0
_ON_LAP: Final = 40.0
_LEVEL_PELVIS: Final = 5.0
_TOPPLING: Final = 5e4
"""Weights of the residuals, per m^2 or rad^2; the effort of a joint costs 0.5 to 7 per rad^2."""

_FAR: Final = 0.10
"""Largest displacement of a hand or a sole in one step [m]."""

_NECK: Final = [6 + i for i, name in enumerate(JOINTS) if name.startswith("neck")]
_ARMS: Final = {
    side: [
        6 + INDEX[name]
        for name in JOINTS[6:20]
        if name.startswith(side) and not name.endswith("deviation")
    ]
    for side in SIDES
}
# Pelvis, trunk and legs keep the centre of mass over the soles; neck and arms do not.
_CARRIERS: Final = np.array([i < 9 or i >= 26 for i in range(PERSON_DOFS)])


class Residuals:
    """The residuals of one posture, each with its Jacobian and its weight.

    Args:
        model: model of the person.
        data: its kinematics in the posture.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Start without residuals."""
        self._model, self._data = model, data
        self._pelvis = int(model.body("pelvis").id)
        self._jacobian = np.zeros((6, model.nv))
        self._rows: list[tuple[np.ndarray, np.ndarray, float]] = []

    def hold(self, sites: Sequence[int], points: np.ndarray) -> None:
        """Add: bring the points of the hands to where they should hold (k, 3) [m]."""
        for site, point in zip(sites, points, strict=True):
            error = _capped(point - self._data.site_xpos[site], _FAR)
            self._add(self._jac(site)[:3], error, _HANDS / len(points))

    def stand(self, side: str, sole: np.ndarray) -> None:
        """Add: keep a sole where it stands (4, 4) [m]."""
        site = self._site(f"{side}_sole")
        jacobian, have = self._jac(site), self._data.site_xmat[site].reshape(3, 3)
        self._add(jacobian[:3], _capped(sole[:3, 3] - self._data.site_xpos[site], _FAR), _SOLES)
        self._add(jacobian[3:], _capped(turn_between(have, sole[:3, :3]), 0.3), _TURNED_SOLES)

    def gaze(self, work: np.ndarray) -> None:
        """Add: turn the neck toward the work by the angle beyond the range of the eyes."""
        eyes = self._site("eyes")
        ahead = self._data.site_xmat[eyes].reshape(3, 3)[:, 0]
        toward = work - self._data.site_xpos[eyes]
        toward /= np.linalg.norm(toward)
        axis = cross(ahead, toward)
        angle = float(np.arctan2(np.linalg.norm(axis), ahead @ toward))
        excess = angle - HABITS.eye_range
        if excess > 0:
            turn = axis / (np.linalg.norm(axis) + 1e-9) * min(excess, 0.5)
            self._add(_only(self._jac(eyes)[3:], _NECK), turn, _GAZE)

    def rest_arm(self, side: str, seated: bool) -> None:
        """Add: let a free arm hang from its shoulder or, when seated, lie on its thigh."""
        arm, wrist = _ARMS[side], self._site(f"{side}_wrist")
        if seated:
            lap = self._data.site_xpos[self._site(f"{side}_lap")]
            error = _capped(lap - self._data.site_xpos[wrist], _FAR)
            self._add(_only(self._jac(wrist)[:3], arm), error, _ON_LAP)
        else:
            elbow, shoulder = self._site(f"{side}_elbow"), self._site(f"{side}_shoulder")
            error = self._data.site_xpos[shoulder] - self._data.site_xpos[elbow]
            jacobian = _only(self._jac(elbow)[:2], arm)
            self._add(jacobian, _capped(error[:2], _FAR), _HANGING)

    def stay_level(self) -> None:
        """Add: keep the pelvis level."""
        turn = self._data.xmat[self._pelvis].reshape(3, 3)
        up = turn[:, 2]
        jacobian = np.zeros((2, PERSON_DOFS))
        for column in range(3):
            jacobian[:, 3 + column] = cross(turn[:, column], up)[:2]
        self._add(jacobian, -up[:2], _LEVEL_PELVIS)

    def balance(self, place: np.ndarray, cost: float) -> None:
        """Add: keep the centre of mass over a place (2,) [m], at a cost per m^2.

        Far from it a much larger weight applies: nobody reaches past their toes, however
        strong the other wishes are.
        """
        mujoco.mj_jacSubtreeCom(self._model, self._data, self._jacobian[:3], self._pelvis)
        jacobian = self._jacobian[:2, :PERSON_DOFS] * _CARRIERS
        error = place - self._data.subtree_com[self._pelvis][:2]
        self._add(jacobian, _capped(error, _FAR), cost)
        excess = error - _capped(error, HABITS.farthest_over)
        if excess.any():
            way = error / np.linalg.norm(error)
            self._add((way @ jacobian)[None], _capped(excess, _FAR) @ way[:, None], _TOPPLING)

    def normal(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the normal equations' matrix (38, 38) and right side (38,)."""
        jacobians, errors, costs = zip(*self._rows, strict=True)
        rows, error = np.vstack(jacobians), np.concatenate(errors)
        weighted = rows.T * np.repeat(costs, [len(part) for part in errors])
        return weighted @ rows, weighted @ error

    def _add(self, jacobian: np.ndarray, error: np.ndarray, cost: float) -> None:
        self._rows.append((jacobian, error, cost))

    def _site(self, name: str) -> int:
        return int(self._model.site(name).id)

    def _jac(self, site: int) -> np.ndarray:
        """Return the Jacobian (6, 38) of a site."""
        mujoco.mj_jacSite(self._model, self._data, self._jacobian[:3], self._jacobian[3:], site)
        return self._jacobian[:, :PERSON_DOFS].copy()


def _only(jacobian: np.ndarray, columns: list[int]) -> np.ndarray:
    """Return a Jacobian with these columns only. No other coordinate moves for this term."""
    kept = np.zeros_like(jacobian)
    kept[:, columns] = jacobian[:, columns]
    return kept


def _capped(vector: np.ndarray, longest: float) -> np.ndarray:
    return vector * min(1.0, longest / (float(np.linalg.norm(vector)) + 1e-12))
