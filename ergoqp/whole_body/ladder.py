"""What the arm does: the whole QP, or the closest fallback if not all limits can hold."""

from __future__ import annotations

import numpy as np

from ergoqp.problem.problem import Problem
from ergoqp.solvers.solver import FREE
from ergoqp.step.answer import Step
from ergoqp.whole_body.causes import held_back
from ergoqp.whole_body.formulation import Formulation
from ergoqp.whole_body.moment import Moment
from ergoqp.whole_body.robot import Robot
from ergoqp.whole_body.terms import SAME


class Ladder:
    """The QPs of a step in order; each is used if the one before has no answer.

    Args:
        problem: the task.
        robot: the arm.
        formulation: formulation of the QPs.
    """

    def __init__(self, problem: Problem, robot: Robot, formulation: Formulation) -> None:
        """Keep the arguments."""
        self._problem, self._robot, self._formulation = problem, robot, formulation

    def solve(
        self, object_step: Step, moment: Moment, done: np.ndarray
    ) -> tuple[np.ndarray, str, str]:
        """Try the QPs in order, from the whole QP to the separate stop of every joint.

        In between are the robot's limits with the speed limit of the object, and without it.
        """
        formulation, scene, robot = self._formulation, self._formulation.scene, self._robot
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
                return (
                    solved[arm],
                    "slower",
                    "held back by " + held_back(robot, scene, moment, solved),
                )
        # The object brakes, rests, or cannot keep all rows. The robot follows it as closely as
        # possible.
        wanted = object_step.twist if not whole else self._braking(done)
        effort = np.diag(
            np.repeat(
                [self._problem.control.effort_linear, self._problem.control.effort_angular], 3
            )
        )
        moment.H, moment.g = effort, -effort @ wanted
        for bound in (self._problem.twist_limit.speed, np.full(6, FREE)):
            moment.low, moment.high = -bound, bound
            if (solved := formulation.solve(moment, follow=False)) is None:
                continue
            twist = moment.jacobian @ solved[arm] - moment.offset
            if not whole and np.abs(twist - wanted).max() < SAME:
                return solved[arm], object_step.status, ""
            names = held_back(robot, scene, moment, solved)
            if whole:
                return solved[arm], "braking", f"robot and object cannot keep all limits: {names}"
            stops = object_step.status in ("braking", "invalid")
            return solved[arm], object_step.status if stops else "slower", f"held back by {names}"
        stop = np.clip(np.zeros(len(arm)), moment.arm_low, moment.arm_high)
        status = "invalid" if object_step.status == "invalid" else "braking"
        return (
            stop,
            status,
            "every joint of the robot stops by itself: the distance cannot be kept otherwise",
        )

    def _braking(self, previous: np.ndarray) -> np.ndarray:
        """Return the object's next braking twist, with its full deceleration."""
        stop = float(np.max(np.abs(previous) / self._problem.twist_limit.acceleration))
        return previous * max(0.0, 1 - self._problem.dt / stop) if stop > 0 else previous
