"""Problems from Python: terms that fit together, and what is refused."""

from __future__ import annotations

import pickle
from typing import Any

import casadi as ca
import numpy as np
import pytest
from step_samples import NAMES, Held, comfort_of, held_pose, problem_of

from ergoqp import reba
from ergoqp.errors import ProblemError
from ergoqp.joints import JOINTS
from ergoqp.limits import JointLimit, TwistLimit, WorkspaceBox
from ergoqp.problem.load import load_problem
from ergoqp.problem.problem import Problem
from ergoqp.problem.settings import Control
from ergoqp.step.stepper import Stepper


def terms(**changed: Any) -> dict[str, Any]:
    given = problem_of("screwing")
    return {
        "cost": given.cost,
        "response": given.response,
        "limits": [TwistLimit(), JointLimit()],
    } | changed


def test_a_problem_of_python_steps() -> None:
    problem = Problem(**terms())
    assert problem.coordinates == JOINTS
    assert problem.joints == problem.response.joints
    assert problem.row_names == JOINTS
    step = Stepper(problem).step(comfort_of("screwing"))
    assert step.status in ("optimal", "settled")
    assert tuple(step.margins) == problem.row_names


@pytest.mark.parametrize("name", NAMES)
def test_the_sheet_is_read_as_the_task_says(name: str) -> None:
    problem, q = problem_of(name), comfort_of(name)
    assert problem.assess(q).final[0] == reba.assess(q, problem.method, **problem.task).final[0]
    # The cost is of the same task: the smooth score is near the exact one where no band end is
    # near.
    assert abs(float(problem.cost(q)[0]) - problem.assess(q).final[0]) < 1.5


def test_replace_changes_one_term_and_leaves_the_rest() -> None:
    problem = problem_of("screwing")
    other = problem.replace(dt=0.002, name="quick")
    assert (other.dt, other.name) == (0.002, "quick")
    assert other.response is problem.response
    assert problem.dt == 0.01
    assert Stepper(other).dt == 0.002


@pytest.mark.parametrize("name", ["screwing", "screwing_learned", "forearm"])
def test_a_problem_can_be_sent_to_another_process(name: str) -> None:
    assert pickle.loads(pickle.dumps(load_problem(name))).name == name


class Keeps:
    """A cost of one's own that keeps its symbols."""

    name, minimum = "keeps", 1.0

    def expression(self, q: ca.MX) -> ca.MX:
        self.kept = q
        return 1 + ca.sumsqr(q)

    def __call__(self, postures: Any) -> np.ndarray:
        return 1 + (np.atleast_2d(postures) ** 2).sum(axis=1)


def test_judging_a_cost_leaves_nothing_in_it() -> None:
    cost = Keeps()
    problem_of("screwing").replace(cost=cost)
    assert not hasattr(cost, "kept")


def test_limits_are_found_by_their_kind() -> None:
    problem = problem_of("screwing")
    assert isinstance(problem.limit_of(WorkspaceBox), WorkspaceBox)
    assert Problem(**terms()).limit_of(WorkspaceBox) is None
    assert isinstance(problem.twist_limit, TwistLimit)
    assert problem.twist_limit not in problem.row_limits


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"limits": [JointLimit()]}, "limits: got 0 twist limits, allowed exactly one"),
        ({"limits": [TwistLimit(), TwistLimit()]}, "limits: got 2 twist limits"),
        (
            {"limits": [TwistLimit(), JointLimit(), JointLimit()]},
            "limits: got more than one row named .*trunk_flexion",
        ),
        ({"dt": 0.0}, "dt: got 0.0 s, allowed 0.0001 to 0.1 s"),
        ({"dt": float("nan")}, "dt: got nan s"),
        ({"dt": 10}, "dt: got 10 s"),
    ],
)
def test_terms_that_do_not_fit_are_refused(changed: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ProblemError, match=sentence):
        Problem(**terms(**changed))


def test_replacing_what_is_not_a_term_is_refused() -> None:
    with pytest.raises(ProblemError, match=r"replace: got \['speed'\], allowed"):
        problem_of("screwing").replace(speed=1)
    with pytest.raises(ProblemError, match="twist limits"):
        problem_of("screwing").replace(limits=[])


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"look_ahead": 0}, "control.look_ahead: got 0, allowed a positive number"),
        ({"effort_linear": -1.0}, "control.effort_linear: got -1.0, allowed 0 to 1e"),
        ({"smoothing": float("nan")}, "control.smoothing: got nan"),
        ({"max_age": float("inf")}, "control.max_age: got inf"),
        ({"caution": "much"}, "control.caution: got 'much'"),
        (
            {"rest_below": 1.0, "move_above": 0.1},
            "control.move_above: got 0.1, allowed at least rest_below = 1.0",
        ),
    ],
)
def test_controls_that_are_none_are_refused(changed: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ProblemError, match=sentence):
        Control(**changed)


@pytest.mark.slow
def test_control_changes_the_answer() -> None:
    q = comfort_of("screwing") + 0.2 * np.random.default_rng(0).normal(size=32)
    bold, shy = (
        problem_of("screwing").replace(control=Control(effort_linear=e, effort_angular=e))
        for e in (0.1, 50.0)
    )
    speeds = [np.linalg.norm([Stepper(p).step(q).twist for _ in range(1)]) for p in (bold, shy)]
    assert speeds[0] > 2 * speeds[1]


@pytest.mark.parametrize("width", [0.0, 1e-4, 2.4e-4])
def test_a_workspace_without_room_along_a_free_axis_is_refused(width: float) -> None:
    """With both ends in one place the object came back for ever and never rested; 0.2475 mm is what
    its mean may rise by."""
    problem = problem_of("screwing")
    box = problem.limit_of(WorkspaceBox)
    flat = WorkspaceBox((0.4 - width / 2, *box.lower[1:]), (0.4 + width / 2, *box.upper[1:]))
    limits = [flat if limit is box else limit for limit in problem.limits]
    with pytest.raises(
        ProblemError,
        match=r"workspace x: got .* mm from end to end, allowed at least 0.247 mm where",
    ):
        problem.replace(limits=limits)
    along = [
        TwistLimit(axes=("y", "z")) if isinstance(limit, TwistLimit) else limit for limit in limits
    ]
    assert problem.replace(limits=along).limit_of(WorkspaceBox) is flat


@pytest.mark.slow
@pytest.mark.parametrize(("above", "off"), [(True, 3e-3), (False, 3e-3), (True, 2e-5)])
def test_the_narrowest_workspace_is_come_back_to_and_rested_in(above: bool, off: float) -> None:
    problem, pose = problem_of("screwing"), held_pose("screwing")
    box, x = problem.limit_of(WorkspaceBox), float(pose[0, 3])
    middle = x - off if above else x + off
    narrow = WorkspaceBox((middle - 1.24e-4, *box.lower[1:]), (middle + 1.24e-4, *box.upper[1:]))
    problem = problem.replace(
        limits=[narrow if limit is box else limit for limit in problem.limits]
    )
    q, loop = comfort_of("screwing"), Held(Stepper(problem), pose)
    statuses = [loop.step(q).status for _ in range(300)]
    assert ("recovering" in statuses) == (off > 1.24e-4)
    assert statuses[-1] == "settled"
    assert abs(loop.pose[0, 3] - middle) < 1.26e-4
