"""What a simulated robot measures is as old as is said."""

from __future__ import annotations

import numpy as np
import pytest

from ergoqp.simulation.robot import RobotKind, SimulatedRobot

PERIODS = (0.01, 0.013, 0.007, 0.01, 0.02, 0.01)


def driven(kind: RobotKind, until: float) -> SimulatedRobot:
    """A robot after so many seconds of twists that change every period."""
    robot, time = SimulatedRobot(kind, np.eye(4), np.random.default_rng(0)), 0.0
    for number, period in enumerate(PERIODS):
        twist = 0.1 * np.cos(number + np.arange(6.0))
        lasted = min(period, until - time)
        if lasted > 1e-12:
            for _ in robot.execute(twist, lasted):
                pass
        time += period
    return robot


@pytest.mark.parametrize("lag", [0.0, 0.05])
@pytest.mark.parametrize("delay", [0.0, 0.008])
@pytest.mark.parametrize("old", [0.0, 0.003, 0.015, 0.03])
def test_a_measured_pose_is_as_old_as_is_said(lag: float, delay: float, old: float) -> None:
    until = sum(PERIODS)
    robot = driven(RobotKind(lag=lag, delay=delay, pose_delay=old), until)
    past = driven(RobotKind(lag=lag, delay=delay), until - old)
    np.testing.assert_allclose(robot.measured_pose(), past.pose, atol=2e-6)
    np.testing.assert_allclose(robot.reported_twist(), past.velocity, atol=1e-3)


def test_before_it_began_it_stood_where_it_began() -> None:
    robot = driven(RobotKind(pose_delay=0.5), 0.01)
    np.testing.assert_array_equal(robot.measured_pose(), np.eye(4))
    assert not robot.reported_twist().any()


def test_a_pose_that_is_set_is_measured_later() -> None:
    robot, there = driven(RobotKind(pose_delay=0.005), 0.01), np.eye(4)
    there[0, 3] = 0.2
    robot.see(there)
    np.testing.assert_allclose(robot.measured_pose()[0, 3], 0.1)
    for _ in robot.execute(np.zeros(6), 0.005):
        pass
    np.testing.assert_allclose(robot.measured_pose(), there)
