"""What one person minds when they take a posture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Wishes:
    """What one person minds.

    Attributes:
        comfort: posture with nothing to reach for (32,) [rad].
        efforts: what it costs to be away from it (32,), per rad^2.
        balance: what it costs to have the centre of mass off the middle of the soles, per m^2.
        hands: that hold the object.
        seated: whether the pelvis stays on a seat.
    """

    comfort: np.ndarray
    efforts: np.ndarray
    balance: float
    hands: tuple[str, ...]
    seated: bool
