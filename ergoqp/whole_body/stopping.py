"""The largest speed from which a joint still stops in time, exact for discrete periods."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

_ROUNDING = 1e-12


def stopping_speed(distance: ArrayLike, acceleration: ArrayLike, dt: float) -> np.ndarray:
    """Return the largest speed of this period from which a stop stays within a distance.

    The speed is held for one period and then falls by a dt per period. After k + 1 periods the
    joint has moved v dt + (v - a dt) dt + ... So v = d / ((k + 1) dt) + a dt k / 2 with k =
    floor((sqrt(1 + 8 d / (a dt^2)) - 1) / 2). (The continuous sqrt(2 a d) would overshoot by up to
    the motion of one period.)

    Args:
        distance: remaining distance; negative counts as zero [rad].
        acceleration: deceleration that may be used [rad/s^2].
        dt: period [s].
    """
    d, a = np.maximum(np.asarray(distance, dtype=float), 0.0), np.asarray(acceleration, dtype=float)
    k = np.floor((np.sqrt(1 + 8 * d / (a * dt**2)) - 1) / 2 + _ROUNDING)
    return d / ((k + 1) * dt) + a * dt * k / 2


def joint_bounds(
    position: np.ndarray,
    speed: np.ndarray,
    limits: tuple[np.ndarray, np.ndarray],
    velocity: np.ndarray,
    acceleration: np.ndarray,
    dt: float,
    pace: float = 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the lower and the upper bound of the speed of every joint in this period (k,) each.

    The bounds follow from position through the stop, rate and acceleration. They always include the
    joint's own braking. So bounds of joints that kept them before are never empty.

    Args:
        position: positions of the joints (k,) [rad].
        speed: speeds of the last period (k,) [rad/s].
        limits: least and greatest positions (k,) each [rad].
        velocity: largest speeds (k,) [rad/s].
        acceleration: largest accelerations (k,) [rad/s^2].
        dt: period [s].
        pace: time constant of the approach to the ends of the ranges [s], if it is longer than the
            stop. Joints can stop sooner than the object that they carry may.
    """
    brake = np.sign(speed) * np.maximum(np.abs(speed) - acceleration * dt, 0.0)
    up, down = (
        np.minimum(
            np.minimum(velocity, stopping_speed(left, acceleration, dt)),
            np.maximum(left, 0.0) / max(pace, dt),
        )
        for left in (limits[1] - position, position - limits[0])
    )
    low = np.minimum(np.maximum(-down, speed - acceleration * dt), brake)
    high = np.maximum(np.minimum(up, speed + acceleration * dt), brake)
    return low, high
