"""The posture that a person with mass wants, and the way there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import mujoco
import numpy as np

from ergoqp.joints import INDEX, JOINTS, LOWER, SIDES, UPPER
from ergoqp.lab.mass.body import BALL_END, HABITS, PERSON_DOFS, cross, holding_points
from ergoqp.problem.geometry import rotation_vector

PERSON_QPOS: Final = 7 + len(JOINTS)
"""Number of coordinates: pelvis position and quaternion, then the joints."""

_DAMPING: Final = 0.5
"""Least cost of a step itself, per rad^2 or m^2, because a step ignores how the frames turn."""

_MORE, _LESS = 4.0, 0.6
"""Factors on this cost: if a step reverses the last one, as at the end of reach, and if not."""

_BACK: Final = -0.3
"""A step with a lower cosine to the last step counts as reversing it."""

_ARRIVED: Final = 1e-3
"""Change of all joints below which a plan has arrived [rad]."""


@dataclass(frozen=True)
class Plan:
    """A wanted posture on the way to its optimum.

    Attributes:
        qpos: pelvis and joints (39,).
        change: change by the last step (38,) [m, rad].
        damping: cost of the next step itself.
    """

    qpos: np.ndarray
    change: np.ndarray = field(default_factory=lambda: np.full(PERSON_DOFS, np.inf))
    damping: float = _DAMPING

    @property
    def arrived(self) -> bool:
        """Whether the last step changed almost nothing."""
        return bool(np.abs(self.change).max() < _ARRIVED)

    def after(self, qpos: np.ndarray, change: np.ndarray) -> Plan:
        """Return the plan after a step to a state (39,) with this change (38,)."""
        sizes = float(np.linalg.norm(change) * np.linalg.norm(self.change))
        back = np.isfinite(sizes) and change @ self.change < _BACK * sizes
        damping = self.damping * _MORE if back else max(_DAMPING, self.damping * _LESS)
        return Plan(qpos, change, damping)


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
_ARM_JOINTS: Final = {
    side: [6 + INDEX[name] for name in JOINTS[6:20] if name.startswith(side)] for side in SIDES
}
_WRIST: Final = {side: 6 + INDEX[f"{side}_wrist_deviation"] for side in SIDES}
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
        self._add(jacobian[3:], _capped(rotation_vector(have, sole[:3, :3]), 0.3), _TURNED_SOLES)

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
        wrist = self._site(f"{side}_wrist")
        arm = [joint for joint in _ARM_JOINTS[side] if joint != _WRIST[side]]
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


@dataclass(frozen=True)
class Wishes:
    """The costs by which one person chooses a posture.

    Attributes:
        comfort: posture with nothing to reach for (32,) [rad].
        efforts: cost of a deviation from it (32,), per rad^2.
        balance: cost of a distance of the centre of mass from the middle of the soles, per
            m^2.
        hands: hands that hold the object.
        seated: whether the pelvis stays on a seat.
    """

    comfort: np.ndarray
    efforts: np.ndarray
    balance: float
    hands: tuple[str, ...]
    seated: bool


_LONGEST: Final = 0.25
"""Largest change of a joint in one step [rad]."""

# A joint with a target exactly at its end would be pushed beyond it by the weight on it.
_INSET: Final = np.radians(2.0)
_LOWEST: Final = LOWER + _INSET
_HIGHEST: Final = UPPER - _INSET


class Planner:
    """Damped Gauss-Newton steps toward the posture that a person wants.

    Args:
        model: model of the person, from `ergoqp.lab.mass.body.build`.
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
        free[:6] = not wishes.seated
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
            free[_ARM_JOINTS[side]] = True
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
