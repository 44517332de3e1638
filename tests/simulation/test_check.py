"""The checker finds each kind of violation when it is there, and nothing when it is not."""

from __future__ import annotations

import numpy as np
import pytest

from ergoqp.human.forearm import forearm_points
from ergoqp.joints import INDEX, UPPER
from ergoqp.limits import (
    ArmLength,
    AxisCone,
    JointLimit,
    OneClassBoundary,
    TwistLimit,
    WorkspaceBox,
)
from ergoqp.problem.load import load_problem
from ergoqp.problem.problem import Problem
from ergoqp.problem.settings import Control
from ergoqp.simulation.check import Checker, _Solid

DT = 0.01
STILL, HERE, UPRIGHT, NO_RATE = np.zeros(6), np.eye(4), np.zeros(32), np.zeros(32)


@pytest.fixture(scope="module")
def problem() -> Problem:
    limits = [
        TwistLimit(0.2, 0.5, 1.0, 2.0, axes=("x", "y", "z", "ry", "rz")),
        WorkspaceBox((-0.1, -0.1, -0.1), (0.1, 0.1, 0.1)),
        AxisCone((1, 0, 0), 30),
        JointLimit(ranges_deg={"trunk_flexion": (-10, 20)}, rate_deg=30),
    ]
    # Sent as planned, so that single twists can be judged: with the mean there is a limit of the
    # jerk too.
    return load_problem("screwing").replace(limits=limits, control=Control(average=0.0))


def along(axis: int, value: float) -> np.ndarray:
    return value * np.eye(6)[axis]


def at(x: float = 0.0, tilt: float = 0.0) -> np.ndarray:
    pose = np.eye(4)
    pose[0, 3] = x
    c, s = np.cos(tilt), np.sin(tilt)
    pose[:3, :3] = [[c, -s, 0], [s, c, 0], [0, 0, 1]]
    return pose


def test_nothing_wrong_is_nothing_found(problem: Problem) -> None:
    checker = Checker(problem)
    assert checker.check(along(0, 0.01), STILL, HERE, UPRIGHT, NO_RATE, DT) == []
    assert checker.violations == dict.fromkeys(checker.units, 0)
    assert set(checker.units) == {
        "speed",
        "acceleration",
        "axes",
        "workspace",
        "tool axis",
        "joint range",
        "joint rate",
    }


@pytest.mark.parametrize(
    ("twist", "previous", "broken", "amount"),
    [
        (along(0, 0.21), along(0, 0.205), "speed", 0.01),
        (along(4, -0.51), along(4, -0.50), "speed", 0.01),
        (along(1, 0.02), STILL, "acceleration", 1.0),
        (along(5, -0.04), along(5, 0.0), "acceleration", 2.0),
        (along(3, 0.01), STILL, "axes", 0.01),
    ],
)
def test_twists_that_break_a_limit(
    problem: Problem, twist, previous, broken: str, amount: float
) -> None:
    checker = Checker(problem)
    assert broken in checker.check(twist, previous, HERE, UPRIGHT, NO_RATE, DT)
    assert checker.violations[broken] == 1
    assert checker.max_violation[broken] == pytest.approx(amount)


def test_nothing_excuses_a_speed_above_the_limit(problem: Problem) -> None:
    """Not even that the twist before was faster, and that this one brakes as fast as it may."""
    previous = along(0, 0.4)
    checker = Checker(problem)
    assert checker.check(
        previous * (1 - DT / 0.4), previous, HERE, UPRIGHT, NO_RATE, DT, stops=True
    ) == ["speed"]
    assert checker.max_violation["speed"] == pytest.approx(0.19)


def test_jerk_is_judged_where_the_mean_is_sent(problem: Problem) -> None:
    """Twice the acceleration of 1 m/s^2 in 0.1 s: 20 m/s^3, from the middle of one period to that
    of the next."""
    smooth = problem.replace(control=Control(average=0.1))
    checker = Checker(smooth)
    assert "jerk" in checker.units
    assert "jerk" not in Checker(problem).units
    twist, acceleration = STILL, 0.0
    for dt in (0.01, 0.02, 0.005, DT):
        acceleration += 20 * ((dt + checker._last[1]) / 2) * 0.999
        before, twist = twist, twist + along(0, acceleration * dt)
        assert checker.check(twist, before, HERE, UPRIGHT, NO_RATE, dt) == []
    before, acceleration = twist, acceleration - 20 * DT * 1.01
    twist = twist + along(0, acceleration * DT)
    assert checker.check(twist, before, HERE, UPRIGHT, NO_RATE, DT) == ["jerk"]
    assert checker.max_violation["jerk"] == pytest.approx(0.2)
    # The other axes have their own: 40 rad/s^3.
    turned = Checker(smooth)
    assert turned.check(along(5, 0.39 * DT), STILL, HERE, UPRIGHT, NO_RATE, DT) == []
    assert Checker(smooth).check(along(5, 0.41 * DT), STILL, HERE, UPRIGHT, NO_RATE, DT) == ["jerk"]
    # A stop that comes at once is a jerk as well.
    assert "jerk" in turned.check(
        along(5, 0.39 * DT), along(5, 0.41 * DT), HERE, UPRIGHT, NO_RATE, DT, stops=True
    )


def test_leaving_the_box_and_the_cone(problem: Problem) -> None:
    checker = Checker(problem)
    assert checker.check(along(0, 0.1), along(0, 0.1), at(0.0995), UPRIGHT, NO_RATE, DT) == [
        "workspace"
    ]
    assert checker.max_violation["workspace"] == pytest.approx(0.0005)
    turned = Checker(problem)
    assert turned.check(
        along(5, 0.3), along(5, 0.3), at(tilt=np.radians(29.9)), UPRIGHT, NO_RATE, DT
    ) == ["tool axis"]
    assert turned.max_violation["tool axis"] == pytest.approx(0.003 - np.radians(0.1), abs=1e-9)


def test_where_the_object_really_was_counts_and_not_where_the_twist_leads(problem: Problem) -> None:
    checker = Checker(problem)
    assert (
        checker.check(
            along(0, 0.1), along(0, 0.1), at(0.0995), UPRIGHT, NO_RATE, DT, after=at(0.0999)
        )
        == []
    )
    assert checker.check(STILL, STILL, at(0.0999), UPRIGHT, NO_RATE, DT, after=at(0.1002)) == [
        "workspace"
    ]
    assert checker.max_violation["workspace"] == pytest.approx(0.0002)
    turned = Checker(problem)
    tilts = np.radians([29.9, 30.3])
    assert turned.check(
        STILL, STILL, at(tilt=tilts[0]), UPRIGHT, NO_RATE, DT, after=at(tilt=tilts[1])
    ) == ["tool axis"]


def test_outside_it_may_come_in_but_what_came_in_stays(problem: Problem) -> None:
    checker = Checker(problem)
    assert checker.check(along(0, -0.1), along(0, -0.1), at(0.15), UPRIGHT, NO_RATE, DT) == []
    assert checker.check(STILL, along(0, -0.005), at(0.149), UPRIGHT, NO_RATE, DT) == []
    # Creeping out again, period by period, is found although each one is small and it is still
    # nearer than at first.
    assert checker.check(along(0, 0.005), STILL, at(0.149), UPRIGHT, NO_RATE, DT) == ["workspace"]


def test_joints_of_the_model(problem: Problem) -> None:
    joint, other = INDEX["trunk_flexion"], INDEX["right_elbow_flexion"]
    near_end, rate = np.zeros(32), np.zeros(32)
    near_end[joint], rate[joint] = np.radians(19.9), np.radians(20)
    checker = Checker(problem)
    assert checker.check(along(0, 0.01), STILL, HERE, near_end, rate, DT) == ["joint range"]
    assert checker.max_violation["joint range"] == pytest.approx(np.radians(0.1))
    fast = np.zeros(32)
    fast[other] = np.radians(31)
    assert checker.check(along(0, 0.01), STILL, HERE, UPRIGHT, fast, DT) == ["joint rate"]
    # Acceleration and workspace come first: who brakes may need a joint's rate for it, and says so.
    # Its range no.
    assert checker.check(along(0, 0.01), STILL, HERE, UPRIGHT, fast, DT, stops=True) == []
    assert checker.check(along(0, 0.01), STILL, HERE, near_end, rate, DT, stops=True) == [
        "joint range"
    ]
    assert (
        checker.check(
            along(0, 0.01), STILL, HERE, UPRIGHT, fast, DT, gave_way=["right_elbow_flexion"]
        )
        == []
    )
    assert checker.check(
        along(0, 0.01), STILL, HERE, UPRIGHT, fast, DT, gave_way=["left_elbow_flexion"]
    ) == ["joint rate"]
    # Outside and coming in is fine; nobody is blamed for a joint that is not seen, or without a
    # frame.
    outside = near_end.copy()
    outside[other] = UPPER[other] + 0.1
    inward = np.zeros(32)
    inward[other] = -0.1
    assert Checker(problem).check(along(0, 0.01), STILL, HERE, outside, inward, DT) == []
    unseen = np.ones(32, bool)
    unseen[joint] = False
    assert Checker(problem).check(along(0, 0.01), STILL, HERE, near_end, rate, DT, unseen) == []
    assert Checker(problem).check(along(0, 0.01), STILL, HERE, None, rate, DT) == []


def test_a_twist_that_is_no_number_breaks_everything(problem: Problem) -> None:
    checker = Checker(problem)
    broken = checker.check(np.array([np.nan, 0, 0, 0, 0, 0]), STILL, HERE, UPRIGHT, NO_RATE, DT)
    assert set(broken) == set(checker.units)


def test_what_drifts_out_between_two_steps_is_found_too(problem: Problem) -> None:
    """No single step leads out here: only who remembers how far in it was sees it."""
    checker = Checker(problem)
    for x in (0.15, 0.12, 0.119):
        assert checker.check(STILL, STILL, at(x), UPRIGHT, NO_RATE, DT) == []
    assert checker.check(STILL, STILL, at(0.13), UPRIGHT, NO_RATE, DT) == ["workspace"]
    assert checker.max_violation["workspace"] == pytest.approx(0.011)
    turned = Checker(problem)
    for tilt in (40, 35):
        assert turned.check(STILL, STILL, at(tilt=np.radians(tilt)), UPRIGHT, NO_RATE, DT) == []
    assert turned.check(STILL, STILL, at(tilt=np.radians(36)), UPRIGHT, NO_RATE, DT) == [
        "tool axis"
    ]
    # Each wall has its own memory: what comes in at one may not go out at another.
    beside = Checker(problem)
    corner = at(0.15)
    corner[1, 3] = 0.05
    assert beside.check(STILL, STILL, corner, UPRIGHT, NO_RATE, DT) == []
    corner[1, 3] = 0.11
    assert beside.check(STILL, STILL, corner, UPRIGHT, NO_RATE, DT) == ["workspace"]


def test_counts_go_on_and_the_worst_is_kept(problem: Problem) -> None:
    checker = Checker(problem)
    for amount in (0.21, 0.25, 0.22):
        assert "speed" in checker.check(
            along(0, amount), along(0, amount), HERE, UPRIGHT, NO_RATE, DT
        )
    assert checker.violations["speed"] == 3
    assert checker.max_violation["speed"] == pytest.approx(0.05)
    assert checker.violations["acceleration"] == 0


def test_boundary_and_length_of_points() -> None:
    problem = load_problem("forearm")
    checker, dt = Checker(problem), problem.dt
    assert {"boundary", "arm length"} <= set(checker.units)
    inside = ArmLength(0.2555).project(forearm_points(comfortable()[None]))[0]
    boundary = problem.limit_of(OneClassBoundary)
    assert boundary.model.margin(inside[None])[0] > 0
    pose, shift = np.eye(4), np.tile([1.0, 0, 0], 2)
    assert checker.check(STILL, STILL, pose, inside, NO_RATE[:6], dt) == []
    # Away from all data, both points alike: the length stays, the boundary does not.
    assert checker.check(STILL, STILL, pose, inside, 100 * shift, dt) == ["boundary"]
    left = boundary.model.margin((inside + 100 * shift * dt)[None])[0]
    assert checker.max_violation["boundary"] == pytest.approx(-left)
    # Outside it may come nearer, and that it says so itself excuses nothing.
    far = inside + 0.9 * shift
    near, further = boundary.model.margin(np.stack([far - 0.001 * shift, far + 0.001 * shift]))
    assert further < near < 0
    assert checker.check(STILL, STILL, pose, far, -0.1 * shift, dt) == []
    assert checker.check(
        STILL, STILL, pose, far, 0.1 * shift, dt, stops=True, gave_way=["boundary"]
    ) == ["boundary"]
    apart = np.r_[np.zeros(3), (inside[3:] - inside[:3]) / 0.2555]
    assert checker.check(STILL, STILL, pose, inside, 0.01 * apart, dt) == ["arm length"]
    assert checker.max_violation["arm length"] == pytest.approx(0.01 * dt)


def test_a_soft_boundary_gives_way_to_braking() -> None:
    problem = load_problem("screwing_learned")
    checker, dt = Checker(problem), problem.dt
    posture, rate = np.asarray(problem.response.comfort), np.zeros(32)
    rate[:20] = 150.0
    margins = problem.limit_of(OneClassBoundary).model.margin
    points = problem.limit_of(OneClassBoundary).model.coordinates.read(
        np.stack([posture, posture + rate * dt])
    )
    assert margins(points)[1] < 0
    broken = checker.check(STILL, STILL, held_at(problem), posture, rate, dt)
    assert "boundary" in broken
    for excuse in ({"stops": True}, {"gave_way": ["boundary"]}):
        assert "boundary" not in Checker(problem).check(
            STILL, STILL, held_at(problem), posture, rate, dt, **excuse
        )


def comfortable() -> np.ndarray:
    posture = np.zeros(32)
    posture[[INDEX["right_shoulder_flexion"], INDEX["right_elbow_flexion"]]] = 0.6, 1.4
    return posture


def held_at(problem: Problem) -> np.ndarray:
    box, pose = problem.limit_of(WorkspaceBox), np.eye(4)
    pose[:3, 3] = np.mean([box.lower, box.upper], axis=0)
    return pose


def test_a_rate_is_held_to_the_accuracy_of_the_qp(problem: Problem) -> None:
    rate, joint = np.zeros(32), INDEX["right_elbow_flexion"]
    for beyond, broken in ((0.9e-7, []), (1.2e-7, ["joint rate"])):
        rate[joint] = np.radians(30) + beyond
        assert Checker(problem).check(STILL, STILL, HERE, UPRIGHT, rate, DT) == broken


def test_a_ball_smaller_than_what_is_spared_of_it_is_crossed_nowhere() -> None:
    ball = _Solid(np.empty((0, 3)), np.empty(0), np.array([0.1, 0.0, 0.0]), 0.0005, 0.001)
    less = ball.drawn(np.zeros(3), -ball.spared, np.zeros(3))
    enter, leave = less.crossed(np.zeros(3), np.eye(3))
    assert (enter > leave).all()
