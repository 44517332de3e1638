"""The step's QP through mink, for comparison: same terms, inputs and twist, arm joints as unknowns.

`mink_steps` does it in two ways. ``"arm"`` is the leanest that mink offers: only the seven joints
of the arm are unknown and all terms act on the twist. ``"whole"`` is the formulation of
`ergoqp.whole_body`: posture, pelvis and arm are unknown, and the tie S xi is an equality. What mink
needs (tasks, limits, configuration) is kept over the steps in both.

Included is what a step needs from its inputs to the twist: the terms (cost, response, rows: the
same CasADi functions as in the fast step), the kinematics, mink's building of the QP and its
solution by DAQP. Not included, though the fast step does it: input checks, certification, locking.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import mink
import mujoco
import numpy as np

from ergoqp.expressions import Evaluator
from ergoqp.problem.problem import Problem
from ergoqp.step.qp import qp_data
from ergoqp.step.stepper import Stepper
from ergoqp.whole_body.formulation import (
    SETTINGS,
    SOLVER,
    ArmBounds,
    Formulation,
    Held,
    NullSpaceTask,
    ObjectTask,
    ProblemRows,
    TwistBounds,
    at_moment,
)
from ergoqp.whole_body.grasp import default_base
from ergoqp.whole_body.robot import Robot, load_robot
from ergoqp.whole_body.scene import Load, Scene, carry, default_tool_frame
from ergoqp.whole_body.state import (
    Moment,
    joint_bounds,
    own_objective,
    pelvis_function,
    person_of,
    terms_function,
)

Call = tuple[Any, Any, float]
Solver = Callable[[dict[str, Any]], tuple[np.ndarray, float]]


@dataclass(frozen=True)
class PeerTimes:
    """What a peer took for the steps of a trajectory.

    Attributes:
        whole_us: from the inputs to the twist, one entry per step [us].
        own_us: the peer's own part of it, building and solving the QP [us].
        difference: largest difference of any twist from that of the fast step [m/s, rad/s].
    """

    whole_us: np.ndarray
    own_us: np.ndarray
    difference: float


class ArmColumns:
    """The arm alone, with its load, as tasks and limits see a model."""

    def __init__(self) -> None:
        """Load the arm and give it an object."""
        self.robot = load_robot("panda")
        carry(self.robot.spec, self.robot, Load(default_tool_frame(0.0)))
        self.model = self.robot.spec.compile()
        self.arm = np.arange(self.model.nv)
        self.person = self.idle = np.zeros(0, dtype=int)


def mink_steps(
    problem: Problem, calls: Sequence[Call], unknowns: Literal["arm", "whole"] = "arm"
) -> PeerTimes:
    """Time mink on the QPs of a recorded trajectory.

    Counted are the steps in which the fast step's answer is that of its first QP and goes out as it
    is: status ``optimal``, no joint locked, no row relaxed. The arm stays in one posture; every
    step still computes its kinematics anew. The trajectory is gone through twice, and the first
    time not counted.

    Args:
        problem: the task.
        calls: (posture, pose, age) of every step, as `benchmarks.step.trajectory` records them.
        unknowns: ``"arm"`` or ``"whole"``, see above.
    """
    return timed(
        problem, calls, _ArmSolver(problem) if unknowns == "arm" else _WholeSolver(problem)
    )


def timed(problem: Problem, calls: Sequence[Call], solver: Solver) -> PeerTimes:
    """Return the times of a peer, and how far its twists are from those of the fast step.

    Args:
        problem: the task.
        calls: of the trajectory.
        solver: answers what `questions` gives with a twist (6,), and the seconds that the peer
            itself took.
    """
    given = questions(problem, calls)
    whole, part, difference = np.zeros(len(given)), np.zeros(len(given)), 0.0
    for _ in ("warm-up", "counted"):
        for i, (question, answer) in enumerate(given):
            begin = time.perf_counter()
            twist, part[i] = solver(question)
            whole[i] = time.perf_counter() - begin
            difference = max(difference, float(np.abs(twist - answer).max()))
    return PeerTimes(1e6 * whole, 1e6 * part, difference)


def questions(problem: Problem, calls: Sequence[Call]) -> list[tuple[dict[str, Any], np.ndarray]]:
    """What `qp_data` takes in every counted step, and the fast step's twist."""
    stepper, data, given = Stepper(problem), Evaluator(qp_data(problem)), []
    previous = np.zeros(6)
    for posture, pose, age in calls:
        unimproved = stepper.stalled
        step = stepper.step(posture, pose, age=age)
        question = {
            "posture": posture,
            "observed": np.ones(len(posture)),
            "pose": step.pose,
            "previous": previous,
        }
        question |= {
            "dt": problem.dt,
            "stalled": unimproved,
            "locked": np.zeros(len(posture)),
            "final": 0.0,
        }
        plain = step.status == "optimal" and step.residuals["accepted"] == 1 and not step.locked
        if plain and not data(question)["cap"].any():
            given.append((question, step.twist))
        previous = step.twist
    return given


class _ArmSolver:
    """The arm alone: one trajectory's tasks and limits, kept over the steps."""

    def __init__(self, problem: Problem) -> None:
        self._dt, self._terms, self._scene = problem.dt, Evaluator(qp_data(problem)), ArmColumns()
        self._configuration = mink.Configuration(self._scene.model)
        self._tasks = [ObjectTask(self._scene), NullSpaceTask(self._scene)]
        self._limits = [TwistBounds(self._scene), ProblemRows(self._scene), ArmBounds(self._scene)]
        # Axes that cannot move are equalities; where all move there is no constraint to build.
        self._constraints = [Held(self._scene)] if (problem.twist_limit.speed == 0).any() else []
        self._site = self._scene.model.site("contact").id
        self._jacobian = np.zeros((6, self._scene.model.nv))

    def __call__(self, question: dict[str, Any]) -> tuple[np.ndarray, float]:
        """Return the twist (6,), and the seconds that mink itself took."""
        terms, J, configuration = self._terms(question), self._jacobian, self._configuration
        configuration.update(self._scene.robot.rest)
        mujoco.mj_jacSite(self._scene.model, configuration.data, J[:3], J[3:], self._site)
        moment = resting(self._scene.robot, self._dt, J, terms, terms["H"], terms["g"])
        begin = time.perf_counter()
        at_moment([*self._tasks, *self._limits, *self._constraints], moment)
        settings = {
            "limits": self._limits,
            "constraints": self._constraints,
            "damping": 0.0,
        } | SETTINGS
        velocity = mink.solve_ik(configuration, self._tasks, self._dt, SOLVER, **settings)
        took = time.perf_counter() - begin
        return J @ velocity, took


class _WholeSolver:
    """Person and arm: the formulation of `ergoqp.whole_body`."""

    def __init__(self, problem: Problem) -> None:
        person, robot = person_of(problem), load_robot("panda")
        base, load = default_base(problem, 0.20), Load(default_tool_frame(0.0))
        self._dt, self._terms, self._pelvis = (
            problem.dt,
            Evaluator(terms_function(problem)),
            pelvis_function(person),
        )
        self._scene = Scene(person.body, robot, base, load, person.hands)
        self._formulation = Formulation(self._scene)

    def __call__(self, question: dict[str, Any]) -> tuple[np.ndarray, float]:
        """Return the twist (6,), and the seconds that mink itself took."""
        terms, scene, formulation = self._terms(question), self._scene, self._formulation
        pelvis = np.array(self._pelvis(question["posture"])[0]).ravel()
        formulation.configuration.update(scene.qpos(pelvis, question["posture"], scene.robot.rest))
        jacobian = np.zeros((6, scene.model.nv))
        mujoco.mj_jacSite(
            scene.model,
            formulation.configuration.data,
            jacobian[:3],
            jacobian[3:],
            scene.contact_site,
        )
        H, g = own_objective(terms)
        moment = resting(scene.robot, self._dt, jacobian[:, scene.arm], terms, H, g)
        begin = time.perf_counter()
        velocity = formulation.solve(moment, follow=True)
        took = time.perf_counter() - begin
        if velocity is None:
            raise RuntimeError("mink did not solve a QP that the fast step solved")
        return moment.jacobian @ velocity[scene.arm], took


def resting(
    robot: Robot,
    dt: float,
    J: np.ndarray,
    terms: dict[str, np.ndarray],
    H: np.ndarray,
    g: np.ndarray,
) -> Moment:
    """Return a moment in which the arm rests and has no limit near.

    The limits of the twist alone decide, as in the fast step.
    """
    still = np.zeros(len(robot.joints))
    fast, ranges = np.full(len(still), 1e3), (robot.lower - 50, robot.upper + 50)
    low, high = joint_bounds(robot.rest, still, ranges, fast, 100 * fast, dt)
    return Moment(dt, J, terms, H, g, terms["lb"], terms["ub"], still, low, high, still)
