"""The costs by which a person chooses a posture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Wishes:
    """The costs by which one person chooses a posture.

    Attributes:
        comfort: posture with nothing to reach for (32,) [rad].
        efforts: cost of a deviation from it (32,), per rad^2.
        balance: cost of a distance of the centre of mass from the middle of the soles, per
            m^2.
        hands: hands that hold the object.
        seated: whether the pelvis stays on a seat.
    """

    comfort: np.ndarray
    efforts: np.ndarray
    balance: float
    hands: tuple[str, ...]
    seated: bool
