"""The answer of the whole-body step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ergoqp.step.answer import Step


@dataclass(frozen=True)
class WholeBodyStep:
    """The answer of one step.

    Attributes:
        joint_velocities: velocities of the arm's joints to send (k,) [rad/s].
        twist: twist of the object with these velocities (6,) [m/s, rad/s].
        posture_rate: how the model person follows this twist (32,) [rad/s].
        status: that of the object's own step if the robot does the same. ``slower``: limits of the
            robot or the distance hold the object back. ``braking``: the object brakes, or robot and
            object cannot keep all limits. ``invalid``: an input cannot be used.
        reason: one sentence that names the cause, empty for a plain optimal step.
        min_distance: smallest present distance of all kept pairs [m]; infinite if no distance is
            kept.
        object_step: the object's own step (`ergoqp.step.stepper.Step`), without limits of the
            robot.
        solve_time: duration of the call [s].

    Example:
        >>> import ergoqp
        >>> from ergoqp.whole_body import WholeBody
        >>> problem = ergoqp.load_problem("screwing")
        >>> whole = WholeBody(problem)
        >>> step = whole.step(None, whole.start)
        >>> step.status, step.twist.shape
        ('braking', (6,))
    """

    joint_velocities: np.ndarray
    twist: np.ndarray
    posture_rate: np.ndarray
    status: str
    reason: str
    min_distance: float
    object_step: Step
    solve_time: float
