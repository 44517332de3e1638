"""What one step knows of person, robot and object: the numbers that its tasks and limits share."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ergoqp.whole_body.separation import Closeness


@dataclass
class Moment:
    """The numbers of one step; written by whoever steps, read by tasks and limits.

    Attributes:
        dt: period [s].
        jacobian: of the contact frame after the arm's joints, world-aligned, linear first (6, k).
        terms: what `ergoqp.whole_body.terms.terms_function` gave.
        H: curvature of the object's own objective (6, 6).
        g: slope of the object's own objective (6,).
        low: least twist (6,) [m/s, rad/s].
        high: greatest twist (6,) [m/s, rad/s].
        arm_speed: speeds of the arm's joints in the last period (k,) [rad/s].
        arm_low: least speeds of the arm's joints (k,) [rad/s].
        arm_high: greatest speeds of the arm's joints (k,) [rad/s].
        arm_wish: speeds that the null space is led to (k,) [rad/s].
        offset: what the arm does beside the twist xi, J dq = xi + offset, to bring the object back
            to the way that its twists describe: arms move in arcs (6,) [m/s, rad/s].
        close: the pairs that are near each other; None: nothing keeps a distance.
        approach: largest speed with which each of them may approach (m,) [m/s].
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
