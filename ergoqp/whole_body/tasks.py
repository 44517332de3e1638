"""What the whole body minimises and ties together, as tasks of mink.

The unknown is the displacement of one period.
"""

from __future__ import annotations

from typing import Any

import mink
import numpy as np
from mink.tasks import BaseTask

from ergoqp.whole_body.moment import Moment
from ergoqp.whole_body.scene import ModelColumns

TIE_WEIGHT = 1.0
"""Weight of the tie as a term beside the constraint [1/s^2].

The term is zero wherever the constraint holds and changes nothing, but makes the objective curved
in the person's unknowns, which solvers want.
"""

NULL_WEIGHT = 1e-3
"""Weight of the arm's null space against an object effort of 1 and more [points / (rad/s)^2]."""


class _MomentTask(BaseTask):
    """A task that reads the present moment."""

    def __init__(self, scene: ModelColumns) -> None:
        self.scene = scene
        self.moment: Moment | None = None

    def _now(self) -> Moment:
        assert self.moment is not None  # set at the begin of every step
        return self.moment

    def _objective(self, columns: np.ndarray, H: np.ndarray, c: np.ndarray) -> mink.Objective:
        """Put a small objective into that of all velocities."""
        nv = self.scene.model.nv
        full_H, full_c = np.zeros((nv, nv)), np.zeros(nv)
        full_H[np.ix_(columns, columns)], full_c[columns] = H, c
        return mink.Objective(full_H, full_c)


class ErgonomicTask(_MomentTask):
    """The posture's cost over the look-ahead T, in the person's joints.

    It is T dV/dq' v + 1/2 T^2 v' B v for joint rates v.

    B is Gauss-Newton on V, made finite near the least cost by the step's caution, see
    `ergoqp.step.program.objective`. It acts on the posture's own unknowns, as a cost of the posture
    should; the tie makes the object feel it through S.
    """

    def compute_qp_objective(self, configuration: mink.Configuration) -> mink.Objective:
        """Return curvature and slope in displacements."""
        now = self._now()
        root = now.terms["root"] / now.dt
        return self._objective(self.scene.person[4:], root.T @ root, now.terms["slope"] / now.dt)


class ObjectTask(_MomentTask):
    """An objective of the object's twist, 1/2 xi' H xi + g' xi.

    It holds effort R, smoothing, and contact that would be lost.
    """

    def compute_qp_objective(self, configuration: mink.Configuration) -> mink.Objective:
        """Return curvature and slope in displacements of the arm."""
        now = self._now()
        J = now.jacobian / now.dt
        return self._objective(self.scene.arm, J.T @ now.H @ J, J.T @ (now.g - now.H @ now.offset))


class NullSpaceTask(_MomentTask):
    """The second level: what the arm does beside the twist.

    It is 1/2 |N (dq - wish)|^2 with N = I - J^+ J.

    N takes everything out that moves the object, so the two levels do not see each other and one QP
    solves both, exactly, as long as no limit of the robot is active. Where one is, the twist may
    give way by about `NULL_WEIGHT` over the effort.
    """

    def compute_qp_objective(self, configuration: mink.Configuration) -> mink.Objective:
        """Return curvature and slope in displacements of the arm."""
        now = self._now()
        N = np.eye(len(now.arm_wish)) - np.linalg.pinv(now.jacobian) @ now.jacobian
        weighted = NULL_WEIGHT * N / now.dt**2
        return self._objective(self.scene.arm, weighted, -weighted @ now.arm_wish * now.dt)


class _Rows(mink.Task):
    """Linear rows that hold exactly when given to mink as constraints."""

    def __init__(self, scene: ModelColumns, count: int) -> None:
        super().__init__(cost=np.full(count, np.sqrt(TIE_WEIGHT)))
        self.scene = scene
        self.moment: Moment | None = None

    def _now(self) -> Moment:
        assert self.moment is not None  # set at the begin of every step
        return self.moment


class Tie(_Rows):
    """The person follows the object.

    Pelvis and joints move by (carried, S) xi with xi = J dq - offset, in no other way.

    Contact alone would let the QP choose among all postures that keep the contact, as if the robot
    moved the person. Joints of the robot's file that the arm does not use, such as fingers, are
    tied to rest.
    """

    def __init__(self, scene: ModelColumns) -> None:
        """Make 36 rows, and one per idle joint."""
        super().__init__(scene, len(scene.person) + len(scene.idle))

    def compute_error(self, configuration: mink.Configuration) -> np.ndarray:
        """Return what the offset would make them do.

        Nothing drifts: the posture is measured anew in every step.
        """
        return np.concatenate(
            [self._follows() @ self._now().offset, np.zeros(len(self.scene.idle))]
        )

    def compute_jacobian(self, configuration: mink.Configuration) -> np.ndarray:
        """Return the rows, scaled by the period as all terms are."""
        now, count = self._now(), len(self.scene.person)
        rows = np.zeros((len(self.cost), self.scene.model.nv))
        rows[:count, self.scene.person] = np.eye(count)
        rows[:count, self.scene.arm] = -self._follows() @ now.jacobian
        rows[count:, self.scene.idle] = np.eye(len(self.scene.idle))
        return rows / now.dt

    def _follows(self) -> np.ndarray:
        """How pelvis and joints follow the twist (36, 6)."""
        terms = self._now().terms
        return np.vstack([terms["carried"], terms["S"]])


class Held(_Rows):
    """Axes of the object that have no choice: those that cannot move."""

    def __init__(self, scene: ModelColumns) -> None:
        """Start without rows; how many there are, the moment tells."""
        super().__init__(scene, 0)

    def compute_error(self, configuration: mink.Configuration) -> np.ndarray:
        """Return how far each row is from what it must be, at no motion."""
        now = self._now()
        return -(now.low + now.offset)[fixed_axes(now)]

    def compute_jacobian(self, configuration: mink.Configuration) -> np.ndarray:
        """Return the rows."""
        now = self._now()
        axes = fixed_axes(now)
        moving = np.zeros((len(axes), self.scene.model.nv))
        moving[:, self.scene.arm] = now.jacobian[axes] / now.dt
        return moving


def fixed_axes(now: Moment) -> np.ndarray:
    """Return the numbers of the axes whose least and greatest twist are the same."""
    return np.flatnonzero(now.high - now.low < 1e-12)


def at_moment(parts: list[Any], moment: Moment) -> None:
    """Let tasks and limits read a moment."""
    for part in parts:
        part.moment = moment
