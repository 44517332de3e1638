"""What is said of a robot: at rest, when its pose is lost, when it ramps down by itself, and how
soon."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from step_samples import (
    Held,
    bold_of,
    comfort_of,
    held_pose,
    near_comfort,
    outside,
    problem_of,
    small,
)

from ergoqp.joints import LOWER, UPPER
from ergoqp.limits import AxisCone, TwistLimit, WorkspaceBox
from ergoqp.problem.settings import DeclaredRobot
from ergoqp.simulation.robot import RobotKind, SimulatedRobot, moved
from ergoqp.step.faults import explained_function
from ergoqp.step.layout import STORY, split
from ergoqp.step.model import StepModel
from ergoqp.step.stepper import Stepper

UNASKED = "robot: moves although nothing was sent"


@pytest.mark.slow
@pytest.mark.parametrize("average", [None, 0.0], ids=["with the mean", "sent as planned"])
@pytest.mark.parametrize("share", [0.0, 0.3, 1.0], ids=["ideal", "a third of it", "as declared"])
@pytest.mark.parametrize("name", ["dentist", "screwing"])
def test_a_robot_less_late_than_declared_stays_inside_while_its_pose_is_lost(
    name: str, share: float, average: float | None
) -> None:
    """What it still owed when it was seen last was forgotten while it was not seen: 7 mm outside,
    and blamed afterwards."""
    declared = DeclaredRobot(delay=0.03, lag=0.05, pose_delay=0.02)
    problem = small(name, declared, average)
    mover = SimulatedRobot(
        RobotKind.of(declared, np.random.default_rng(0), share),
        held_pose(name),
        np.random.default_rng(0),
    )
    stepper, rng, nearest = Stepper(problem), np.random.default_rng(1), -1.0
    for number in range(450):
        if number % 60 == 0:
            q = np.clip(comfort_of(name) + 0.6 * rng.normal(size=32), LOWER, UPPER)
        step = stepper.step(q, mover.measured_pose() if number // 37 % 3 == 0 else None)
        assert "robot:" not in step.reason, (number, step.reason)
        for pose in mover.execute(step.twist, 0.01):
            nearest = max(nearest, outside(problem, pose))
    assert nearest <= 1e-5
    # It came near its walls.
    assert nearest > -0.003


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 1.0])
def test_turns_of_a_robot_less_late_than_declared_are_no_fault_when_it_is_seen_again(
    share: float,
) -> None:
    """Turns do not commute: half as late about one axis after another, it ends elsewhere."""
    declared = DeclaredRobot(lag=0.3)
    problem = bold_of("screwing")
    box, cone = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone)
    wide = [
        AxisCone(cone.direction, 150.0) if limit is cone else limit
        for limit in problem.limits
        if limit is not box
    ]
    problem = problem.replace(limits=wide, robot=declared)
    mover = SimulatedRobot(
        RobotKind.of(declared, np.random.default_rng(0), share),
        held_pose("screwing"),
        np.random.default_rng(0),
    )
    stepper, rng, turned = Stepper(problem), np.random.default_rng(1), 0.0
    for number in range(900):
        if number % 90 == 0:
            q = np.clip(comfort_of("screwing") + 0.8 * rng.normal(size=32), LOWER, UPPER)
        step = stepper.step(q, mover.measured_pose() if number % 90 < 5 else None)
        assert "robot:" not in step.reason, (number, step.reason)
        turned += 0.01 * float(np.linalg.norm(step.twist[3:]))
        list(mover.execute(step.twist, 0.01))
    assert turned > 1.0


@pytest.mark.slow
@pytest.mark.parametrize("reported", [False, True])
@pytest.mark.parametrize("given", [{}, {"posture": None}], ids=["settled", "no frame"])
@pytest.mark.parametrize("speed", [0.005, 0.09])
def test_what_moves_although_nothing_was_sent_is_named_and_starts_again(
    speed: float, given: dict[str, Any], reported: bool
) -> None:
    """At rest the comparison began anew with every step: an object was carried 180 mm and settled
    all the way."""
    stepper, q = Stepper(problem_of("screwing")), comfort_of("screwing")
    loop = Held(stepper, held_pose("screwing"))
    for _ in range(200):
        step = loop.step(q)
    assert step.status == "settled"
    carried, named = 0.0, None
    twist = np.array([0.0, speed, 0.0, 0.0, 0.0, 0.0])
    for number in range(100):
        loop.pose = moved(loop.pose, twist * 0.01)
        carried += speed * 0.01
        step = loop.step(given.get("posture", q), **({"twist": twist} if reported else {}))
        assert not step.twist.any()
        if named is None and UNASKED in step.reason:
            named = carried
            assert step.status == "braking"
        if named is not None and number % 20 == 19:
            assert "robot:" in step.reason
    assert named is not None
    assert named <= 0.001 + 2 * speed * 0.01
    # Left alone, it is forgiven after half a second.
    named_on = [UNASKED in loop.step(q).reason for _ in range(80)]
    assert named_on == sorted(named_on, reverse=True)
    assert 25 <= sum(named_on) <= 50


@pytest.mark.slow
def test_what_happens_to_an_object_that_comes_to_rest_unseen_is_noticed_when_it_is_seen_again() -> (
    None
):
    """It had come to rest without a pose, and what it was compared with began there: nowhere."""
    stepper, q = (
        Stepper(problem_of("screwing")),
        near_comfort("screwing", np.random.default_rng(5), 15),
    )
    loop, pushed = Held(stepper, held_pose("screwing")), np.array([0.0, 0.005, 0.0, 0.0, 0.0, 0.0])
    for _ in range(40):
        step = loop.step(q)
    assert step.twist.any()
    for _ in range(120):
        step = loop.step(None, pose=None)
    assert not step.twist.any()
    loop.pose = moved(loop.pose, pushed)
    assert "robot:" in loop.step(q).reason
    stepper.reset()
    loop.pose = held_pose("screwing")
    for number in range(160):
        loop.step(*((q,) if number < 40 else (None,)), **({} if number < 40 else {"pose": None}))
    assert "robot:" not in loop.step(q).reason


@pytest.mark.slow
def test_a_reported_twist_alone_shows_that_it_moves_at_rest() -> None:
    stepper, q = Stepper(problem_of("screwing")), comfort_of("screwing")
    for _ in range(200):
        stepper.step(q, twist=np.zeros(6))
    rng, still = np.random.default_rng(0), [0.0] * 6
    noisy = [stepper.step(q, twist=still + 1e-3 * rng.normal(size=6)).reason for _ in range(1000)]
    assert not [reason for reason in noisy if "robot:" in reason]
    # A sensor that reads 1 mm/s at rest is none either.
    assert not [
        1 for _ in range(1000) if "robot:" in stepper.step(q, twist=[0.0, 1e-3, 0, 0, 0, 0]).reason
    ]
    reasons = [stepper.step(q, twist=[0.0, 0.05, 0.0, 0.0, 0.0, 0.0]).reason for _ in range(20)]
    assert any("robot:" in reason for reason in reasons)


@pytest.mark.slow
@pytest.mark.parametrize("speed", [0.05, 0.3])
@pytest.mark.parametrize("reported", [False, True])
def test_what_is_not_enabled_may_be_moved_by_hand(speed: float, reported: bool) -> None:
    stepper, q = Stepper(problem_of("screwing")), comfort_of("screwing")
    loop = Held(stepper, held_pose("screwing"))
    step = loop.step(q)
    for number in range(400):
        enable, twist = number % 200 < 100, np.zeros(6)
        if not enable and number % 100 > 60:
            twist[1] = speed if number < 200 else -speed
            loop.pose = moved(loop.pose, 0.01 * twist)
        twist += step.twist
        step = loop.step(q, enable=enable, **({"twist": twist} if reported else {}))
        assert "robot:" not in step.reason, number
        assert enable or step.reason == "not enabled"


@pytest.mark.slow
@pytest.mark.parametrize("elapsed", [0.08, 0.2, 0.3])
@pytest.mark.parametrize(
    "robot", [DeclaredRobot(), DeclaredRobot(delay=0.02, lag=0.05)], ids=["ideal", "late"]
)
def test_a_robot_that_ramped_down_by_itself_is_not_judged_and_rests_before_it_moves(
    robot: DeclaredRobot, elapsed: float
) -> None:
    """Its own ramp is not the step's to the last millimetre: it was said to stand still, or its
    pose to jump."""
    problem, q = (
        bold_of("screwing").replace(robot=robot),
        near_comfort("screwing", np.random.default_rng(5), 20),
    )
    stepper = Stepper(problem)
    mover = SimulatedRobot(
        RobotKind.of(robot, np.random.default_rng(0)),
        held_pose("screwing"),
        np.random.default_rng(0),
    )
    for _ in range(40):
        step = stepper.step(q, mover.measured_pose())
        list(mover.execute(step.twist, 0.01))
    assert np.abs(step.twist).max() > 0.1
    # It ramps down along a line as fast as its limits allow, and does not wait for the mean.
    most, twist, passed = problem.twist_limit.acceleration, step.twist.copy(), 0.0
    time_to_stop = float(np.max(np.abs(step.twist) / most))
    while passed < elapsed - 1e-9:
        passed += 0.005
        list(mover.execute(twist * max(0.0, 1 - passed / time_to_stop), 0.005))
    step, rested = stepper.brake(elapsed=elapsed), False
    for _ in range(150):
        list(mover.execute(step.twist, 0.01))
        step = stepper.step(q, mover.measured_pose())
        assert "robot:" not in step.reason
        rested |= not step.twist.any()
        assert rested or step.status == "braking"
    assert rested
    assert step.status != "braking"


@pytest.mark.parametrize("wrong", [1.0, 1.001, 0.95])
def test_two_points_come_to_rest_without_a_frame_whatever_their_distance(wrong: float) -> None:
    """A length that was measured wrong was mended for ever from a posture that nobody updated: 13
    mm in a minute."""
    problem = problem_of("forearm")
    stepper = Stepper(problem)
    elbow, wrist = np.array([0.1, -0.2, -0.25]), np.array([0.3, -0.15, -0.1])
    wrist = elbow + (wrist - elbow) / np.linalg.norm(wrist - elbow) * 0.2555 * wrong
    for _ in range(30):
        stepper.step(np.concatenate([elbow, wrist]))
    for _ in range(100):
        step = stepper.step(None)
    assert not step.twist.any()
    assert not stepper.brake().twist.any()


@pytest.mark.parametrize("name", ["forearm", "screwing"])
@pytest.mark.parametrize("elapsed", [np.inf, 1e308, 1e9, 600.0])
def test_however_long_it_ramped_down_braking_answers(name: str, elapsed: float) -> None:
    """Cut into periods, for ever was for ever."""
    problem = problem_of(name)
    stepper = Stepper(problem)
    stepper.reset(twist=0.5 * problem.twist_limit.speed)
    assert stepper.brake().twist.any()
    step = stepper.brake(elapsed=elapsed)
    assert not step.twist.any()
    assert step.status == "braking"


def creeping(declared: DeclaredRobot, creep: np.ndarray, seconds: float) -> np.ndarray | None:
    """By how much (6,) a robot that keeps its declaration but for a creep has crept when it is
    blamed; None: it is not."""
    problem, rng = bold_of("screwing").replace(robot=declared), np.random.default_rng(2)
    stepper, mover = (
        Stepper(problem),
        SimulatedRobot(RobotKind(), held_pose("screwing"), np.random.default_rng(0)),
    )
    crept = np.zeros(6)
    for number in range(round(seconds * 100)):
        if number % 50 == 0:
            q = near_comfort("screwing", rng, 40)
        step = stepper.step(q, mover.measured_pose())
        if "robot:" in step.reason:
            return crept
        list(mover.execute(step.twist, 0.01))
        mover.pose = moved(mover.pose, creep * 0.01)
        crept += creep * 0.01
    return None


@pytest.mark.parametrize("noise", [0.0, 0.001, 0.003])
def test_a_creep_is_named_after_a_millimetre_beyond_twice_the_noise(noise: float) -> None:
    """Two poses of an honest robot differ by up to twice its noise, so nothing less shows that it
    is not."""
    crept = creeping(
        DeclaredRobot(pose_noise=noise), np.array([0.0, 0.005, 0.0, 0.0, 0.0, 0.0]), 4.0
    )
    assert crept is not None
    assert 2 * noise + 0.001 - 1e-4 <= crept[1] <= 2 * noise + 0.001 + 2e-4


@pytest.mark.slow
@pytest.mark.parametrize("noise_deg", [0.0, 0.2, 0.5])
def test_a_turning_creep_is_named_soon(noise_deg: float) -> None:
    """The error of the pose at the begin, which turns with the object, and its error now: not twice
    that."""
    creep = np.array([0.0, 0.0, 0.0, 0.0, 0.0, np.radians(1.0)])
    crept = creeping(DeclaredRobot(pose_noise_deg=noise_deg), creep, 6.0)
    assert crept is not None
    assert noise_deg <= np.degrees(crept[5]) <= 1.3 * (1 + np.sqrt(3)) * noise_deg + 0.3


@pytest.mark.slow
def test_what_a_gain_error_allows_along_the_way_it_does_not_allow_across_it() -> None:
    """A drift sideways of 1.8 % of the way was taken for a gain error of 2 %: 60 mm in 20 s."""
    problem, pose = (
        bold_of("screwing").replace(robot=DeclaredRobot(gain_error=0.02)),
        held_pose("screwing"),
    )
    along = TwistLimit(axes=("x", "y", "z"))
    problem = problem.replace(
        limits=[along if isinstance(limit, TwistLimit) else limit for limit in problem.limits]
    )
    q, named = near_comfort("screwing", np.random.default_rng(5), 20), {}
    for share in (0.018, 0.0):
        stepper, mover = (
            Stepper(problem),
            SimulatedRobot(RobotKind(gain=1.018), pose, np.random.default_rng(0)),
        )
        across = 0.0
        for _ in range(250):
            step = stepper.step(q, mover.measured_pose())
            if "robot:" in step.reason:
                named[share] = across
                break
            list(mover.execute(step.twist, 0.01))
            way = step.twist[:3] * 0.01
            # To the side, level.
            aside = np.cross(way, [0.0, 0.0, 1.0]) * share
            mover.pose = moved(mover.pose, np.concatenate([aside, np.zeros(3)]))
            across += float(np.linalg.norm(aside))
    assert 0.001 < named[0.018] < 0.004
    # And a robot that only moves more than it is sent, by as much as is declared, is not blamed.
    assert 0.0 not in named


@pytest.mark.slow
@pytest.mark.parametrize(
    "declared",
    [DeclaredRobot(), DeclaredRobot(lag=0.05), DeclaredRobot(longest_hold=0.6)],
    ids=repr,
)
def test_one_sample_of_a_reported_twist_over_a_long_period_shows_nothing(
    declared: DeclaredRobot,
) -> None:
    """Noise of 20 % times half a second is more than a fault, and one sample does not tell it from
    one; the pose does."""
    problem = bold_of("screwing").replace(robot=declared)
    stepper = Stepper(problem)
    for seed in range(12):
        rng = np.random.default_rng(seed)
        stepper.reset()
        mover = SimulatedRobot(
            RobotKind(lag=declared.lag, speed_noise=0.2), held_pose("screwing"), rng
        )
        q = near_comfort("screwing", rng, 40)
        for number in range(60):
            dt = 0.56 if number == 40 else 0.01
            step = stepper.step(
                q, mover.measured_pose(), mover.reported_twist() if number else None, dt=dt
            )
            assert "robot:" not in step.reason, (seed, number, step.reason)
            list(mover.execute(step.twist, dt))
    # What really happened, the pose shows, beyond what a hold explains.
    mover.pose[1, 3] += 0.01 + 2 * declared.longest_hold * problem.twist_limit.linear_speed
    assert "robot:" in stepper.step(q, mover.measured_pose(), np.zeros(6)).reason


def test_few_samples_of_a_noisy_twist_are_not_taken_for_exact() -> None:
    """One of 150 such loops was blamed: its few samples scattered less than their noise by
    chance."""
    problem = bold_of("screwing")
    stepper, rng = Stepper(problem), np.random.default_rng(4)
    mover = SimulatedRobot(RobotKind(speed_noise=0.2), held_pose("screwing"), rng)
    q = near_comfort("screwing", rng, 40)
    for number in range(120):
        step = stepper.step(q, mover.measured_pose(), mover.reported_twist() if number else None)
        assert "robot:" not in step.reason, (number, step.reason)
        list(mover.execute(step.twist, 0.01))


def blur_of(executed: np.ndarray) -> np.ndarray:
    """What counts as noise (6, 2) [m, rad, squared] of twists (n, 6) that a robot reports which is
    sent to stand still."""
    problem = bold_of("screwing")
    explained = explained_function(StepModel(problem))
    given = {name: np.zeros(explained.size_in(i)) for i, name in enumerate(explained.name_in())}
    given |= {"told": 1.0, "started": 1.0, "lasted": 0.01, "enable": 1.0}
    for twist in executed:
        found = explained.call({**given, "executed": twist})
        given["story"], given["said"] = found["next_story"], found["next_said"]
    return np.array(split(STORY, found["next_story"])["blur"])


def test_noise_is_what_scatters_and_not_what_goes_on_or_changes_steadily() -> None:
    rng, count, sigma = np.random.default_rng(0), 400, 0.02
    noise = sigma * rng.normal(size=(count, 6))
    steady, rising = np.full((count, 6), 0.05), np.outer(np.arange(count), np.full(6, 1e-4))
    expected = count * (sigma * 0.01) ** 2
    for executed in (noise, noise + steady, noise + rising):
        # Both ways of reckoning it are without a bias.
        assert np.sqrt(blur_of(executed) / expected) == pytest.approx(np.ones((6, 2)), abs=0.15)
    # The first sample is a change, and what follows is none.
    for executed, first in ((steady, 0.05), (rising, 1e-4)):
        assert np.all(blur_of(executed)[:, 1] <= (first * 0.01) ** 2 / 3 * 1.001)


@pytest.mark.slow
@pytest.mark.parametrize(("mm", "deg"), [(0.5, 0.0), (0.0, 0.3), (3.0, 1.0)])
def test_noise_that_is_not_declared_has_one_sentence_with_what_to_declare(
    mm: float, deg: float
) -> None:
    """Half a millimetre stopped the object for ever, with another text at every other step."""
    stepper, rng = Stepper(bold_of("screwing")), np.random.default_rng(0)
    kind = RobotKind(pose_noise=1e-3 * mm, pose_noise_deg=deg)
    mover, q = SimulatedRobot(kind, held_pose("screwing"), rng), near_comfort("screwing", rng, 20)
    reasons = []
    for _ in range(600):
        step = stepper.step(q, mover.measured_pose())
        reasons.append(step.reason)
        list(mover.execute(step.twist, 0.01))
    [reason] = set(reasons[100:])
    assert reason.startswith("robot: the measured ")
    assert len(set(reasons)) <= 4
    # What it names is enough, and no more than five times the noise.
    name, value = reason.split("[robot] ")[1].rstrip(")").split(" = ")
    true = {"pose_noise": 1e-3 * mm, "pose_noise_deg": deg}[name]
    assert true <= float(value) <= 5 * true
    declared = {"pose_noise": 2e-3 * mm, "pose_noise_deg": 2 * deg} | {name: float(value)}
    stepper = Stepper(bold_of("screwing").replace(robot=DeclaredRobot(**declared)))
    mover = SimulatedRobot(kind, held_pose("screwing"), rng)
    for _ in range(300):
        step = stepper.step(q, mover.measured_pose())
        assert "robot:" not in step.reason
        list(mover.execute(step.twist, 0.01))


def test_a_push_at_rest_is_no_noise_even_where_the_pose_has_some() -> None:
    stepper, rng = Stepper(problem_of("screwing")), np.random.default_rng(0)
    q, pose = comfort_of("screwing"), held_pose("screwing")
    for _ in range(200):
        step = stepper.step(q, moved(pose, np.r_[rng.uniform(-2e-4, 2e-4, 3), 0, 0, 0]))
    assert not step.twist.any()
    reasons = []
    for number in range(100):
        pose = moved(pose, np.array([0.0, 2e-4 * (number < 50), 0, 0, 0, 0]))
        noisy = moved(pose, np.r_[rng.uniform(-2e-4, 2e-4, 3), 0, 0, 0])
        reasons.append(stepper.step(q, noisy).reason)
    assert any(UNASKED in reason for reason in reasons)
    assert not any("scatters" in reason for reason in reasons)


def test_one_wrong_pose_at_rest_is_a_jump_and_no_noise() -> None:
    stepper, q, pose = (
        Stepper(problem_of("screwing")),
        comfort_of("screwing"),
        held_pose("screwing"),
    )
    for _ in range(200):
        step = stepper.step(q, pose)
    assert not step.twist.any()
    away = moved(pose, np.array([0, 0.005, 0, 0, 0, 0]))
    reasons = [stepper.step(q, given).reason for given in (away, *[pose] * 60)]
    assert any("jumps" in reason for reason in reasons)
    assert not any("scatters" in reason for reason in reasons)


@pytest.mark.slow
def test_the_name_of_a_fault_stays() -> None:
    """A soft robot had hundreds of texts in one loop."""
    stepper, rng = Stepper(bold_of("screwing")), np.random.default_rng(0)
    q, mover = (
        near_comfort("screwing", rng, 20),
        SimulatedRobot(RobotKind(lag=0.1, gain=0.9), held_pose("screwing"), rng),
    )
    reasons = []
    for _ in range(400):
        step = stepper.step(q, mover.measured_pose())
        reasons.append(step.reason)
        list(mover.execute(step.twist, 0.01))
    named = [reason for reason in reasons if reason.startswith("robot:")]
    assert len(named) > 100
    assert len(set(named)) <= 4
