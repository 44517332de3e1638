"""What a robot reports of itself: where the object is reckoned to be by it, and what it is blamed
for."""

from __future__ import annotations

from dataclasses import replace

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

from ergoqp.joints import INDEX, LOWER, UPPER
from ergoqp.limits import AxisCone, WorkspaceBox
from ergoqp.problem.settings import DeclaredRobot
from ergoqp.simulation.robot import RobotKind, SimulatedRobot, moved
from ergoqp.step.faults import explained_function
from ergoqp.step.layout import UNIT
from ergoqp.step.model import StepModel
from ergoqp.step.stepper import Stepper

WAITS = "at rest after a fault of the robot, until a pose is measured or try_again() is called"


@pytest.mark.slow
@pytest.mark.parametrize("kind", [RobotKind(delay=0.02), RobotKind(lag=0.02)], ids=["delay", "lag"])
def test_a_robot_that_is_late_and_reports_only_its_twist_stays_inside(kind: RobotKind) -> None:
    """What it did later, beyond what was sent just then, was not believed: 8 mm outside within a
    minute."""
    problem = small("screwing", DeclaredRobot(), None)
    stepper, rng, nearest, named = Stepper(problem), np.random.default_rng(3), -1.0, 0
    mover = SimulatedRobot(kind, held_pose("screwing"), rng)
    for number in range(3000):
        if number % 60 == 0:
            q = np.clip(comfort_of("screwing") + 0.6 * rng.normal(size=32), LOWER, UPPER)
        step = stepper.step(q, None if number else mover.measured_pose(), mover.reported_twist())
        named += "robot:" in step.reason
        if step.reason == WAITS:
            stepper.try_again()
        for pose in mover.execute(step.twist, 0.01):
            nearest = max(nearest, outside(problem, pose))
    assert nearest <= 5e-4
    # It is late, and that is not declared; it came near its walls all the same.
    assert named > 300
    assert nearest > -0.01


@pytest.mark.slow
@pytest.mark.parametrize("share", [2.0, -0.5, 0.3, None])
def test_nothing_that_is_reported_leads_anywhere_else_than_what_was_sent(
    share: float | None,
) -> None:
    stepper, q = (
        Stepper(problem_of("screwing")),
        near_comfort("screwing", np.random.default_rng(5), 20),
    )
    rng, expected, path = np.random.default_rng(0), held_pose("screwing"), 0.0
    step = stepper.step(q, expected)
    for number in range(400):
        expected = moved(expected, 0.01 * step.twist)
        path += float(np.linalg.norm(0.01 * step.twist[:3]))
        told = (
            (rng.normal(size=6) if number > 60 else step.twist)
            if share is None
            else share * step.twist
        )
        step = stepper.step(q, twist=told)
        np.testing.assert_allclose(step.pose, expected, atol=1e-9)
        if step.reason == WAITS:
            stepper.try_again()
    assert path > 0.004


def lies(kind: str, mover: SimulatedRobot, rng: np.random.Generator) -> np.ndarray:
    """A twist that a robot reports wrongly, though it does what it is sent."""
    twist, turn = mover.velocity, mover.pose[:3, :3].T
    return {
        "in the tool's frame": np.concatenate([turn @ twist[:3], turn @ twist[3:]]),
        "half": 0.5 * twist,
        "lost samples": twist * (rng.random() < 0.5),
        "a bias": twist - [0.002, 0, 0, 0, 0, 0],
        "in steps": np.floor(twist / 0.05) * 0.05,
    }[kind]


LIES = ("in the tool's frame", "half", "lost samples", "a bias", "in steps")


@pytest.mark.slow
@pytest.mark.parametrize("acknowledged", [False, True])
@pytest.mark.parametrize("lie", LIES)
def test_a_wrong_twist_never_leads_an_ideal_robot_out(lie: str, acknowledged: bool) -> None:
    """It was believed once it was found wrong: one that loses half of its samples led the object
    0.54 m out of its workspace within a minute."""
    problem = small("screwing", DeclaredRobot(), None)
    stepper, rng, nearest, waited = Stepper(problem), np.random.default_rng(4), -1.0, 0
    begin = moved(held_pose("screwing"), np.array([0.025, 0.025, -0.025, 0.0, 0.0, 0.09]))
    mover = SimulatedRobot(RobotKind(), begin, rng)
    for number in range(1500):
        if number % 60 == 0:
            q = np.clip(comfort_of("screwing") + 0.6 * rng.normal(size=32), LOWER, UPPER)
        given = {} if number else {"pose": mover.measured_pose()}
        step = stepper.step(q, twist=lies(lie, mover, rng), **given)
        waited += step.reason == WAITS
        if acknowledged and number % 200 == 199:
            stepper.try_again()
        for pose in mover.execute(step.twist, 0.01):
            nearest = max(nearest, outside(problem, pose))
    assert nearest <= 1e-6
    assert waited > 100


@pytest.mark.parametrize("how", ["pose", "try_again", "reset"])
def test_after_a_fault_without_a_pose_the_object_rests_until_somebody_says_where_it_is(
    how: str,
) -> None:
    problem, q = bold_of("screwing"), near_comfort("screwing", np.random.default_rng(5), 20)
    stepper, mover = (
        Stepper(problem),
        SimulatedRobot(RobotKind(), held_pose("screwing"), np.random.default_rng(0)),
    )
    reasons = []
    for number in range(400):
        given = {} if number else {"pose": mover.measured_pose()}
        step = stepper.step(q, twist=0.5 * mover.velocity, **given)
        reasons.append(step.reason)
        list(mover.execute(step.twist, 0.01))
    begin = reasons.index(WAITS)
    assert any(reason.startswith("robot:") for reason in reasons[:begin])
    # One sentence, and it stays.
    assert set(reasons[begin:]) == {WAITS}
    assert step.status == "braking"
    assert not step.twist.any()
    assert step.account("astray")[:6].max() > 1e-3
    if how == "try_again":
        stepper.try_again()
    if how == "reset":
        stepper.reset()
    given = {"pose": mover.measured_pose()} if how != "try_again" else {}
    steps = [stepper.step(q, **given, twist=mover.velocity)]
    for _ in range(20):
        list(mover.execute(steps[-1].twist, 0.01))
        steps.append(stepper.step(q, twist=mover.velocity))
    assert steps[-1].twist.any()
    assert steps[-1].status != "braking"
    # Where no pose was measured, both ways count; where one was, nothing is doubted any more.
    assert bool(steps[-1].account("astray").any()) == (how == "try_again")


def test_a_fault_while_the_pose_is_measured_starts_again_by_itself() -> None:
    problem, q = bold_of("screwing"), near_comfort("screwing", np.random.default_rng(5), 20)
    stepper, mover, reasons = (
        Stepper(problem),
        SimulatedRobot(RobotKind(), held_pose("screwing"), np.random.default_rng(0)),
        [],
    )
    for _ in range(300):
        step = stepper.step(q, mover.measured_pose(), 0.5 * mover.velocity)
        reasons.append(step.reason)
        list(mover.execute(step.twist, 0.01))
    assert sum("robot:" in reason for reason in reasons) > 50
    assert WAITS not in reasons
    assert "" in reasons[100:]


def test_what_was_sent_and_what_was_told_are_as_far_apart_as_plain_arithmetic_says() -> None:
    problem, rng = bold_of("screwing"), np.random.default_rng(6)
    q = near_comfort("screwing", np.random.default_rng(5), 20)
    stepper = Stepper(problem)
    sent = told_at = held_pose("screwing")
    farthest, named = np.zeros(7), 0
    step = stepper.step(q, sent)
    for number in range(300):
        told = step.twist * 0.4 + 0.05 * rng.normal(size=6) * (number % 7 == 0)
        told_at, sent = moved(told_at, 0.01 * told), moved(sent, 0.01 * step.twist)
        apart = told_at[:3, 3] - sent[:3, 3]
        angle = np.arccos(np.clip((np.trace(told_at[:3, :3].T @ sent[:3, :3]) - 1) / 2, -1, 1))
        farthest = np.maximum(farthest, [*np.maximum(apart, 0), *np.maximum(-apart, 0), angle])
        # In between some periods without a report, in which both move alike.
        step = stepper.step(q, twist=told)
        if number % 11 == 10:
            told_at, sent = moved(told_at, 0.01 * step.twist), moved(sent, 0.01 * step.twist)
            step = stepper.step(q)
        named += "robot" in step.reason
        if named:
            np.testing.assert_allclose(step.account("astray"), farthest, atol=1e-6)
        else:
            assert not step.account("astray").any()
        if step.reason == WAITS:
            stepper.try_again()
    assert named > 50
    # On nearly all axes, in both directions.
    assert np.sum(farthest > 1e-4) >= 6


@pytest.mark.parametrize("declared", [0.035, 0.0])
def test_a_first_pose_that_is_taken_from_the_posture_is_as_far_off_as_is_declared(
    declared: float,
) -> None:
    """Sensors that are 4 degrees off put the object 35 mm beside where it is."""
    problem = bold_of("screwing")
    problem = problem.replace(
        robot=DeclaredRobot(
            pose_from_posture=declared, pose_from_posture_deg=8.0 if declared else 0.0
        )
    )
    q = near_comfort("screwing", np.random.default_rng(5), 10)
    contact = np.array(problem.response.contact()(q)[0])
    # The object is 3 cm higher than the posture says.
    mover = SimulatedRobot(
        RobotKind(), moved(contact, np.array([0, 0, 0.03, 0, 0, 0])), np.random.default_rng(0)
    )
    box = problem.limit_of(WorkspaceBox)
    upper = (*box.upper[:2], contact[2, 3] + 0.08)
    limits = [WorkspaceBox(box.lower, upper) if limit is box else limit for limit in problem.limits]
    stepper, highest = Stepper(problem.replace(limits=limits)), -1.0
    posture = q.copy()
    posture[INDEX["right_shoulder_flexion"]] = np.radians(-20.0)
    for number in range(600):
        step = stepper.step(q if number == 0 else posture)
        for pose in mover.execute(step.twist, 0.01):
            highest = max(highest, pose[2, 3] - upper[2])
    assert (highest <= 0) == (declared > 0)
    assert highest > -0.03


@pytest.mark.parametrize(
    ("beside", "said"), [(0.01, "within what is not known of the pose"), (0.05, "coming back")]
)
def test_an_object_that_may_be_inside_is_said_to_be(beside: float, said: str) -> None:
    """Its pose is that of a posture, which may be off by 35 mm."""
    problem, q = problem_of("screwing"), comfort_of("screwing")
    box, x = problem.limit_of(WorkspaceBox), float(problem.response.contact()(q)[0][0, 3])
    narrow = replace(box, upper=(x - beside, *box.upper[1:]))
    limits = [narrow if limit is box else limit for limit in problem.limits]
    stepper = Stepper(problem.replace(robot=DeclaredRobot(delay=0.03), limits=limits))
    assert said in stepper.step(q).reason


@pytest.mark.slow
@pytest.mark.parametrize("average", [0.05, 0.2])
@pytest.mark.parametrize("inside", [1.0, 5.0])
@pytest.mark.parametrize("shoulder", [-20.0, 40.0])
def test_an_object_that_may_be_outside_of_its_cone_moves_on_but_no_further_out(
    average: float, inside: float, shoulder: float
) -> None:
    """The pose of a posture may be 8 deg off, which is more than is left to the end of the cone."""
    problem, q = bold_of("screwing"), comfort_of("screwing")
    problem = problem.replace(
        robot=DeclaredRobot(delay=0.03), control=replace(problem.control, average=average)
    )
    cone = problem.limit_of(AxisCone)
    angle = cone.half_angle_deg - np.degrees(Stepper(problem).step(q).margins["tool axis"])
    narrow = replace(cone, half_angle_deg=float(angle + inside))
    limits = [narrow if limit is cone else limit for limit in problem.limits]
    stepper, least, most = Stepper(problem.replace(limits=limits)), np.inf, 0.0
    posture = q.copy()
    posture[INDEX["right_shoulder_flexion"]] = np.radians(shoulder)
    for number in range(400):
        step = stepper.step(q if number == 0 else posture)
        least = min(least, np.degrees(step.margins["tool axis"]))
        most = max(most, np.abs(step.twist).max())
    assert most > 0.01
    assert least >= inside - 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("at", [40, 60, 80, 100])
@pytest.mark.parametrize("lag", [0.1, 0.2])
def test_how_a_lagging_robot_goes_on_while_a_call_is_late_is_no_fault_when_it_reports_its_twist(
    lag: float, at: int
) -> None:
    """Nobody heard of its motion in the hold, so the sum of what it reported did not come out
    even."""
    problem = small("screwing", DeclaredRobot(lag=lag, longest_hold=0.1), None)
    rng = np.random.default_rng(at)
    for _ in range(2):
        stepper, mover = (
            Stepper(problem),
            SimulatedRobot(RobotKind(lag=lag), held_pose("screwing"), rng),
        )
        for number in range(300):
            if number % 60 == 0:
                q = np.clip(comfort_of("screwing") + 0.6 * rng.normal(size=32), LOWER, UPPER)
            step = stepper.step(q, mover.measured_pose(), mover.reported_twist())
            assert "robot:" not in step.reason, number
            list(mover.execute(step.twist, 0.11 if number == at else 0.01))


def test_a_robot_that_reports_the_middle_of_its_ramp_is_not_late() -> None:
    stepper, q = (
        Stepper(bold_of("screwing")),
        near_comfort("screwing", np.random.default_rng(5), 30),
    )
    loop, before, last, fastest = (
        Held(stepper, held_pose("screwing")),
        np.zeros(6),
        np.zeros(6),
        0.0,
    )
    for _ in range(60):
        step = loop.step(q, twist=(before + last) / 2)
        assert "robot:" not in step.reason
        before, last, fastest = last, step.twist, max(fastest, float(np.abs(step.twist[:3]).max()))
    assert fastest > 0.16


NOISE = 0.004


def test_a_declared_hold_that_hides_in_the_noise_is_no_fault() -> None:
    # Nor does its turn stand out.
    problem = bold_of("screwing").replace(
        robot=DeclaredRobot(pose_noise=NOISE, pose_noise_deg=5.0, longest_hold=0.1)
    )
    stepper, q = Stepper(problem), near_comfort("screwing", np.random.default_rng(5), 30)
    pose, held = held_pose("screwing"), 0.0
    for number in range(90):
        sign = -1.0 if number < 20 else 1.0 if number != 41 else -1.0
        error = np.zeros(6)
        if number:
            error[:3] = sign * NOISE * np.sign(step.twist[:3])  # noqa: F821
        step = stepper.step(q, moved(pose, error))
        assert "robot:" not in step.reason, number
        # As long as a leap of it may still be noise.
        more = 3.9 * NOISE / np.abs(step.twist[:3]).max() if number == 40 else 0.0
        held = max(held, more)
        pose = moved(pose, step.twist * (0.01 + more))
    assert 0.05 < held < 0.1


@pytest.mark.parametrize("hold", [0.0, 0.1])
def test_a_hold_that_is_declared_does_not_hide_what_moves_at_rest(hold: float) -> None:
    """With a hold declared, three times the noise was let pass, at rest too."""
    problem = problem_of("screwing").replace(
        robot=DeclaredRobot(pose_noise=NOISE, longest_hold=hold)
    )
    stepper, q = Stepper(problem), comfort_of("screwing")
    loop = Held(stepper, held_pose("screwing"))
    for _ in range(200):
        step = loop.step(q)
    assert not step.twist.any()
    crept = 0.0
    while "robot:" not in loop.step(q).reason:
        crept += 1e-4
        assert crept <= 2 * NOISE + 0.0012
        loop.pose = moved(loop.pose, np.array([0, 1e-4, 0, 0, 0, 0]))


def test_what_is_reported_after_a_take_over_leads_no_further_than_what_was_sent() -> None:
    """How long it had moved before was counted as its motion: a report could lead 88 m away."""
    stepper, q = (
        Stepper(problem_of("screwing")),
        near_comfort("screwing", np.random.default_rng(5), 20),
    )
    twist = np.array([0.1, -0.1, 0.05, 0.0, 0.0, 0.0])
    stepper.reset(twist)
    step = stepper.step(q, twist=0.3 * twist)
    begin, expected = step.pose, step.pose
    for number in range(150):
        expected = moved(expected, 0.01 * step.twist)
        step = stepper.step(
            q,
            twist=(
                step.twist if number < 10 else np.full(6, -20.0) if number % 2 else np.full(6, 20.0)
            ),
        )
        np.testing.assert_allclose(step.pose, expected, atol=1e-9)
    assert np.linalg.norm(expected[:3, 3] - begin[:3, 3]) > 0.004


def test_what_moves_before_the_object_is_known_is_no_fault() -> None:
    stepper, moving = Stepper(problem_of("screwing")), np.array([0.1, 0, 0, 0, 0, 0])
    for _ in range(30):
        step = stepper.step(None, twist=moving)
        assert step.status == "braking"
        assert "robot" not in step.reason
    assert (
        "robot"
        not in stepper.step(comfort_of("screwing"), held_pose("screwing"), twist=np.zeros(6)).reason
    )


@pytest.mark.parametrize("wrong", [np.nan, np.inf, 1e9])
def test_a_twist_that_is_no_number_leaves_no_trace(wrong: float) -> None:
    stepper = Stepper(problem_of("screwing"))
    q, pose = near_comfort("screwing", np.random.default_rng(5), 20), held_pose("screwing")
    stepper.step(q, pose, np.zeros(6))
    for given in ({}, {"pose": pose}):
        assert stepper.step(q, twist=np.full(6, wrong), **given).status == "invalid"
        assert np.isfinite(stepper.state()).all()
    assert not stepper.step(q).account("astray").any()


def reasons_of_a_lie(share: float, offset: float, dt: float) -> list[str]:
    """What is said while a robot that reported rightly for a second reports something else."""
    q = near_comfort("screwing", np.random.default_rng(5), 20)
    stepper, reasons = Stepper(problem_of("screwing")), []
    step = stepper.step(q, held_pose("screwing"))
    for _ in range(100):
        step = stepper.step(q, twist=step.twist)
    for _ in range(20):
        step = stepper.step(q, twist=share * step.twist + offset, dt=dt)
        reasons.append(step.reason)
    return reasons


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, -1.0, 3.0])
def test_a_sample_over_a_period_that_is_too_long_shows_nothing(share: float) -> None:
    """Its noise over that time exceeds a fault; the same lie at the usual period is named."""
    for dt, named in ((0.05, False), (0.01, True)):
        assert any("robot:" in reason for reason in reasons_of_a_lie(share, 0.0, dt)) == named


def test_a_reported_speed_that_jumps_is_named_so() -> None:
    assert "robot: speed jumps" in reasons_of_a_lie(-10.0, -0.5, 0.01)


@pytest.mark.parametrize(
    "robot",
    [
        DeclaredRobot(),
        DeclaredRobot(gain_error=0.2),
        DeclaredRobot(gain_error=0.2, delay=0.02),
        DeclaredRobot(gain_error=0.2, lag=0.1, longest_hold=0.08),
    ],
    ids=["ideal", "gain", "delay", "hold"],
)
@pytest.mark.parametrize("seed", range(4))
def test_a_reported_twist_is_found_late_as_plain_arithmetic_says(
    robot: DeclaredRobot, seed: int
) -> None:
    model = StepModel(problem_of("screwing").replace(robot=robot))
    explained, rng, gain = explained_function(model), np.random.default_rng(seed), robot.gain_error
    given = {name: np.zeros(explained.size_in(name)) for name in explained.name_in()}
    given |= {"told": 1, "enable": 1, "started": 1, "lasted": 0.01}
    sent, off = 0.05 * rng.normal(size=6), 0.2 * rng.normal(size=6)
    up, down, due = rng.uniform(0, 4e-3, 6), rng.uniform(0, 4e-3, 6), rng.uniform(0, 4e-3, (6, 2))
    drift, path, held = 0.05 * rng.normal(size=6), np.array([0.02, 0.03]), rng.normal(size=(6, 2))
    given |= {"sent": sent, "executed": sent + off, "up": up, "down": down}
    story = {name: np.zeros(size) for name, size in model.blocks["story"].items()}
    # The same difference as in the period before: no noise.
    story |= {"drift": drift, "path": path, "surprise": np.column_stack([off, np.zeros(6)])}
    due = story["due"] = due if robot.owes else 0 * due
    given["story"] = np.concatenate([np.ravel(part, "F") for part in story.values()])
    held = 0.1 * np.abs(held)
    if "held" in model.blocks["compared"]:
        compared = {name: np.zeros(size) for name, size in model.blocks["compared"].items()}
        parts = (compared | {"held": held}).values()
        given["compared"] = np.concatenate([np.ravel(part, "F") for part in parts])
    found = float(np.array(explained(**given)["next_said"])[0, 0])

    drift = drift + 0.01 * off
    path = path + 0.01 * np.array([np.linalg.norm(sent[:3]), np.linalg.norm(sent[3:])])
    slack = 0.005 * np.abs(sent) + gain * np.repeat(path, 3)
    fastest = np.maximum(held.max(axis=1), np.abs(sent))
    slack += (1 + gain) * robot.longest_hold * fastest
    beyond = np.maximum(
        drift - (1 + gain) * (down + due[:, 0]), -drift - (1 + gain) * (up + due[:, 1])
    )
    parts = np.maximum(beyond - slack, 0) / (0.75 * UNIT)
    assert found == pytest.approx(max(np.linalg.norm(parts[:3]), np.linalg.norm(parts[3:])))
    assert found > 1
