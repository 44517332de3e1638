"""The posture that a person wants for a pose of the object: the person's own inverse kinematics."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import mujoco
import numpy as np

from ergoqp.joints import INDEX, JOINTS, LOWER, SIDES, UPPER
from ergoqp.simulation.people.mass.anatomy import BALL_END, PERSON_DOFS, holding_points
from ergoqp.simulation.people.mass.plan import PERSON_QPOS, Plan
from ergoqp.simulation.people.mass.residuals import Residuals
from ergoqp.simulation.people.mass.table import HABITS
from ergoqp.simulation.people.mass.wishes import Wishes

_DAMPING: Final = 0.5
"""Cost of moving the arms alone, per rad^2."""

_LONGEST: Final = 0.25
"""Largest change of a joint in one step [rad]."""

# A joint with a target exactly at its end would be pushed beyond it by the weight on it.
_INSET: Final = np.radians(2.0)
_LOWEST: Final = LOWER + _INSET
_HIGHEST: Final = UPPER - _INSET
_BASE: Final = list(range(6))
_ARMS: Final = {
    side: [6 + INDEX[name] for name in JOINTS[6:20] if name.startswith(side)] for side in SIDES
}


class Planner:
    """Damped Gauss-Newton steps toward the posture that a person wants.

    Args:
        model: model of the person, from `ergoqp.simulation.people.mass.anatomy.build`.
        wishes: the costs by which the person chooses a posture.
    """

    def __init__(self, model: mujoco.MjModel, wishes: Wishes) -> None:
        """Look up the frames."""
        self._model, self._wishes = model, wishes
        self._data = mujoco.MjData(model)
        self._holds = [int(model.site(name).id) for name in holding_points(model)]
        ball = model.geom("right_ball")
        self._ahead = HABITS.ahead * float(ball.pos[0] + ball.size[0]) / BALL_END

    def held(self, qpos: np.ndarray) -> np.ndarray:
        """Return the positions of the points of the hands (k, 3) [m]."""
        return self.look(qpos).site_xpos[self._holds].copy()

    def look(self, qpos: np.ndarray) -> mujoco.MjData:
        """Return the kinematics of a state (39,). They are valid until the next call."""
        self._data.qpos[:PERSON_QPOS] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        return self._data

    def step(
        self, plan: Plan, points: np.ndarray | None, soles: Sequence[np.ndarray] | None
    ) -> Plan:
        """Return the plan after one step.

        Args:
            plan: plan before the step.
            points: where the hands should hold (k, 3) [m]; None: no targets.
            soles: where the soles stand (4, 4) each [m]; None: they hang.
        """
        wishes = self._wishes
        residuals = Residuals(self._model, self.look(plan.qpos))
        if points is not None:
            residuals.hold(self._holds, points)
            residuals.gaze(points.mean(axis=0))
        for number, side in enumerate(SIDES):
            if soles is not None:
                residuals.stand(side, soles[number])
            if side not in wishes.hands and points is not None:
                residuals.rest_arm(side, wishes.seated)
        if not wishes.seated:
            residuals.stay_level()
            if soles is not None:
                over = [sole[:2, 3] + self._ahead * sole[:2, 0] for sole in soles]
                residuals.balance(np.mean(over, axis=0), wishes.balance)
        free = np.ones(PERSON_DOFS, dtype=bool)
        free[_BASE] = not wishes.seated
        change = self._solve(residuals, plan.qpos[7:], wishes.comfort, free, plan.damping)
        after = np.zeros(self._model.nq)
        after[:PERSON_QPOS] = plan.qpos
        after[PERSON_QPOS + 3] = 1.0
        velocity = np.zeros(self._model.nv)
        velocity[:PERSON_DOFS] = change
        mujoco.mj_integratePos(self._model, after, velocity, 1.0)
        after[7:PERSON_QPOS] = np.clip(after[7:PERSON_QPOS], _LOWEST, _HIGHEST)
        return plan.after(after[:PERSON_QPOS], change)

    def arms(self, qpos: np.ndarray, points: np.ndarray, plan: Plan) -> np.ndarray:
        """Return joints (32,) with the holding arms moved to bring the hands nearer to the points.

        The body does not move. Of all solutions the arms take the one nearest to the plan.

        Args:
            qpos: pelvis and joints now (39,).
            points: where the hands should hold (k, 3) [m].
            plan: plan of the whole posture.
        """
        free = np.zeros(PERSON_DOFS, dtype=bool)
        for side in self._wishes.hands:
            free[_ARMS[side]] = True
        residuals = Residuals(self._model, self.look(qpos))
        residuals.hold(self._holds, points)
        change = self._solve(residuals, qpos[7:], plan.qpos[7:], free, _DAMPING)
        return np.clip(qpos[7:] + change[6:], _LOWEST, _HIGHEST)

    def settle(
        self,
        qpos: np.ndarray,
        points: np.ndarray | None,
        soles: Sequence[np.ndarray] | None,
        steps: int = 120,
    ) -> Plan:
        """Return the plan to which repeated steps from a state (39,) lead."""
        plan = Plan(qpos)
        for _ in range(steps):
            plan = self.step(plan, points, soles)
            if plan.arrived:
                break
        return plan

    def misses(self, qpos: np.ndarray, points: np.ndarray) -> float:
        """Return the largest distance of a point of a hand from where it should hold [m]."""
        return float(np.linalg.norm(self.held(qpos) - points, axis=1).max())

    def _solve(
        self,
        residuals: Residuals,
        joints: np.ndarray,
        comfort: np.ndarray,
        free: np.ndarray,
        damping: float,
    ) -> np.ndarray:
        """Return the change (38,) of least cost within the ranges of the joints.

        Args:
            residuals: residuals to reduce.
            joints: joints now (32,) [rad].
            comfort: preferred joints (32,) [rad].
            free: coordinates that may change (38,) bool; it is modified.
            damping: cost of the change itself.
        """
        hessian, pull = residuals.normal()
        hessian[np.diag_indices(PERSON_DOFS)] += damping
        efforts = self._wishes.efforts
        hessian[np.arange(6, PERSON_DOFS), np.arange(6, PERSON_DOFS)] += efforts
        pull[6:] += efforts * (comfort - joints)
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
