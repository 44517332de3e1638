"""A robot within its declaration is never blamed, and what it may do on is kept free: what random
loops have found."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from step_samples import Held, bold_of, comfort_of, held_pose, near_comfort, plain_of, problem_of

from ergoqp.errors import InputError
from ergoqp.limits import AxisCone, TwistLimit, WorkspaceBox
from ergoqp.problem.problem import Problem
from ergoqp.problem.settings import DeclaredRobot
from ergoqp.simulation.robot import RobotKind, SimulatedRobot, moved
from ergoqp.step.faults import _rotation
from ergoqp.step.model import StepModel
from ergoqp.step.qp import away_function
from ergoqp.step.stepper import Stepper


def outside(problem: Problem, pose: np.ndarray) -> float:
    """How far a pose (4, 4) is out of its box or its cone [m, rad]; negative inside."""
    box, cone, point = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone), pose[:3, 3]
    angle = np.arccos(np.clip(np.asarray(cone.direction) @ pose[:3, 0], -1, 1)) - np.radians(
        cone.half_angle_deg
    )
    return float(
        max(np.max(np.asarray(box.lower) - point), np.max(point - np.asarray(box.upper)), angle)
    )


def braked(stepper: Stepper, pose: np.ndarray) -> np.ndarray:
    """The pose after the stop of a copy of the loop; the loop itself goes on as it was."""
    state = stepper.state()
    while (step := stepper.brake()).twist.any():
        pose = moved(pose, step.twist * stepper.dt)
    stepper.restore(state)
    return pose


@pytest.mark.slow
@pytest.mark.parametrize("name", ["dentist", "screwing"])
@pytest.mark.parametrize("gain_error", [0.0, 0.1])
def test_one_declared_hold_of_any_twist_leaves_the_object_inside(
    name: str, gain_error: float
) -> None:
    """The room for a hold was that of the twists before the new one: 0.1 mm too little where the
    object had just begun."""
    hold = 0.2
    problem = bold_of(name).replace(robot=DeclaredRobot(longest_hold=hold, gain_error=gain_error))
    stepper, rng, nearest = Stepper(problem), np.random.default_rng(3), -1.0
    for _ in range(4):
        stepper.reset()
        loop, q = Held(stepper, held_pose(name)), near_comfort(name, rng, 30)
        for number in range(250):
            step = loop.step(q)
            assert step.status != "invalid"
            if number % 5 == 0:
                held = moved(loop.pose, (1 + gain_error) * step.twist * hold)
                nearest = max(
                    nearest, outside(problem, held), outside(problem, braked(stepper, held))
                )
                assert nearest <= 1e-8
    # It came to its walls.
    assert nearest > -0.005


@pytest.mark.parametrize("plain", [False, True], ids=["with the mean", "sent as planned"])
def test_after_a_pose_that_jumped_the_object_rests_before_it_moves_again(plain: bool) -> None:
    """Without a mean, and without a late robot, it had always stood still, even while it moved."""
    problem = plain_of("screwing") if plain else problem_of("screwing")
    stepper, q = Stepper(problem), near_comfort("screwing", np.random.default_rng(5), 15)
    loop = Held(stepper, held_pose("screwing"))
    for _ in range(60):
        last = loop.step(q)
    assert last.twist.any()
    loop.pose = moved(loop.pose, np.array([0.02, 0, 0, 0, 0, 0]))
    first = loop.step(q)
    assert "robot: pose jumps by 20" in first.reason
    statuses, rested = [first.status], 0
    while statuses[-1] == "braking":
        # Its pose comes back only now and then.
        step = loop.step(q, **({} if len(statuses) % 3 else {"pose": None}))
        statuses.append(step.status)
        rested = 0 if step.twist.any() and step.status == "braking" else rested + 1
    assert 50 <= rested < 80


@pytest.mark.slow
def test_a_hold_of_a_lagging_robot_that_is_declared_is_no_fault() -> None:
    """What it could do in a long period was judged by its speed at the end of it."""
    robot = DeclaredRobot(lag=0.05, gain_error=0.08, longest_hold=0.2)
    problem, kind = bold_of("screwing").replace(robot=robot), RobotKind(lag=0.05, gain=1.08)
    stepper, q = Stepper(problem), near_comfort("screwing", np.random.default_rng(5), 20)
    sim = SimulatedRobot(kind, held_pose("screwing"), np.random.default_rng(0))
    for number in range(120):
        dt = 0.2 if number in (25, 70) else 0.01
        step = stepper.step(q, sim.measured_pose(), dt=dt)
        assert "robot:" not in step.reason
        list(sim.execute(step.twist, dt))


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("by", ["pose", "twist", "a twist now and then"])
def test_a_late_robot_that_is_taken_over_in_motion_is_not_blamed(share: float, by: str) -> None:
    """What it owed when it was taken over had been taken for nothing; so had what it owed while
    nobody heard of it."""
    declared = DeclaredRobot(delay=0.04, lag=0.05)
    problem = problem_of("screwing").replace(robot=declared)
    kind = RobotKind(delay=share * 0.04, lag=share * 0.05)
    stepper, twist = Stepper(problem), np.array([0.05, -0.1, 0.02, 0.1, 0.0, -0.2])
    sim = SimulatedRobot(kind, held_pose("screwing"), np.random.default_rng(0))
    for _ in range(60):
        list(sim.execute(twist, 0.01))
    stepper.reset(twist)
    q = near_comfort("screwing", np.random.default_rng(5), 20)
    for number in range(150):
        told = sim.reported_twist() if by == "twist" or (by != "pose" and number % 7) else None
        step = stepper.step(q, sim.measured_pose() if by == "pose" or not number else None, told)
        assert "robot:" not in step.reason
        list(sim.execute(step.twist, 0.01))


@pytest.mark.parametrize("elapsed", [0.004, 0.03, 0.0312, 0.1, 0.7])
def test_what_the_robot_ramped_down_by_itself_is_braked_call_by_call(elapsed: float) -> None:
    robot = DeclaredRobot(longest_hold=0.2)
    stepper = Stepper(bold_of("screwing").replace(robot=robot))
    loop, q = (
        Held(stepper, held_pose("screwing")),
        near_comfort("screwing", np.random.default_rng(5), 20),
    )
    for _ in range(40):
        loop.step(q)
    state, left = stepper.state(), elapsed
    while left >= 1e-5:
        stepper.brake(min(left, stepper.dt))
        left -= stepper.dt
    one_by_one = stepper.brake().twist
    stepper.restore(state)
    np.testing.assert_allclose(stepper.brake(elapsed=elapsed).twist, one_by_one, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("true_lag", [0.0, 0.1, 0.2])
def test_a_declared_hold_of_a_late_robot_is_no_fault_when_the_object_comes_to_rest_either(
    true_lag: float,
) -> None:
    """What it held on to was forgotten in the very comparison in which it still counted."""
    problem = bold_of("screwing").replace(robot=DeclaredRobot(lag=0.2, longest_hold=0.2))
    stepper, q = Stepper(problem), near_comfort("screwing", np.random.default_rng(5), 20)
    sim = SimulatedRobot(RobotKind(lag=true_lag), held_pose("screwing"), np.random.default_rng(0))
    for number in range(200):
        step = stepper.step(q, sim.measured_pose(), enable=number < 20)
        assert "robot:" not in step.reason
        list(sim.execute(step.twist, 0.21 if number == 10 else 0.01))


@pytest.mark.slow
@pytest.mark.parametrize("hold", [0.01, 0.02, 0.03, 0.04, 0.05])
def test_a_hold_that_is_shorter_than_declared_is_no_fault(hold: float) -> None:
    """Of a leap along two axes neither stood out alone, but both together were a fault."""
    problem = bold_of("screwing").replace(robot=DeclaredRobot(longest_hold=0.05))
    stepper = Stepper(problem)
    for seed in range(12):
        stepper.reset()
        loop, q = (
            Held(stepper, held_pose("screwing")),
            near_comfort("screwing", np.random.default_rng(seed), 20),
        )
        for number in range(12):
            step = loop.step(q)
            assert "robot:" not in step.reason
            if number == 6:
                loop.pose = moved(loop.pose, step.twist * hold)


def test_where_a_hold_is_declared_nothing_moves_without_a_measured_pose() -> None:
    """Holds that nobody sees add up: 10 mm out of the box after four of them."""
    stepper = Stepper(bold_of("screwing").replace(robot=DeclaredRobot(longest_hold=0.1)))
    loop, q = (
        Held(stepper, held_pose("screwing")),
        near_comfort("screwing", np.random.default_rng(5), 20),
    )
    assert [loop.step(q) for _ in range(20)][-1].twist.any()
    step = loop.step(q, pose=None)
    assert step.status == "braking"
    assert step.reason == "no pose, and the robot is declared to hold on for up to 0.1 s"
    assert not [loop.step(q, pose=None) for _ in range(60)][-1].twist.any()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("robot", "said"),
    [
        (DeclaredRobot(gain_error=0.05), "move by up to 5 % more or less than what it is sent"),
        (DeclaredRobot(longest_hold=0.03), "hold on for up to 0.03 s"),
        (
            DeclaredRobot(gain_error=0.05, longest_hold=0.03),
            "move by up to 5 % more or less than what it is sent, and to hold on for up to 0.03 s",
        ),
    ],
)
def test_only_what_is_declared_is_said_where_the_pose_is_missing(
    robot: DeclaredRobot, said: str
) -> None:
    stepper = Stepper(problem_of("screwing").replace(robot=robot))
    step = stepper.step(comfort_of("screwing"), None)
    assert step.reason == f"no pose, and the robot is declared to {said}"


@pytest.mark.parametrize("sent", [np.full(6, np.nan), np.full(6, 99.0), np.zeros(5), "fast"])
def test_what_cannot_have_been_sent_instead_changes_nothing(sent: object) -> None:
    """A NaN was answered by NaN from then on, 99 m/s by 98.99."""
    stepper = Stepper(plain_of("screwing"))
    before = stepper.state()
    with pytest.raises(InputError, match="twist: got"):
        stepper.sent_instead(sent)
    np.testing.assert_array_equal(stepper.state(), before)


@pytest.mark.slow
@pytest.mark.parametrize(("lag", "hold"), [(0.5, 0.4), (0.2, 0.2)])
def test_what_a_lagging_robot_still_owes_after_a_hold_is_kept_free(lag: float, hold: float) -> None:
    """It goes on fading long after the twist that was held on to has left the history: 3.7 mm
    outside."""
    base = bold_of("screwing")
    box, pose = base.limit_of(WorkspaceBox), held_pose("screwing")
    middle = (np.asarray(box.lower) + np.asarray(box.upper)) / 2
    walls = WorkspaceBox(tuple(middle - 0.15), tuple(middle + 0.15))
    limits = [limit for limit in base.limits if not isinstance(limit, (WorkspaceBox, TwistLimit))]
    speed = replace(base.twist_limit, axes=("x",))
    problem = base.replace(
        limits=[speed, walls, *limits],
        robot=DeclaredRobot(lag=lag, longest_hold=hold),
        control=replace(base.control, average=0.0),
    )
    stepper, furthest = Stepper(problem), -1.0
    pose[1:3, 3] = middle[1:]
    for distance in (0.02, 0.04, 0.07):
        for held in (5, 12):
            stepper.reset()
            pose[0, 3] = walls.lower[0] + distance
            sim = SimulatedRobot(RobotKind(lag=lag), pose, np.random.default_rng(0))
            q = near_comfort("screwing", np.random.default_rng(0), 15)
            for number in range(300):
                twist = stepper.step(q, sim.measured_pose()).twist
                for way in sim.execute(twist, 0.01 + hold * (number == held)):
                    furthest = max(furthest, walls.lower[0] - float(way[0, 3]))
    assert furthest <= 1e-6
    assert furthest > -0.02


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.2, 0.5, 2.0, 5.0])
@pytest.mark.parametrize("corners", [False, True], ids=["uniform", "as far off as declared"])
def test_noise_of_the_orientation_that_is_declared_is_no_fault(noise: float, corners: bool) -> None:
    """Differences of neighbouring poses made a random walk of it: 2 deg were blamed after a second,
    0.5 deg after ten."""
    base = bold_of("screwing")
    cone = base.limit_of(AxisCone)
    wide = [AxisCone(cone.direction, 60.0) if limit is cone else limit for limit in base.limits]
    stepper = Stepper(base.replace(limits=wide, robot=DeclaredRobot(pose_noise_deg=noise)))
    loop, rng = Held(stepper, held_pose("screwing")), np.random.default_rng(7)
    for number in range(3000):
        if number % 60 == 0:
            q = near_comfort("screwing", rng, 30)
        off = np.radians(noise) * (rng.choice([-1.0, 1.0], 3) if corners else rng.uniform(-1, 1, 3))
        measured = moved(loop.pose, np.concatenate([np.zeros(3), off]))
        assert "robot:" not in loop.step(q, pose=measured).reason, number


def test_after_a_fault_a_late_robot_is_given_the_time_that_it_needs_to_stand_still() -> None:
    """Half a second, its dead time, and three times its lag: what it still did then would be a
    fault again."""
    robot = DeclaredRobot(delay=0.05, lag=0.2)
    stepper = Stepper(problem_of("screwing").replace(robot=robot))
    q, pose = near_comfort("screwing", np.random.default_rng(5), 15), held_pose("screwing")
    stepper.step(q, pose)
    # Nothing moved yet, so nothing explains this.
    pose = moved(pose, np.array([0.05, 0, 0, 0, 0, 0]))
    stands = 0
    while "robot:" in stepper.step(q, pose).reason:
        stands += 1
        assert stands < 200
    assert 0.01 * stands >= 0.5 + 0.05 + 3 * 0.2 - 0.02


def test_the_speed_that_a_lagging_robot_still_has_in_a_long_period_is_no_jump() -> None:
    """At the end of the period it is nearly still; on the way it was as fast as it had been sent
    before."""
    robot = DeclaredRobot(lag=0.05, longest_hold=0.2)
    stepper, q = (
        Stepper(bold_of("screwing").replace(robot=robot)),
        near_comfort("screwing", np.random.default_rng(5), 20),
    )
    sim = SimulatedRobot(RobotKind(lag=0.05), held_pose("screwing"), np.random.default_rng(0))
    for number in range(120):
        dt = 0.2 if number in (25, 26, 70) else 0.01
        step = stepper.step(
            q,
            sim.measured_pose(),
            sim.reported_twist() if number else None,
            dt=dt,
            enable=number % 40 < 25,
        )
        assert "robot:" not in step.reason, number
        list(sim.execute(step.twist, dt))


@pytest.mark.parametrize("above", [True, False], ids=["from above", "from below"])
def test_an_object_that_comes_back_into_a_narrow_box_does_not_leave_it_by_the_other_end(
    above: bool,
) -> None:
    """Its pose came 60 ms late, and as far as it had been outside it might be beyond: 0.1 mm out of
    a box of 0.1 mm."""
    robot, pose = DeclaredRobot(delay=0.02, pose_delay=0.04), held_pose("overhead")
    box = plain_of("overhead").limit_of(WorkspaceBox)
    z = pose[2, 3] + (-0.004 if above else 0.004)
    narrow = replace(box, lower=(*box.lower[:2], z - 5e-5), upper=(*box.upper[:2], z + 5e-5))
    base = plain_of("overhead")
    limits = tuple(narrow if limit is box else limit for limit in base.limits)
    problem = base.replace(robot=robot, limits=limits, dt=0.02)
    stepper, q = Stepper(problem), near_comfort("overhead", np.random.default_rng(2), 5)
    mover = SimulatedRobot(RobotKind(delay=0.02, pose_delay=0.04), pose, np.random.default_rng(0))
    heights = []
    for _ in range(250):
        step = stepper.step(q, mover.measured_pose())
        heights += [part[2, 3] - z for part in mover.execute(step.twist, 0.02)]
    assert max(heights) <= (0.0041 if above else 5e-5 + 1e-8)
    assert min(heights) >= (-5e-5 - 1e-8 if above else -0.0041)
    # It came back.
    assert abs(heights[-1]) < 1e-4


def test_an_ideal_robot_that_turns_fast_is_not_blamed() -> None:
    """Turns were compared by their sine: 1.2e-4 rad too little in a period of 0.09 rad, and it adds
    up."""
    base = bold_of("screwing")
    quick = replace(base.limit_of(TwistLimit), angular_speed=1.5, angular_acceleration=10.0)
    limits = tuple(quick if isinstance(limit, TwistLimit) else limit for limit in base.limits)
    problem = base.replace(limits=limits, dt=0.02)
    stepper, rng, fastest = Stepper(problem), np.random.default_rng(0), 0.0
    loop = Held(stepper, held_pose("screwing"))
    for number in range(300):
        if number % 10 == 0:
            q = near_comfort("screwing", rng, 40)
        step = loop.step(q, dt=0.02 * float(rng.choice([0.5, 1.0, 3.0])))
        assert "robot" not in step.reason
        fastest = max(fastest, float(np.linalg.norm(step.twist[3:])))
    assert fastest > 1.0


@pytest.mark.parametrize("beyond", [0.5e-9, 2e-9])
def test_what_was_sent_instead_may_be_at_the_limit_to_rounding(beyond: float) -> None:
    stepper = Stepper(plain_of("screwing"))
    sent = stepper.problem.twist_limit.speed + beyond
    if beyond < 1e-9:
        stepper.sent_instead(sent)
    else:
        with pytest.raises(InputError, match="within the speed limits"):
            stepper.sent_instead(sent)


def test_the_next_step_goes_on_from_what_was_sent_instead() -> None:
    stepper = Stepper(plain_of("screwing"))
    q, pose = near_comfort("screwing", np.random.default_rng(5), 20), held_pose("screwing")
    step = stepper.step(q, pose)
    for _ in range(50):
        step = stepper.step(q)
    sent, change = 0.5 * step.twist, stepper.problem.twist_limit.acceleration * stepper.problem.dt
    assert (np.abs(step.twist - sent) > 2 * change).any()
    stepper.sent_instead(sent)
    for step in (stepper.step(q), stepper.brake()):
        assert (np.abs(step.twist - sent) <= change * (1 + 1e-9)).all()
        sent = step.twist


def test_what_the_noise_of_its_pose_may_have_moved_out_is_not_asked_back() -> None:
    noise, problem = 0.002, problem_of("screwing")
    problem = problem.replace(robot=DeclaredRobot(pose_noise=noise))
    box, row, q = (
        problem.limit_of(WorkspaceBox),
        problem.row_names.index("workspace x"),
        comfort_of("screwing"),
    )
    readings = StepModel(problem).readings(q, held_pose("screwing"))
    for out, asks in ((0.9 * noise, False), (1.1 * noise + box.tolerance, True)):
        pose = held_pose("screwing").copy()
        pose[0, 3] = box.upper[0] + out
        away = np.array(
            away_function(StepModel(problem))(q, np.ones(32), readings, pose, 1, np.zeros(7))[0]
        ).ravel()
        assert away[row] == pytest.approx(out if asks else 0.0)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [-1, 1])
def test_a_right_angle_is_measured_as_one(axis: int, sign: int) -> None:
    turn = np.zeros(3)
    turn[axis] = sign * np.pi / 2
    after = np.round(Rotation.from_rotvec(turn).as_matrix())
    found = np.array(ca.evalf(_rotation(ca.SX.eye(3), ca.SX(ca.DM(after))))).ravel()
    np.testing.assert_allclose(found, turn, atol=1e-12)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("degrees", [-180, -120, 120, 180])
def test_a_larger_turn_is_measured_as_no_smaller_than_it_is(axis: int, degrees: float) -> None:
    """Half a turn has no sine, and a turn that is measured as none would be no fault."""
    turn = np.zeros(3)
    turn[axis] = np.radians(degrees)
    found = np.array(
        ca.evalf(_rotation(ca.SX.eye(3), ca.SX(ca.DM(Rotation.from_rotvec(turn).as_matrix()))))
    ).ravel()
    assert np.linalg.norm(found) >= min(np.radians(abs(degrees)), 1.0)
    if abs(degrees) < 180:
        assert np.linalg.norm(found) >= np.radians(abs(degrees))
        assert np.sign(found[axis]) == np.sign(degrees)
