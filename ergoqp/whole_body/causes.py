"""What holds the robot back, in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ergoqp.whole_body.moment import Moment

if TYPE_CHECKING:
    from ergoqp.whole_body.whole_body import WholeBody

_AT = 1e-7


def held_back(whole: WholeBody, moment: Moment, velocities: np.ndarray) -> str:
    """Return the names of the robot's limits and kept distances that are active.

    Args:
        whole: whose step it is.
        moment: of the step.
        velocities: the answer, of person and arm together (nv,) [rad/s].
    """
    robot, arm = whole.robot, velocities[whole.scene.arm]
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
        standing[whole.scene.person] = 0.0
        rates = np.maximum(-close.gradients @ velocities, -close.gradients @ standing)
        pairs = whole.scene.pairs[close.pairs[rates > moment.approach - _AT]]
        names += [f"the distance of {whole.scene.pair_name(pair)}" for pair in pairs]
    return ", ".join(names) or "the solver's accuracy"
