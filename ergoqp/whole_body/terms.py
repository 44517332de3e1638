"""The terms of the control step, evaluated for the whole-body formulation.

They are the data of its QP, and how person and pelvis follow.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import casadi as ca
import numpy as np

from ergoqp.arguments import check_kind
from ergoqp.errors import ProblemError
from ergoqp.expressions.evaluator import Evaluator
from ergoqp.joints import JOINTS
from ergoqp.problem.problem import Problem
from ergoqp.responses.ik import IkResponse
from ergoqp.solvers import solver_named
from ergoqp.step.answer import Step
from ergoqp.step.model import StepModel
from ergoqp.step.objective import CAUTION_EPS, cost_function
from ergoqp.step.qp import QP_DATA, build_qp, movable_names, qp_data

SAME: Final = 1e-6
"""Twists this close to each other count as equal [m/s, rad/s]."""


def person_of(problem: Problem) -> IkResponse:
    """Return the person of a problem.

    Raises:
        ProblemError: if its state is not the posture of a person with a body.
        InputError: if the argument is not a Problem.
    """
    check_kind("problem", problem, Problem, "a Problem, such as ergoqp.load_problem gives")
    response = problem.response
    if not isinstance(response, IkResponse):
        raise ProblemError(
            f"whole body: got a response of type {type(response).__name__}, allowed IkResponse: a"
            " person's body"
        )
    return response


def terms_function(problem: Problem) -> ca.Function:
    """Return everything that the whole-body QP takes from the control step, as one function.

    Its inputs are those of `ergoqp.step.qp.qp_data`. In addition to the data of that
    function it returns

    - ``slope`` (32,): T dV/dq, the slope of the cost for each joint [points s/rad];
    - ``root`` (33, 32): a matrix whose Gram matrix is T^2 B, the step's curvature in the posture;
    - ``carried`` (4, 6): how the pelvis follows the object, from the model's stance and S.

    Raises:
        ProblemError: if the state is not the posture of a person with a body.
    """
    place = pelvis_function(person_of(problem))
    data = qp_data(problem)
    given = [ca.MX.sym(data.name_in(i), data.sparsity_in(i)) for i in range(data.n_in())]
    posture, observed = given[0], given[1]
    parts = dict(zip((data.name_out(i) for i in range(data.n_out())), data(*given), strict=True))
    _, value, gradient = cost_function(StepModel(problem))(posture, observed)
    ahead, control = problem.control.look_ahead, problem.control
    excess = ca.fmax(value - problem.cost.minimum, 0) + CAUTION_EPS
    caution = ahead * np.sqrt(control.caution * problem.response.weight_vector)
    parts["slope"] = ahead * gradient
    parts["root"] = ca.vertcat(
        ahead * gradient.T / ca.sqrt(2 * excess), ca.MX(ca.diag(ca.DM(caution)))
    )
    parts["carried"] = place(posture)[1] @ parts["S"]
    names = [data.name_in(i) for i in range(data.n_in())]
    return ca.Function(
        "terms", given, [ca.densify(part) for part in parts.values()], names, list(parts)
    )


def own_objective(terms: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return curvature (6, 6) and slope (6,) of the object's part of the step's objective.

    The part consists of effort, smoothing and contact. It is what remains without the part of the
    posture, which acts on the person's joints through S.
    """
    root = terms["root"] @ terms["S"]
    return terms["H"] - root.T @ root, terms["g"] - terms["S"].T @ terms["slope"]


def pelvis_function(person: IkResponse) -> ca.Function:
    """Return ``q (32,) -> (pelvis x, y, z [m] and yaw [rad] (4,), its derivative (4, 32))``.

    It follows from the person's stance.
    """
    q = ca.SX.sym("q", len(JOINTS))
    pose = person.contact()(q)[1]
    place = ca.densify(ca.vertcat(pose[:3, 3], ca.atan2(pose[1, 0], pose[0, 0])))
    return ca.Function("pelvis", [q], [place, ca.densify(ca.jacobian(place, q))])


class StepTerms:
    """The terms of the QP that the object's own step solved.

    Args:
        problem: the task.
    """

    def __init__(self, problem: Problem) -> None:
        """Build the functions once."""
        self._dt = problem.dt
        self._terms = Evaluator(terms_function(problem))
        self._qp = build_qp(solver_named("daqp"), len(movable_names(problem)))

    def __call__(
        self,
        step: Step,
        posture: np.ndarray,
        previous: np.ndarray,
        observed: np.ndarray,
        unimproved: float,
    ) -> tuple[dict[str, np.ndarray], np.ndarray | float]:
        """Return the terms, see `terms_function`, and the slack that the step's rows needed (m,).

        The step locks joints at their end, and its last pass treats joints near their end like all
        other rows. The answer of the step shows which of the QPs with these locks it solved.

        Args:
            step: the object's step.
            posture: posture of the person (32,) [rad].
            previous: twist of the last period (6,).
            observed: (32,) 0 for joints that the sensors do not see.
            unimproved: time without an improvement before the step [s].
        """
        given = {
            "posture": posture,
            "observed": observed,
            "pose": step.pose,
            "previous": previous,
            "dt": self._dt,
        }
        given["stalled"] = unimproved
        given |= {"locked": step.account("locked"), "final": 0.0}
        terms = self._terms(given)
        if not step.locked and not terms["cap"].any():
            return terms, 0.0
        slack: np.ndarray | float = 0.0
        for final in (0.0, 1.0):
            terms = self._terms(given | {"final": final})
            twist, slack, _, _ = (
                np.array(part).ravel() for part in self._qp(*(terms[name] for name in QP_DATA))
            )
            if np.abs(twist - step.twist).max() < SAME:
                break
        return terms, slack
