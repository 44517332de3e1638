"""When a person counts as fallen."""

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np

_LOWEST: Final = 0.3
"""Who stands has fallen when the pelvis is below this share of its height in standing upright:
deeper than anybody crouches on flat soles."""

_OFF_SEAT: Final = 0.10
"""Who sits has fallen when the pelvis is this far below its seat's height [m]."""

_TILTED: Final = float(np.cos(np.radians(80.0)))
"""Anybody has, when the pelvis is tilted further than this."""

_LOWEST_HEAD: Final = 0.25
"""And when the top of the head is as near to the floor as this [m]."""


def has_fallen(data: mujoco.MjData, seated: bool, height: float) -> bool:
    """Return whether a person lies.

    Args:
        data: kinematics.
        seated: whether they sat.
        height: of the pelvis on its seat, or in standing upright [m].
    """
    pelvis = data.body("pelvis")
    lowest = height - _OFF_SEAT if seated else _LOWEST * height
    return bool(
        pelvis.xpos[2] < lowest
        or pelvis.xmat[8] < _TILTED
        or data.site("head_top").xpos[2] < _LOWEST_HEAD
    )
