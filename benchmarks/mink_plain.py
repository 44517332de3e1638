"""mink as people write it: a task for the hand, one for the posture, its own limits.

This is less than the control step asks.

The arm of `benchmarks.mink_peer` is led along with the object by a `FrameTask`, beside a
`PostureTask` toward its rest, within mink's configuration and velocity limits. Nothing of the
person is in it: no cost, no response, no boundary. It says what mink's own bookkeeping takes for a
QP of seven joints.
"""

from __future__ import annotations

import time

import mink
import numpy as np

from benchmarks.mink_peer import ArmColumns
from ergoqp.whole_body.formulation import SOLVER


def mink_plain_us(dt: float, count: int) -> np.ndarray:
    """Return what `count` steps take, after as many that are not counted [us].

    Args:
        dt: period [s].
        count: steps of a slow circle of the hand.
    """
    scene = ArmColumns()
    configuration = mink.Configuration(scene.model)
    configuration.update(scene.robot.rest)
    hand = mink.FrameTask("contact", "site", position_cost=1.0, orientation_cost=1.0)
    posture = mink.PostureTask(scene.model, cost=1e-2)
    posture.set_target(scene.robot.rest)
    names = [scene.model.joint(i).name for i in range(scene.model.njnt)]
    limits = [
        mink.ConfigurationLimit(scene.model),
        mink.VelocityLimit(scene.model, dict.fromkeys(names, 2.0)),
    ]
    begin, took = configuration.get_transform_frame_to_world("contact", "site"), np.zeros(2 * count)
    for i in range(2 * count):
        way = 0.05 * np.array([0.0, np.sin(0.01 * i), np.cos(0.01 * i) - 1])
        start = time.perf_counter()
        hand.set_target(
            mink.SE3.from_rotation_and_translation(begin.rotation(), begin.translation() + way)
        )
        velocity = mink.solve_ik(
            configuration, [hand, posture], dt, SOLVER, damping=1e-6, limits=limits
        )
        configuration.integrate_inplace(velocity, dt)
        took[i] = time.perf_counter() - start
    return 1e6 * took[count:]
