"""The step's QP as tasks, constraints and limits of mink over person and arm, and its solution."""

from __future__ import annotations

from typing import Any, Final

import mink
import numpy as np
import qpsolvers

from ergoqp.whole_body.limits import ArmBounds, Distance, ProblemRows, TwistBounds
from ergoqp.whole_body.moment import Moment
from ergoqp.whole_body.scene import Scene
from ergoqp.whole_body.tasks import ErgonomicTask, Held, NullSpaceTask, ObjectTask, Tie, at_moment

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
        self._ergonomic, self._object, self._null = (
            ErgonomicTask(scene),
            ObjectTask(scene),
            NullSpaceTask(scene),
        )
        self._arm, self._twist, self._distance = (
            ArmBounds(scene),
            TwistBounds(scene),
            Distance(scene),
        )

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
        return mink.build_ik(
            self.configuration,
            tasks,
            moment.dt,
            damping=0.0,
            limits=limits,
            constraints=constraints,
        )

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
