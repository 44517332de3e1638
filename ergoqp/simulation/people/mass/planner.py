"""Which posture a person wants, with the object where it is: their own inverse kinematics."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import mujoco
import numpy as np

from ergoqp.joints import INDEX, JOINTS, LOWER, SIDES, UPPER
from ergoqp.simulation.people.mass.anatomy import BALL_END, PERSON_DOFS, holding_points
from ergoqp.simulation.people.mass.plan import PERSON_QPOS, Plan
from ergoqp.simulation.people.mass.table import HABITS
from ergoqp.simulation.people.mass.vectors import cross
from ergoqp.simulation.people.mass.wishes import Wishes
from ergoqp.simulation.people.way import turn_between

_HANDS: Final = 1e4
_SOLES: Final = 2e4
_TURNED_SOLES: Final = 500.0
_GAZE: Final = 6.0
_HANGING: Final = 20.0
_ON_LAP: Final = 40.0
_LEVEL_PELVIS: Final = 5.0
"""What errors cost, per m^2 or rad^2, where a joint's effort costs 0.5 to 7 per rad^2."""

_FAR: Final = 0.10
"""Longest way that one step takes a hand or a sole [m]."""

_DAMPING: Final = 0.5
"""Cost of moving the arms alone, per rad^2."""

_LONGEST: Final = 0.25
"""Largest change of a joint in one step [rad]."""

# A joint that is wanted at its very end would be pushed beyond it by what hangs on it.
_INSET: Final = np.radians(2.0)
_LOWEST: Final = LOWER + _INSET
_HIGHEST: Final = UPPER - _INSET
_BASE: Final = list(range(6))
_NECK: Final = [6 + i for i, name in enumerate(JOINTS) if name.startswith("neck")]
_ARMS: Final = {
    side: [
        6 + INDEX[name]
        for name in JOINTS[6:20]
        if name.startswith(side) and not name.endswith("deviation")
    ]
    for side in SIDES
}
_WHOLE_ARMS: Final = {
    side: [6 + INDEX[name] for name in JOINTS[6:20] if name.startswith(side)] for side in SIDES
}
# The centre of mass is kept over the soles by pelvis, trunk and legs: never by neck or arms.
_CARRIERS: Final = np.array([i < 9 or i >= 26 for i in range(PERSON_DOFS)])


class Planner:
    """Damped Gauss-Newton steps toward the posture that a person wants.

    Args:
        model: of the person, as `ergoqp.simulation.people.mass.anatomy.build` gives it.
        wishes: what the person minds.
    """

    def __init__(self, model: mujoco.MjModel, wishes: Wishes) -> None:
        """Look up the frames."""
        self._model, self._wishes = model, wishes
        self._data = mujoco.MjData(model)
        self._pelvis = model.body("pelvis").id
        self._holds = [int(model.site(name).id) for name in holding_points(model)]
        ball = model.geom("right_ball")
        self._ahead = HABITS.ahead * float(ball.pos[0] + ball.size[0]) / BALL_END
        self._jacobian = np.zeros((6, model.nv))
        self._rows: list[tuple[np.ndarray, np.ndarray, float]] = []

    def held(self, qpos: np.ndarray) -> np.ndarray:
        """Return where the hands' points are (k, 3) [m]."""
        return self.look(qpos).site_xpos[self._holds].copy()

    def look(self, qpos: np.ndarray) -> mujoco.MjData:
        """Return the kinematics of a state (39,); valid until the next call."""
        self._data.qpos[:PERSON_QPOS] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        return self._data

    def step(
        self, plan: Plan, points: np.ndarray | None, soles: Sequence[np.ndarray] | None
    ) -> Plan:
        """Return the plan after one step.

        Args:
            plan: before.
            points: where the hands should hold (k, 3) [m]; None: nowhere.
            soles: where the soles stand (4, 4) each [m]; None: they hang.
        """
        wishes, data = self._wishes, self.look(plan.qpos)
        self._rows = []
        if points is not None:
            for site, point in zip(self._holds, points, strict=True):
                share = _HANDS / len(points)
                self._reach(site, _capped(point - data.site_xpos[site], _FAR), share)
            self._gaze(points.mean(axis=0))
        for number, side in enumerate(SIDES):
            if soles is not None:
                self._stand(f"{side}_sole", soles[number])
            if side not in wishes.hands and points is not None:
                self._rest_arm(side)
        if not wishes.seated:
            self._stay_level()
            if soles is not None:
                self._balance(
                    np.mean([sole[:2, 3] + self._ahead * sole[:2, 0] for sole in soles], axis=0)
                )
        free = np.ones(PERSON_DOFS, dtype=bool)
        free[_BASE] = not wishes.seated
        change = self._solve(plan.qpos[7:], wishes.comfort, free, plan.damping)
        after = np.zeros(self._model.nq)
        after[:PERSON_QPOS] = plan.qpos
        after[PERSON_QPOS + 3] = 1.0
        velocity = np.zeros(self._model.nv)
        velocity[:PERSON_DOFS] = change
        mujoco.mj_integratePos(self._model, after, velocity, 1.0)
        after[7:PERSON_QPOS] = np.clip(after[7:PERSON_QPOS], _LOWEST, _HIGHEST)
        return plan.after(after[:PERSON_QPOS], change)

    def arms(self, qpos: np.ndarray, points: np.ndarray, plan: Plan) -> np.ndarray:
        """Return joints (32,) of which the holding arms' have the hands nearer to their points.

        The body stays as it is; of all ways to do it the arms take that nearest to the plan's.

        Args:
            qpos: pelvis and joints now (39,).
            points: where the hands should hold (k, 3) [m].
            plan: of the whole posture.
        """
        data, free = self.look(qpos), np.zeros(PERSON_DOFS, dtype=bool)
        for side in self._wishes.hands:
            free[_WHOLE_ARMS[side]] = True
        self._rows = []
        for site, point in zip(self._holds, points, strict=True):
            error = _capped(point - data.site_xpos[site], _FAR)
            self._reach(site, error, _HANDS / len(points))
        change = self._solve(qpos[7:], plan.qpos[7:], free, _DAMPING)
        return np.clip(qpos[7:] + change[6:], _LOWEST, _HIGHEST)

    def settle(
        self,
        qpos: np.ndarray,
        points: np.ndarray | None,
        soles: Sequence[np.ndarray] | None,
        steps: int = 120,
    ) -> Plan:
        """Return the plan to which steps from a state (39,) lead."""
        plan = Plan(qpos)
        for _ in range(steps):
            plan = self.step(plan, points, soles)
            if plan.arrived:
                break
        return plan

    def misses(self, qpos: np.ndarray, points: np.ndarray) -> float:
        """Return how far at most a hand's point is from where it should hold [m]."""
        return float(np.linalg.norm(self.held(qpos) - points, axis=1).max())

    def _site(self, name: str) -> int:
        return int(self._model.site(name).id)

    def _jac(self, site: int) -> np.ndarray:
        """Return the Jacobian (6, 38) of a site."""
        mujoco.mj_jacSite(self._model, self._data, self._jacobian[:3], self._jacobian[3:], site)
        return self._jacobian[:, :PERSON_DOFS].copy()

    def _reach(self, site: int, error: np.ndarray, cost: float) -> None:
        self._rows.append((self._jac(site)[:3], error, cost))

    def _stand(self, name: str, sole: np.ndarray) -> None:
        site = self._site(name)
        jacobian = self._jac(site)
        have = self._data.site_xmat[site].reshape(3, 3)
        self._rows.append(
            (jacobian[:3], _capped(sole[:3, 3] - self._data.site_xpos[site], _FAR), _SOLES)
        )
        self._rows.append(
            (jacobian[3:], _capped(turn_between(have, sole[:3, :3]), 0.3), _TURNED_SOLES)
        )

    def _gaze(self, work: np.ndarray) -> None:
        """Turn the neck toward the work by what the eyes do not take."""
        eyes = self._site("eyes")
        ahead = self._data.site_xmat[eyes].reshape(3, 3)[:, 0]
        toward = work - self._data.site_xpos[eyes]
        toward /= np.linalg.norm(toward)
        axis = cross(ahead, toward)
        angle = float(np.arctan2(np.linalg.norm(axis), ahead @ toward))
        excess = angle - HABITS.eye_range
        if excess > 0:
            turn = axis / (np.linalg.norm(axis) + 1e-9) * min(excess, 0.5)
            self._rows.append((_only(self._jac(eyes)[3:], _NECK), turn, _GAZE))

    def _rest_arm(self, side: str) -> None:
        """Let a free arm hang from its shoulder, or lie on its thigh."""
        arm, wrist = _ARMS[side], self._site(f"{side}_wrist")
        if self._wishes.seated:
            lap = self._data.site_xpos[self._site(f"{side}_lap")]
            error = _capped(lap - self._data.site_xpos[wrist], _FAR)
            self._rows.append((_only(self._jac(wrist)[:3], arm), error, _ON_LAP))
        else:
            elbow, shoulder = self._site(f"{side}_elbow"), self._site(f"{side}_shoulder")
            error = self._data.site_xpos[shoulder] - self._data.site_xpos[elbow]
            jacobian = _only(self._jac(elbow)[:2], arm)
            self._rows.append((jacobian, _capped(error[:2], _FAR), _HANGING))

    def _stay_level(self) -> None:
        turn = self._data.xmat[self._pelvis].reshape(3, 3)
        up = turn[:, 2]
        jacobian = np.zeros((2, PERSON_DOFS))
        for column in range(3):
            jacobian[:, 3 + column] = cross(turn[:, column], up)[:2]
        self._rows.append((jacobian, -up[:2], _LEVEL_PELVIS))

    def _balance(self, middle: np.ndarray) -> None:
        mujoco.mj_jacSubtreeCom(self._model, self._data, self._jacobian[:3], self._pelvis)
        jacobian = self._jacobian[:2, :PERSON_DOFS] * _CARRIERS
        error = middle - self._data.subtree_com[self._pelvis][:2]
        self._rows.append((jacobian, _capped(error, _FAR), self._wishes.balance))

    def _solve(
        self, joints: np.ndarray, comfort: np.ndarray, free: np.ndarray, damping: float
    ) -> np.ndarray:
        """Return the change (38,) of least cost within the joints' ranges.

        Args:
            joints: now (32,) [rad].
            comfort: where they would be best (32,) [rad].
            free: which coordinates may change (38,) bool; written to.
            damping: what a change costs of itself.
        """
        wishes = self._wishes
        costs = np.concatenate([np.full(len(error), cost) for _, error, cost in self._rows])
        rows = np.vstack([jacobian for jacobian, _, _ in self._rows])
        errors = np.concatenate([error for _, error, _ in self._rows])
        hessian = rows.T @ (rows * costs[:, None])
        hessian[np.diag_indices(PERSON_DOFS)] += damping
        hessian[np.arange(6, PERSON_DOFS), np.arange(6, PERSON_DOFS)] += wishes.efforts
        pull = rows.T @ (costs * errors)
        pull[6:] += wishes.efforts * (comfort - joints)
        change = np.zeros(PERSON_DOFS)
        for _ in range(4):
            change[:] = 0.0
            change[free] = np.linalg.solve(hessian[np.ix_(free, free)], pull[free])
            after = joints + change[6:]
            stuck = ((after > _HIGHEST) & (joints > _HIGHEST - 1e-6)) | (
                (after < _LOWEST) & (joints < _LOWEST + 1e-6)
            )
            if not (stuck & free[6:]).any():
                break
            free[6:] &= ~stuck
        return change * min(1.0, _LONGEST / (float(np.abs(change).max()) + 1e-12))


def _only(jacobian: np.ndarray, columns: list[int]) -> np.ndarray:
    """Return a Jacobian of these columns alone: the others do not move for this."""
    kept = np.zeros_like(jacobian)
    kept[:, columns] = jacobian[:, columns]
    return kept


def _capped(vector: np.ndarray, longest: float) -> np.ndarray:
    return vector * min(1.0, longest / (float(np.linalg.norm(vector)) + 1e-12))
