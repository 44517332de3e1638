"""The criterion for a fall of a person."""

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np

_LOWEST: Final = 0.3
"""A standing person has fallen if the pelvis is below this share of its upright height.

It is deeper than anybody crouches on flat soles.
"""

_OFF_SEAT: Final = 0.10
"""A seated person has fallen if the pelvis is this far below the height of its seat [m]."""

_TILTED: Final = float(np.cos(np.radians(80.0)))
"""Anybody has fallen if the cosine of the tilt of the pelvis is below this."""

_LOWEST_HEAD: Final = 0.25
"""Anybody has fallen if the top of the head is below this height [m]."""


def has_fallen(data: mujoco.MjData, seated: bool, height: float) -> bool:
    """Return whether a person has fallen.

    Args:
        data: kinematics.
        seated: whether they sat.
        height: height of the pelvis on its seat, or in standing upright [m].
    """
    pelvis = data.body("pelvis")
    lowest = height - _OFF_SEAT if seated else _LOWEST * height
    return bool(
        pelvis.xpos[2] < lowest
        or pelvis.xmat[8] < _TILTED
        or data.site("head_top").xpos[2] < _LOWEST_HEAD
    )
