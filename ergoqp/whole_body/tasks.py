"""Objectives and equalities of the whole body, as tasks of mink.

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
"""Weight of the tie as a term in addition to the constraint [1/s^2].

The term is zero if the constraint holds, so it changes nothing. It makes the objective curved in
the person's unknowns, which solvers need.
"""

NULL_WEIGHT = 1e-3
"""Weight of the arm's null space, for an object effort of at least 1 [points / (rad/s)^2]."""


class _MomentTask(BaseTask):
    """A task that reads the data of the present step."""

    def __init__(self, scene: ModelColumns) -> None:
        self.scene = scene
        self.moment: Moment | None = None

    def _now(self) -> Moment:
        assert self.moment is not None  # set at the start of every step
        return self.moment

    def _objective(self, columns: np.ndarray, H: np.ndarray, c: np.ndarray) -> mink.Objective:
        """Return a small objective as one of all velocities."""
        nv = self.scene.model.nv
        full_H, full_c = np.zeros((nv, nv)), np.zeros(nv)
        full_H[np.ix_(columns, columns)], full_c[columns] = H, c
        return mink.Objective(full_H, full_c)


class ErgonomicTask(_MomentTask):
    """Cost of the posture over the look-ahead T, in the joints of the person.

    It is T dV/dq' v + 1/2 T^2 v' B v for joint rates v.

    B is the Gauss-Newton curvature of V, kept finite near the smallest cost by the step's caution,
    see `ergoqp.step.objective`. It acts on the unknowns of the posture. The tie transfers
    it to the object through S.
    """

    def compute_qp_objective(self, configuration: mink.Configuration) -> mink.Objective:
        """Return curvature and slope in displacements."""
        now = self._now()
        root = now.terms["root"] / now.dt
        return self._objective(self.scene.person[4:], root.T @ root, now.terms["slope"] / now.dt)


class ObjectTask(_MomentTask):
    """An objective of the object's twist, 1/2 xi' H xi + g' xi.

    It consists of effort R, smoothing, and lost contact.
    """

    def compute_qp_objective(self, configuration: mink.Configuration) -> mink.Objective:
        """Return curvature and slope in displacements of the arm."""
        now = self._now()
        J = now.jacobian / now.dt
        return self._objective(self.scene.arm, J.T @ now.H @ J, J.T @ (now.g - now.H @ now.offset))


class NullSpaceTask(_MomentTask):
    """The second level: what the arm does in addition to the twist.

    It is 1/2 |N (dq - wish)|^2 with N = I - J^+ J.

    N removes everything that moves the object. So the two levels do not affect each other, and one
    QP solves both exactly, as long as no limit of the robot is active. If one is, the twist may
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
        assert self.moment is not None  # set at the start of every step
        return self.moment


class Tie(_Rows):
    """The person follows the object.

    Pelvis and joints move exactly by (carried, S) xi with xi = J dq - offset.

    With contact alone, the QP would choose among all postures that keep the contact, as if the
    robot moved the person. Joints of the robot's file that the arm does not use, such as fingers,
    are tied to rest.
    """

    def __init__(self, scene: ModelColumns) -> None:
        """Make 36 rows, and one per idle joint."""
        super().__init__(scene, len(scene.person) + len(scene.idle))

    def compute_error(self, configuration: mink.Configuration) -> np.ndarray:
        """Return the motion due to the offset.

        There is no drift, because the posture is measured again in every step.
        """
        return np.concatenate(
            [self._follows() @ self._now().offset, np.zeros(len(self.scene.idle))]
        )

    def compute_jacobian(self, configuration: mink.Configuration) -> np.ndarray:
        """Return the rows, scaled by the period like all terms."""
        now, count = self._now(), len(self.scene.person)
        rows = np.zeros((len(self.cost), self.scene.model.nv))
        rows[:count, self.scene.person] = np.eye(count)
        rows[:count, self.scene.arm] = -self._follows() @ now.jacobian
        rows[count:, self.scene.idle] = np.eye(len(self.scene.idle))
        return rows / now.dt

    def _follows(self) -> np.ndarray:
        """Return how pelvis and joints follow the twist (36, 6)."""
        terms = self._now().terms
        return np.vstack([terms["carried"], terms["S"]])


class Held(_Rows):
    """Axes of the object that cannot move."""

    def __init__(self, scene: ModelColumns) -> None:
        """Start without rows; the moment gives their number."""
        super().__init__(scene, 0)

    def compute_error(self, configuration: mink.Configuration) -> np.ndarray:
        """Return the error of each row without motion."""
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
    """Set the data of the step in all tasks and limits."""
    for part in parts:
        part.moment = moment
