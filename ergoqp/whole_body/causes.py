"""The limits that hold the robot back, in words."""

from __future__ import annotations

import numpy as np

from ergoqp.whole_body.moment import Moment
from ergoqp.whole_body.robot import Robot
from ergoqp.whole_body.scene import Scene

_AT = 1e-7


def held_back(robot: Robot, scene: Scene, moment: Moment, velocities: np.ndarray) -> str:
    """Return the names of the active limits of the robot and of the active distances.

    Args:
        robot: robot with the limits.
        scene: scene of person, robot and object.
        moment: data of the step.
        velocities: the answer, of person and arm together (nv,) [rad/s].
    """
    arm = velocities[scene.arm]
    active = (arm > moment.arm_high - _AT) | (arm < moment.arm_low + _AT)
    at_rate = np.abs(arm) > robot.velocity - _AT
    at_change = np.abs(arm - moment.arm_speed) > robot.acceleration * moment.dt - _AT
    names = []
    for joint in np.flatnonzero(active):
        limit = "rate" if at_rate[joint] else "acceleration" if at_change[joint] else "range"
        names.append(f"the {limit} of {robot.joints[joint]}")
    close = moment.close
    if close is not None and len(close.pairs):
        standing = velocities.copy()
        standing[scene.person] = 0.0
        rates = np.maximum(-close.gradients @ velocities, -close.gradients @ standing)
        pairs = scene.pairs[close.pairs[rates > moment.approach - _AT]]
        names += [f"the distance of {scene.pair_name(pair)}" for pair in pairs]
    return ", ".join(names) or "the solver's accuracy"
