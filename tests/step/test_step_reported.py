"""What a robot reports of itself: where the object is reckoned to be by it, and what it is blamed
for."""

from __future__ import annotations

import casadi as ca
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
from ergoqp.problem.robot import DeclaredRobot
from ergoqp.simulation.robot import RobotKind, SimulatedRobot, moved
from ergoqp.step.packing import count
from ergoqp.step.robot_watch.memory import watch_blocks
from ergoqp.step.robot_watch.watch import reckoned
from ergoqp.step.stepper import Stepper


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
        for pose in mover.execute(step.twist, 0.01):
            nearest = max(nearest, outside(problem, pose))
    assert nearest <= 5e-4
    # It is late, and that is not declared; it came near its walls all the same.
    assert named > 300
    assert nearest > -0.003


@pytest.mark.parametrize("share", [2.0, -0.5, 0.3, None])
def test_nothing_that_is_reported_leads_further_than_what_was_sent(share: float | None) -> None:
    stepper, q = (
        Stepper(problem_of("screwing")),
        near_comfort("screwing", np.random.default_rng(5), 20),
    )
    rng, begin, most = np.random.default_rng(0), held_pose("screwing"), np.zeros((2, 3))
    step = stepper.step(q, begin)
    for number in range(200):
        sent = 0.01 * step.twist[:3]
        most += np.maximum([sent, -sent], 0)
        told = (
            (rng.normal(size=6) if number > 60 else step.twist)
            if share is None
            else share * step.twist
        )
        step = stepper.step(q, twist=told)
        gone = step.pose[:3, 3] - begin[:3, 3]
        assert (gone <= most[0] + 1e-12).all(), number
        assert (gone >= -most[1] - 1e-12).all(), number
    assert most.max() > 0.004


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


def test_what_a_robot_was_short_of_is_forgotten_once_it_is_forgiven() -> None:
    """Where it stood still it owes nothing later: half a second after it is late no more."""
    stepper, rng = Stepper(bold_of("screwing")), np.random.default_rng(5)
    q, step = (
        near_comfort("screwing", rng, 30),
        stepper.step(comfort_of("screwing"), held_pose("screwing")),
    )
    blamed = [False]
    while not (blamed[-1] is False and any(blamed)):
        step = stepper.step(q, twist=np.zeros(6))
        blamed.append("robot:" in step.reason)
    begin, most = step.pose, np.zeros((2, 3))
    for number in range(150):
        sent = 0.01 * step.twist[:3]
        most += np.maximum([sent, -sent], 0)
        step = stepper.step(q, twist=3.0 * step.twist)
        gone = step.pose[:3, 3] - begin[:3, 3]
        assert (gone <= most[0] + 1e-12).all(), number
        assert (gone >= -most[1] - 1e-12).all(), number
    assert most.max() > 0.004


def test_what_is_reported_after_a_take_over_leads_no_further_than_what_was_sent() -> None:
    """How long it had moved before was counted as its motion: a report could lead 88 m away."""
    stepper, q = (
        Stepper(problem_of("screwing")),
        near_comfort("screwing", np.random.default_rng(5), 20),
    )
    twist = np.array([0.1, -0.1, 0.05, 0.0, 0.0, 0.0])
    stepper.reset(twist)
    step = stepper.step(q, twist=0.3 * twist)
    begin, most = step.pose, np.zeros((2, 3))
    for number in range(150):
        sent = 0.01 * step.twist[:3]
        most += np.maximum([sent, -sent], 0)
        step = stepper.step(
            q,
            twist=(
                step.twist if number < 10 else np.full(6, -20.0) if number % 2 else np.full(6, 20.0)
            ),
        )
        gone = step.pose[:3, 3] - begin[:3, 3]
        assert (gone <= most[0] + 1e-12).all(), number
        assert (gone >= -most[1] - 1e-12).all(), number
    assert most.max() > 0.004


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


def test_the_account_of_what_was_reported_is_that_of_the_law_in_plain_words() -> None:
    problem = problem_of("screwing")
    blocks = watch_blocks(problem)
    names = (
        "sent",
        "changed",
        "executed",
        "lasted",
        "told",
        "measured",
        "started",
        "parked",
        "idled",
    )
    given = {name: ca.SX.sym(name, 6 if name in names[:3] else 1) for name in names}
    given |= {name: ca.SX.sym(name, count(blocks[name])) for name in ("account", "said")}
    law = ca.Function(
        "law",
        list(given.values()),
        list(reckoned(problem.robot, given)),
        list(given),
        ["moved", "next_account"],
    )
    rng = np.random.default_rng(2)
    short, ahead = np.zeros((6, 2)), np.zeros(6)
    taken_back = 0
    for _ in range(400):
        sent, executed, lasted = 0.1 * rng.normal(size=6), 0.1 * rng.normal(size=6), 0.01
        # A declared robot that is late has this period done other than it was sent.
        changed = 0.0002 * rng.normal(size=6)
        told, measured, started, parked = (
            float(rng.random() < share) for share in (0.8, 0.05, 0.95, 0.1)
        )
        signs, fault, idled = (
            rng.choice([0.0, 2.0], 2, p=[0.7, 0.3]),
            rng.choice([0.0, 2.0], p=[0.7, 0.3]),
            rng.choice([0.0, 9.0]),
        )
        found = law(
            **dict(
                zip(
                    names,
                    (sent, changed, executed, lasted, told, measured, started, parked, idled),
                    strict=True,
                )
            ),
            account=np.concatenate([short.ravel(order="F"), ahead]),
            said=np.concatenate([signs, [fault, 0.0]]),
        )
        known = bool(signs[0] or signs[1] or fault)
        declared = sent * lasted + changed
        most = short + np.maximum(np.stack([sent, -sent], axis=1), 0) * lasted * started
        way = executed * lasted if told else declared
        parts = np.clip(np.stack([way, -way], axis=1), 0, most)
        done = parts[:, 0] - parts[:, 1]
        moved = done - ahead if told and known else declared
        taken_back += bool(told and known and ahead.any())
        np.testing.assert_allclose(np.array(found["moved"]).ravel(), moved, atol=1e-15)
        forgotten = idled > 0 or (parked and not known)
        ahead = np.zeros(6) if forgotten or measured or not started else ahead + moved - done
        short = np.zeros((6, 2)) if forgotten else most - parts
        np.testing.assert_allclose(
            np.array(found["next_account"]).ravel(),
            np.concatenate([short.ravel(order="F"), ahead]),
            atol=1e-15,
        )
    assert taken_back > 10
