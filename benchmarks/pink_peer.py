"""The step's QP through pink, as `benchmarks.mink_peer` through mink, arm joints as the unknowns.

Pink can express the same: a `Task` with its own `compute_qp_objective`, limits as rows on
displacements, exact rows as `constraints`. The kinematics are Pinocchio's, of the same
``models/panda.xml``; terms, matrices and rows are the same numbers.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import pink
import pinocchio as pin
from pink.limits import Limit
from pink.tasks import Task

from benchmarks.mink_peer import ArmColumns, Call, PeerTimes, resting, timed
from ergoqp.expressions import Evaluator
from ergoqp.problem.problem import Problem
from ergoqp.registry import data_folder
from ergoqp.step.qp import qp_data
from ergoqp.whole_body.formulation import (
    SETTINGS,
    SOLVER,
    ArmBounds,
    Held,
    NullSpaceTask,
    ObjectTask,
    ProblemRows,
    TwistBounds,
    at_moment,
)
from ergoqp.whole_body.scene import default_tool_frame


class _Objective(Task):
    """An objective of ours, as pink asks for it."""

    def __init__(self, ours: Any) -> None:
        super().__init__()
        self._ours = ours

    def compute_error(self, configuration: Any) -> np.ndarray:
        return self._ours.compute_error(configuration)

    def compute_jacobian(self, configuration: Any) -> np.ndarray:
        return self._ours.compute_jacobian(configuration)

    def compute_qp_objective(self, configuration: Any) -> tuple[np.ndarray, np.ndarray]:
        found = self._ours.compute_qp_objective(configuration)
        return found.H, found.c

    # Pink's own tasks return a text too.
    def __repr__(self) -> str:  # pyright: ignore[reportIncompatibleMethodOverride]
        return repr(self._ours)


class _Rows(Limit):
    """Rows of ours, as pink asks for them."""

    def __init__(self, ours: Any) -> None:
        self._ours = ours

    def compute_qp_inequalities(
        self, configuration: Any, dt: float
    ) -> tuple[np.ndarray, np.ndarray] | None:
        found = self._ours.compute_qp_inequalities(configuration, dt)
        return None if found.inactive else (found.G, found.h)


class _PinkSolver:
    """One trajectory's model, tasks and limits, kept over the steps."""

    def __init__(self, problem: Problem) -> None:
        self._dt, self._terms, self._columns = problem.dt, Evaluator(qp_data(problem)), ArmColumns()
        self._model = pin.buildModelFromMJCF(str(data_folder("models") / "panda.xml"))
        flange = self._model.frames[self._model.getFrameId("flange")]
        contact = flange.placement * pin.SE3(default_tool_frame(0.0))
        self._contact = self._model.addFrame(
            pin.Frame("contact", flange.parentJoint, contact, pin.FrameType.OP_FRAME)
        )
        rest = self._columns.robot.rest
        self._configuration = pink.Configuration(self._model, self._model.createData(), rest)
        tasks, limits = (
            [ObjectTask(self._columns), NullSpaceTask(self._columns)],
            [TwistBounds, ProblemRows, ArmBounds],
        )
        rows = [limit(self._columns) for limit in limits]
        held = [Held(self._columns)] if (problem.twist_limit.speed == 0).any() else []
        self._ours = [*tasks, *rows, *held]
        self._tasks, self._constraints = (
            [_Objective(task) for task in tasks],
            [_Objective(task) for task in held],
        )
        self._limits = [_Rows(limit) for limit in rows]

    def __call__(self, question: dict[str, Any]) -> tuple[np.ndarray, float]:
        """Return the twist (6,), and the seconds that pink itself took."""
        terms, configuration, robot = (
            self._terms(question),
            self._configuration,
            self._columns.robot,
        )
        configuration.update(robot.rest)
        aligned = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        J = pin.getFrameJacobian(configuration.model, configuration.data, self._contact, aligned)
        moment = resting(robot, self._dt, J, terms, terms["H"], terms["g"])
        begin = time.perf_counter()
        at_moment(self._ours, moment)
        settings = {
            "limits": self._limits,
            "constraints": self._constraints,
            "damping": 0.0,
        } | SETTINGS
        velocity = pink.solve_ik(configuration, self._tasks, self._dt, SOLVER, **settings)
        took = time.perf_counter() - begin
        return J @ velocity, took


def pink_steps(problem: Problem, calls: Sequence[Call]) -> PeerTimes:
    """Time pink on the QPs of a recorded trajectory; see `benchmarks.mink_peer.mink_steps`."""
    return timed(problem, calls, _PinkSolver(problem))
