"""Robots that turn without rest: what is declared is no fault, and what is a little more is one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.tracking_faults import CONE, FAR, Cornered, driven_problem, turn_about
from ergoqp.joints import JOINTS
from ergoqp.problem.settings import DeclaredRobot
from ergoqp.simulation.robot import RobotKind, SimulatedRobot
from ergoqp.step.stepper import Stepper

EXAMPLE = DeclaredRobot(
    delay=0.02, lag=0.1, gain_error=0.02, pose_delay=0.01, pose_noise=0.001, pose_noise_deg=0.2
)
"""That of docs/loop.md, without its hold."""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("declared", "gain"),
    [
        (DeclaredRobot(gain_error=0.05, pose_noise_deg=0.1), 0.95),
        (DeclaredRobot(gain_error=0.05, pose_noise_deg=0.1), 0.975),
        (DeclaredRobot(gain_error=0.2, pose_noise_deg=0.1), 0.8),
        (DeclaredRobot(lag=0.2, pose_noise_deg=0.1), 1.0),
        (replace(EXAMPLE, longest_hold=0.1), 0.98),
        (EXAMPLE, 0.98),
        (EXAMPLE, 1.02),
    ],
    ids=repr,
)
def test_a_robot_as_declared_that_turns_on_and_on_is_no_fault(
    declared: DeclaredRobot, gain: float
) -> None:
    """Its error turns with the object, and was compared along the axes of the world: 22 % of the
    steps braked."""
    stepper = Stepper(driven_problem(declared))
    kind = replace(RobotKind.of(declared, np.random.default_rng(0)), gain=gain)
    for seed in (1, 2):
        assert turn_about(stepper, kind, 12.0, np.random.default_rng(seed), False) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("declared", "seed"),
    [
        # The new comparison began in the axes of the one before.
        (DeclaredRobot(lag=0.1, gain_error=0.5, pose_noise_deg=0.1), 8),
        (DeclaredRobot(delay=0.1, gain_error=0.5, pose_noise_deg=0.1), 8),
        # What is owed turns with the difference that is present.
        (DeclaredRobot(delay=0.1, gain_error=0.5, pose_noise_deg=0.1), 0),
        (DeclaredRobot(lag=0.2, gain_error=0.3, pose_noise_deg=0.1), 0),
    ],
    ids=repr,
)
def test_a_robot_that_is_late_and_does_half_as_much_again_is_no_fault_where_that_is_declared(
    declared: DeclaredRobot, seed: int
) -> None:
    walls = (FAR, CONE) if declared.gain_error > 0.4 else (FAR,)
    stepper = Stepper(driven_problem(declared, walls))
    kind = replace(RobotKind.of(declared, np.random.default_rng(0)), gain=1 + declared.gain_error)
    assert turn_about(stepper, kind, 6.5, np.random.default_rng(seed), False) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("declared", "true"),
    [
        (DeclaredRobot(gain_error=0.05, pose_noise_deg=0.1), {"gain": 0.92}),
        (DeclaredRobot(gain_error=0.05, pose_noise_deg=0.1), {"gain": 1.08}),
        (DeclaredRobot(pose_noise_deg=0.2), {"gain": 0.97}),
        (DeclaredRobot(lag=0.15, pose_noise_deg=0.2), {"lag": 0.195}),
    ],
    ids=repr,
)
@pytest.mark.parametrize("seed", range(3))
def test_a_robot_a_little_beyond_what_is_declared_is_named_within_three_seconds(
    declared: DeclaredRobot, true: dict[str, float], seed: int
) -> None:
    stepper = Stepper(driven_problem(declared))
    kind = replace(RobotKind.of(declared, np.random.default_rng(0)), **true)
    assert turn_about(stepper, kind, 3.0, np.random.default_rng(seed), True)


def test_an_error_about_a_slanted_axis_is_as_large_as_one_about_a_straight_axis() -> None:
    """What is declared of a gain is along the turn: along all three axes at once it would hide a
    third more of it, whatever the axis."""
    declared = DeclaredRobot(gain_error=0.05, pose_noise_deg=0.1)
    stepper, soon = Stepper(driven_problem(declared)), []
    for axis in ([1, 0, 0], [1, 1, 1]):
        stepper.reset()
        mover = SimulatedRobot(
            RobotKind(gain=1.08, pose_noise_deg=0.1), np.eye(4), np.random.default_rng(0)
        )
        q = np.zeros(len(JOINTS))
        q[3:6] = -3.0 * np.array(axis) / np.linalg.norm(axis)
        for number in range(300):
            step = stepper.step(q, mover.measured_pose())
            if "robot:" in step.reason:
                soon.append(number)
                break
            list(mover.execute(step.twist, 0.01))
    assert len(soon) == 2
    assert soon[1] <= 1.3 * soon[0]


@pytest.mark.slow
def test_noise_that_keeps_to_its_ends_is_no_fault() -> None:
    declared = DeclaredRobot(lag=0.05, gain_error=0.02, pose_noise=0.001, pose_noise_deg=0.5)
    stepper = Stepper(driven_problem(declared))
    rng = np.random.default_rng(3)
    mover, q = Cornered(RobotKind.of(declared, rng), np.eye(4), rng), np.zeros(len(JOINTS))
    for number in range(1200):
        if number % 100 == 0:
            q[:6] = 3 * rng.uniform(-1, 1, 6)
        step = stepper.step(q, mover.measured_pose())
        assert "robot:" not in step.reason, number
        list(mover.execute(step.twist, 0.01))


@pytest.mark.parametrize(("share", "count"), [(0.001, 8), (0.001, 9), (0.1, 9), (0.3, 11)])
def test_a_jerk_after_much_shorter_periods_is_named(share: float, count: int) -> None:
    """Many periods of a thousandth: one step later the jerk was 1.25 times as large, and nothing
    was said."""
    problem = driven_problem(DeclaredRobot())
    stepper, q = Stepper(problem), np.zeros(len(JOINTS))
    most = 2 * problem.twist_limit.acceleration / problem.average
    before, slope, lasted, over = np.zeros(6), np.zeros(6), problem.dt, []
    for number in range(120):
        q[0] = -3.0 if number // 15 % 2 else 3.0
        dt = problem.dt * (share if 40 <= number < 40 + count else 1.0)
        step = stepper.step(q, np.eye(4) if number == 0 else None, dt=dt)
        now = (step.twist - before) / dt
        jerk = np.abs(now - slope) / ((dt + lasted) / 2)
        if np.max(jerk / most) > 1 + 1e-6:
            over.append(step.reason)
        before, slope, lasted = step.twist, now, dt
    assert over
    assert all("much shorter" in reason for reason in over)
