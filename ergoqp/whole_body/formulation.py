"""The step's QP as tasks, constraints and limits of mink, and what the arm does without a solution.

Objectives and equalities of the whole body, as tasks of mink. The unknown is the displacement of
one period.

Limits of the whole body as limits of mink. They are rows on the displacement of one period, G Delta
<= h.
"""

from __future__ import annotations

from typing import Any, Final

import mink
import numpy as np
import qpsolvers
from mink.tasks import BaseTask

from ergoqp.problem.problem import Problem
from ergoqp.solvers.solver import FREE
from ergoqp.step.answer import Step
from ergoqp.whole_body.scene import ModelColumns, Scene
from ergoqp.whole_body.state import SAME, Moment

_AT = 1e-7


def held_back(scene: Scene, moment: Moment, velocities: np.ndarray) -> str:
    """Return the names of the active limits of the robot and of the active distances.

    Args:
        scene: scene of person, robot and object.
        moment: data of the step.
        velocities: the answer, of person and arm together (nv,) [rad/s].
    """
    robot, arm = scene.robot, velocities[scene.arm]
    active = (arm > moment.arm_high - _AT) | (arm < moment.arm_low + _AT)
    at_rate = np.abs(arm) > robot.velocity - _AT
    at_change = np.abs(arm - moment.arm_speed) > robot.acceleration * moment.dt - _AT
    names = []
    for joint in np.flatnonzero(active):
        limit = "rate" if at_rate[joint] else "acceleration" if at_change[joint] else "range"
        names.append(f"the {limit} of {robot.joints[joint]}")
    close = moment.close
    if close is not None and len(close.pairs):
        standing = velocities.copy()
        standing[scene.person] = 0.0
        rates = np.maximum(-close.gradients @ velocities, -close.gradients @ standing)
        pairs = scene.pairs[close.pairs[rates > moment.approach - _AT]]
        names += [f"the distance of {scene.pair_name(pair)}" for pair in pairs]
    return ", ".join(names) or "the solver's accuracy"


TIE_WEIGHT = 1.0
"""Weight of the tie as a term in addition to the constraint [1/s^2].

The term is zero if the constraint holds, so it changes nothing. It makes the objective curved in
the person's unknowns, which solvers need.
"""

NULL_WEIGHT = 1e-3
"""Weight of the arm's null space, for an object effort of at least 1 [points / (rad/s)^2]."""


class _OfMoment:
    """A part of the QP that reads the data of the present step, see `at_moment`."""

    now: Moment

    def __init__(self, scene: ModelColumns) -> None:
        """Keep the columns of the model."""
        self.scene = scene


class _MomentTask(_OfMoment, BaseTask):
    """A task that reads the data of the present step."""

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
        now = self.now
        root = now.terms["root"] / now.dt
        return self._objective(self.scene.person[4:], root.T @ root, now.terms["slope"] / now.dt)


class ObjectTask(_MomentTask):
    """An objective of the object's twist, 1/2 xi' H xi + g' xi.

    It consists of effort R, smoothing, and lost contact.
    """

    def compute_qp_objective(self, configuration: mink.Configuration) -> mink.Objective:
        """Return curvature and slope in displacements of the arm."""
        now = self.now
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
        now = self.now
        N = np.eye(len(now.arm_wish)) - np.linalg.pinv(now.jacobian) @ now.jacobian
        weighted = NULL_WEIGHT * N / now.dt**2
        return self._objective(self.scene.arm, weighted, -weighted @ now.arm_wish * now.dt)


class _Rows(_OfMoment, mink.Task):
    """Linear rows that hold exactly when given to mink as constraints."""

    def __init__(self, scene: ModelColumns, count: int = 0) -> None:
        mink.Task.__init__(self, cost=np.full(count, np.sqrt(TIE_WEIGHT)))
        self.scene = scene


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
        return np.concatenate([self._follows() @ self.now.offset, np.zeros(len(self.scene.idle))])

    def compute_jacobian(self, configuration: mink.Configuration) -> np.ndarray:
        """Return the rows, scaled by the period like all terms."""
        now, count = self.now, len(self.scene.person)
        rows = np.zeros((len(self.cost), self.scene.model.nv))
        rows[:count, self.scene.person] = np.eye(count)
        rows[:count, self.scene.arm] = -self._follows() @ now.jacobian
        rows[count:, self.scene.idle] = np.eye(len(self.scene.idle))
        return rows / now.dt

    def _follows(self) -> np.ndarray:
        """Return how pelvis and joints follow the twist (36, 6)."""
        terms = self.now.terms
        return np.vstack([terms["carried"], terms["S"]])


class Held(_Rows):
    """Axes of the object that cannot move; the moment gives their number."""

    def compute_error(self, configuration: mink.Configuration) -> np.ndarray:
        """Return the error of each row without motion."""
        now = self.now
        return -(now.low + now.offset)[fixed_axes(now)]

    def compute_jacobian(self, configuration: mink.Configuration) -> np.ndarray:
        """Return the rows."""
        now = self.now
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
        part.now = moment


class _MomentLimit(_OfMoment, mink.Limit):
    """A limit that reads the data of the present step."""

    def _on_arm(
        self, rows: np.ndarray, low: np.ndarray, high: np.ndarray, dt: float
    ) -> mink.Constraint:
        """Return rows on the speeds of the arm, without infinite bounds."""
        rows, bounds = np.vstack([rows, -rows]), np.concatenate([high, -low])
        real = bounds < FREE / 2
        if not real.any():
            return mink.Constraint()
        G = np.zeros((int(real.sum()), self.scene.model.nv))
        G[:, self.scene.arm] = rows[real]
        return mink.Constraint(G, dt * bounds[real])


class TwistBounds(_MomentLimit):
    """Speed and acceleration of the object, axis by axis."""

    def compute_qp_inequalities(
        self, configuration: mink.Configuration, dt: float
    ) -> mink.Constraint:
        """Return two rows per axis that can move."""
        now = self.now
        free = now.high - now.low >= 1e-12
        J, aside = now.jacobian[free], now.offset[free]
        return self._on_arm(J, now.low[free] + aside, now.high[free] + aside, dt)


class ProblemRows(_MomentLimit):
    """The rows of the control step (joints, workspace, tool axis ...), lower <= A xi <= upper.

    If the step relaxes a row because braking itself would violate it, the row is widened by the
    slack of the step.
    """

    slack: np.ndarray | float = 0.0

    def compute_qp_inequalities(
        self, configuration: mink.Configuration, dt: float
    ) -> mink.Constraint:
        """Return up to two rows per row of the step."""
        now = self.now
        rows = now.terms["A"] @ now.jacobian
        moved = now.terms["side"] * self.slack + now.terms["A"] @ now.offset
        upper, lower = now.terms["ubA"] + moved, now.terms["lbA"] + moved
        return self._on_arm(rows, lower, upper, dt)


class ArmBounds(_MomentLimit):
    """Ranges with the exact stopping bound, rates and accelerations of the arm.

    See `ergoqp.whole_body.state`.
    """

    def compute_qp_inequalities(
        self, configuration: mink.Configuration, dt: float
    ) -> mink.Constraint:
        """Return two rows per joint."""
        now = self.now
        return self._on_arm(np.eye(len(now.arm_high)), now.arm_low, now.arm_high, dt)


class Distance(_MomentLimit):
    """Near pairs approach each other no faster than allowed.

    Each pair with the person has two rows. In one the person follows as in the model. In the other
    the person has not reacted yet and stands still.
    """

    def compute_qp_inequalities(
        self, configuration: mink.Configuration, dt: float
    ) -> mink.Constraint:
        """Return the rows in displacements: the rate times the period."""
        now = self.now
        if now.close is None or not len(now.close.pairs):
            return mink.Constraint()
        following = -now.close.gradients
        standing = following.copy()
        standing[:, self.scene.person] = 0.0
        return mink.Constraint(np.vstack([following, standing]), dt * np.tile(now.approach, 2))


SOLVER: Final = "daqp"
"""Name of the solver in qpsolvers."""
SETTINGS: Final[dict[str, Any]] = {"primal_tol": 1e-11, "dual_tol": 1e-11}
"""Settings of DAQP, so that twists are exact far below 1e-8."""
_KEPT: Final = 1e-7
"""Rows must hold up to this [m/s, rad/s], whatever status the solver reports."""


class Formulation:
    """The tasks and limits of one scene. They are kept over the steps; only the moment changes.

    Args:
        scene: person, robot and object.

    Attributes:
        configuration: mink's copy of all positions.
    """

    def __init__(self, scene: Scene) -> None:
        """Make every task and limit once."""
        self.scene = scene
        self.configuration = mink.Configuration(scene.model)
        self.rows = ProblemRows(scene)
        self._tie, self._held = Tie(scene), Held(scene)
        self._ergonomic = ErgonomicTask(scene)
        self._object = ObjectTask(scene)
        self._null = NullSpaceTask(scene)
        self._arm = ArmBounds(scene)
        self._twist = TwistBounds(scene)
        self._distance = Distance(scene)

    def build(self, moment: Moment, follow: bool) -> qpsolvers.Problem:
        """Return the QP as mink builds it.

        Args:
            moment: data of this step.
            follow: True: the object's whole step, cost and rows. False: only the object's
                objective, the bounds of its twist in `moment`, and the robot's limits.
        """
        tasks = [self._object, self._null, self._tie]
        limits: list[mink.Limit] = [self._arm, self._distance, self._twist]
        constraints: list[mink.Task] = [self._tie]
        if follow:
            tasks.append(self._ergonomic)
            limits.append(self.rows)
            constraints.append(self._held)
        at_moment([*tasks, *limits, self._held], moment)
        rows = {"limits": limits, "constraints": constraints}
        return mink.build_ik(self.configuration, tasks, moment.dt, damping=0.0, **rows)

    def solve(self, moment: Moment, follow: bool) -> np.ndarray | None:
        """Return all velocities (nv,); None if the rows cannot all hold or the solver fails."""
        problem = self.build(moment, follow)
        try:
            solution = qpsolvers.solve_problem(problem, solver=SOLVER, **SETTINGS)
        except Exception:  # solvers differ in what they raise on data without a solution
            return None
        if not solution.found or solution.x is None or not np.isfinite(solution.x).all():
            return None
        return solution.x / moment.dt if _holds(problem, solution.x, moment.dt) else None


def _holds(problem: qpsolvers.Problem, x: np.ndarray, dt: float) -> bool:
    beyond = 0.0
    if problem.G is not None:
        beyond = float(np.max(problem.G @ x - problem.h, initial=0.0))
    if problem.A is not None:
        # Equalities are scaled by the period already.
        beyond = max(beyond, dt * float(np.max(np.abs(problem.A @ x - problem.b), initial=0.0)))
    return beyond <= _KEPT * dt


def solve_ladder(
    problem: Problem, formulation: Formulation, object_step: Step, moment: Moment, done: np.ndarray
) -> tuple[np.ndarray, str, str]:
    """Try the QPs of a step in order; each is used if the one before has no answer.

    They lead from the whole QP to the separate stop of every joint. In between are the robot's
    limits with the speed limit of the object, and without it.

    Args:
        problem: the task.
        formulation: formulation of the QPs.
        object_step: the object's own step.
        moment: data of this step; its objective and bounds change on the way.
        done: twist of the object in the last period (6,) [m/s, rad/s].

    Returns:
        Speeds of the arm's joints (k,) [rad/s], status, and cause in words.
    """
    scene, limit = formulation.scene, problem.twist_limit
    arm = scene.arm
    whole = (
        object_step.status in ("optimal", "relaxed", "recovering")
        and object_step.residuals["accepted"] == 1.0
    )
    if whole:
        solved = formulation.solve(moment, follow=True)
        if solved is not None:
            twist = moment.jacobian @ solved[arm] - moment.offset
            if np.abs(twist - object_step.twist).max() < SAME:
                return solved[arm], object_step.status, ""
            names = held_back(scene, moment, solved)
            return solved[arm], "slower", f"held back by {names}"
    # The object brakes, rests, or cannot keep all rows. The robot follows it as closely as
    # possible.
    wanted, control = object_step.twist, problem.control
    if whole:
        braking = float(np.max(np.abs(done) / limit.acceleration))
        wanted = done * max(0.0, 1 - problem.dt / braking) if braking > 0 else done
    effort = np.diag(np.repeat([control.effort_linear, control.effort_angular], 3))
    moment.H, moment.g = effort, -effort @ wanted
    for bound in (limit.speed, np.full(6, FREE)):
        moment.low, moment.high = -bound, bound
        if (solved := formulation.solve(moment, follow=False)) is None:
            continue
        twist = moment.jacobian @ solved[arm] - moment.offset
        if not whole and np.abs(twist - wanted).max() < SAME:
            return solved[arm], object_step.status, ""
        names = held_back(scene, moment, solved)
        if whole:
            return solved[arm], "braking", f"robot and object cannot keep all limits: {names}"
        stops = object_step.status in ("braking", "invalid")
        return solved[arm], object_step.status if stops else "slower", f"held back by {names}"
    stop = np.clip(np.zeros(len(arm)), moment.arm_low, moment.arm_high)
    status = "invalid" if object_step.status == "invalid" else "braking"
    why = "every joint of the robot stops by itself: the distance cannot be kept otherwise"
    return stop, status, why
