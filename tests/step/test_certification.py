"""What the certificate asks for, rule by rule, and what it says of what was kept."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from step_samples import bold_stepper, comfort_of, held_pose, near_comfort, problem_of

from ergoqp.joints import INDEX, LOWER, UPPER
from ergoqp.limits import WorkspaceBox
from ergoqp.problem.load import load_problem
from ergoqp.problem.problem import Problem
from ergoqp.solvers.solver import FREE
from ergoqp.step.answer import _rate_excess
from ergoqp.step.certification import (
    GIVES_WAY,
    HELD,
    _floor,
    _shorten_function,
    judge_function,
)
from ergoqp.step.model import StepModel


def floors(problem: Problem, now: float, at_braking: float) -> dict[str, float]:
    """Least margin that a twist must keep through its stop, per row, where all rows have the same
    margins."""
    rows = problem.row_names
    found = np.array(
        _floor(
            StepModel(problem), np.full((len(rows), 1), now), np.full((len(rows), 1), at_braking)
        )
    ).ravel()
    return dict(zip(rows, found.tolist(), strict=True))


@pytest.mark.parametrize(
    ("now", "at_braking", "hard", "margin_is_lower_bound", "soft"),
    [
        # What holds, and would through braking, has to hold.
        (0.1, 0.05, 0.0, 0.0, -1e-7),
        # What braking breaks may be broken as far, but for a margin that is a bound: braking may be
        # better than it says.
        (0.1, -0.02, -0.02, 0.0, -0.02 - GIVES_WAY),
        # What does not hold gets no worse; rows through S are left to the QP.
        (-0.05, -0.03, -0.05, -0.05, -FREE),
        (-0.05, -0.08, -0.08, -0.05, -FREE),
    ],
)
def test_what_an_accepted_twist_must_keep(
    now: float, at_braking: float, hard: float, margin_is_lower_bound: float, soft: float
) -> None:
    points, person = (
        floors(load_problem("forearm"), now, at_braking),
        floors(problem_of("screwing"), now, at_braking),
    )
    assert points["boundary"] == pytest.approx(margin_is_lower_bound - HELD, abs=1e-12)
    assert person["workspace x"] == pytest.approx(hard - HELD, abs=1e-12)
    assert person["tool axis"] == pytest.approx(hard - HELD, abs=1e-12)
    assert person["trunk_flexion"] == pytest.approx(soft, abs=1e-12)


@pytest.mark.parametrize("noise_deg", [0.0, 0.5])
def test_inside_a_cone_hardly_anything_of_a_long_mean_is_inherited(noise_deg: float) -> None:
    problem = problem_of("screwing")
    problem = problem.replace(robot=replace(problem.robot, pose_noise_deg=noise_deg))
    long = problem.replace(control=replace(problem.control, average=0.2))
    noise = 3 * np.sqrt(3) * np.radians(noise_deg)
    for each, least in ((problem, -0.5), (long, -(1e-5 + noise))):
        found = floors(each, 0.1, -0.5)
        assert found["tool axis"] == pytest.approx(least - HELD, rel=1e-9)
        assert found["workspace x"] == pytest.approx(-0.5 - HELD)
    # What is already outside by more is not asked to be better than it is.
    assert floors(long, -0.4, -0.4)["tool axis"] <= -0.4 - HELD


@pytest.mark.slow
def test_the_model_person_stays_within_the_ends_of_the_joints_and_may_leave_them() -> None:
    """At an end a joint of the model only comes back, and it does come back."""
    stepper, rng, back = (
        bold_stepper("screwing"),
        np.random.default_rng(8),
        {"upper": 0, "lower": 0},
    )
    arm = [
        INDEX[f"right_{joint}"]
        for joint in ("shoulder_flexion", "shoulder_rotation", "elbow_flexion", "wrist_flexion")
    ]
    for number in range(60):
        q, joint = near_comfort("screwing", rng, 25), arm[number % len(arm)]
        end = "upper" if number % 2 else "lower"
        q[joint] = UPPER[joint] - 1e-3 if end == "upper" else LOWER[joint] + 1e-3
        stepper.reset(twist=0.5 * stepper.problem.twist_limit.speed * rng.uniform(-1, 1, 6))
        rate = float(stepper.step(q, held_pose("screwing")).posture_rate[joint])
        outward = rate if end == "upper" else -rate
        assert outward <= 1e-9
        back[end] += outward < -1e-3
    assert min(back.values()) > 3


def test_a_row_that_is_faster_than_its_rate_has_given_way_by_as_much() -> None:
    rows: Any = SimpleNamespace(
        matrices=[ca.MX(ca.DM.eye(6))], rates=[ca.MX(ca.DM([1, 1, 1, 1, 1, np.inf]))]
    )
    twist = ca.MX(ca.DM([1.25, -1.25, 1 + 2e-7, 1 + 5e-8, 0.5, 99]))
    found = np.array(ca.evalf(_rate_excess(rows, twist))).ravel()
    np.testing.assert_allclose(found, [0.25, 0.25, 2e-7, 0, 0, 0], rtol=1e-6)


@pytest.mark.parametrize(("doubted", "holds"), [(0.0, False), (0.004, True)])
def test_what_is_not_known_of_a_row_is_no_reason_to_brake(doubted: float, holds: bool) -> None:
    """A row beyond its end goes no further out, but for what is not known of where it is."""
    problem, dt = problem_of("screwing"), 0.01
    model, row = StepModel(problem), problem.row_names.index("workspace x")
    pose, out = held_pose("screwing").copy(), np.r_[0.01, np.zeros(5)]
    pose[0, 3] = problem.limit_of(WorkspaceBox).upper[0] + 0.01
    judge, shorten = judge_function(model), _shorten_function(model)
    given: dict[str, Any] = {
        name: np.zeros(model.size(name)) for name in {*judge.name_in(), *shorten.name_in()}
    }
    q, far = comfort_of("screwing"), np.zeros(len(problem.row_names))
    far[row] = doubted
    given |= {"posture": q, "observed": np.ones(32), "pose": pose, "landed": pose, "dt": dt}
    given |= {"readings": model.readings(q, pose), "doubted": far, "xi": out, "usable": 1}

    def ask(function: ca.Function, **more: Any) -> dict[str, Any]:
        return function(**{name: (given | more)[name] for name in function.name_in()})

    found = ask(judge)
    np.testing.assert_allclose(np.array(found["wanted"]).ravel(), out)
    assert float(found["now"][row]) == pytest.approx(-0.01)
    assert -0.014 < float(found["ahead"][row]) < -0.0101
    assert float(found["whole"]) == holds
    shares = ask(shorten, wanted=out, brake=found["brake"], now=found["now"])["share"]
    assert (float(shares[0]) == 1) == holds
