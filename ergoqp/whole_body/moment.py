"""The data of one step for person, robot and object, shared by its tasks and limits."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ergoqp.whole_body.separation import Closeness


@dataclass
class Moment:
    """The data of one step, set by the step and read by tasks and limits.

    Attributes:
        dt: period [s].
        jacobian: Jacobian of the contact frame with respect to the arm's joints, world-aligned,
            linear first (6, k).
        terms: result of `ergoqp.whole_body.terms.terms_function`.
        H: curvature of the object's own objective (6, 6).
        g: slope of the object's own objective (6,).
        low: lower bound of the twist (6,) [m/s, rad/s].
        high: upper bound of the twist (6,) [m/s, rad/s].
        arm_speed: speeds of the arm's joints in the last period (k,) [rad/s].
        arm_low: lower bounds of the speeds of the arm's joints (k,) [rad/s].
        arm_high: upper bounds of the speeds of the arm's joints (k,) [rad/s].
        arm_wish: desired speeds in the null space (k,) [rad/s].
        offset: correction in addition to the twist xi, J dq = xi + offset. It brings the object
            back to the straight path of its twists, because arms move in arcs (6,) [m/s, rad/s].
        close: the near pairs. None: no distance is kept.
        approach: largest speed at which each of them may approach (m,) [m/s].
    """

    dt: float
    jacobian: np.ndarray
    terms: dict[str, np.ndarray]
    H: np.ndarray
    g: np.ndarray
    low: np.ndarray
    high: np.ndarray
    arm_speed: np.ndarray
    arm_low: np.ndarray
    arm_high: np.ndarray
    arm_wish: np.ndarray
    offset: np.ndarray = field(default_factory=lambda: np.zeros(6))
    close: Closeness | None = None
    approach: np.ndarray = field(default_factory=lambda: np.zeros(0))
