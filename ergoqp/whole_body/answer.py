"""What the whole body's step answers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ergoqp.step.answer.step import Step


@dataclass(frozen=True)
class WholeBodyStep:
    """The answer of one step.

    Attributes:
        joint_velocities: of the arm (k,) [rad/s]: send these.
        twist: what the object really does with them (6,) [m/s, rad/s].
        posture_rate: how the model person follows that (32,) [rad/s].
        status: that of the object's own step where the robot does the same; ``slower`` where limits
            of the robot or the distance hold it back; ``braking`` where the object brakes, or robot
            and object cannot keep all limits; ``invalid`` where an input cannot be used.
        reason: one sentence that names the cause, empty for a plain optimal step.
        min_distance: smallest of all kept distances where everything is now [m]; infinite where
            none is kept.
        object_step: the object's own step (`ergoqp.step.stepper.Step`), in which the robot has no
            limits.
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
