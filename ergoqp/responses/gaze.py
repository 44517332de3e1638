"""People look at their work: how far the head is from where the eyes see the work with ease.

The eyes turn first, about a comfortable line of sight below the level of the head. The head does
the rest of the turn, and neck and trunk share it. The work also keeps a distance from the eyes: if
it is closer than the viewing distance, the head moves away.

Sources: the normal line of sight 15 degrees below the horizontal with 15 degrees of easy eye motion
about it (MIL-STD-1472, figure of the vertical and horizontal visual field; EN 894-2 has the same
zones); about 0.3 m as the viewing distance of demanding manual work (Grandjean, Fitting the Task to
the Man, 1988: 0.25 to 0.35 m).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import casadi as ca
import numpy as np

from ergoqp.human import Kinematics

AT_EASE: Final = float(np.radians(15.0))
"""Angle of the comfortable line of sight below the level of the head [rad]."""

EYES_TURN: Final = float(np.radians(15.0))
"""Angle that the eyes turn from there before the head follows [rad]."""

VIEWING_DISTANCE: Final = 0.30
"""Smallest comfortable viewing distance [m]."""

ROWS: Final = 3
"""Number of rows: two for the direction, one for the distance."""

_BEHIND: Final = 0.1
"""Keeps the direction finite if the work is behind the head."""

_SOFT: Final = 0.03
"""Width of the smooth transition at the viewing distance [m]."""


@dataclass(frozen=True)
class Gaze:
    """How far the head is from seeing the work with ease, in pelvis axes.

    Attributes:
        residual: what is missing (3,): to the left and up [rad], and nearness, which is 1 if the
            work is at the eyes.
        by_joints: its change with the joints while the work stays (3, n) [1/rad].
        by_work: its change with the place of the work while the head stays (3, 3) [1/m].
    """

    residual: ca.SX
    by_joints: ca.SX
    by_work: ca.SX


def gaze(kinematics: Kinematics, q: ca.SX, work: ca.SX, joints: Sequence[int]) -> Gaze:
    """Return how far the head is from seeing `work` (3,) [m] with ease at a posture (32,) [rad]."""
    eyes, head, jacobian = kinematics.at("eyes", q)
    way, turned = work - eyes, head @ _line_of_sight()
    seen = ca.SX.sym("seen", 3)
    missing = beyond_ease(seen)
    both = ca.Function("missing", [seen], [missing, ca.jacobian(missing, seen)])
    residual, slope = both(turned.T @ way)
    by_work = slope @ turned.T
    moved = -jacobian[:3, list(joints)] + ca.skew(way) @ jacobian[3:, list(joints)]
    return Gaze(residual, by_work @ moved, by_work)


def beyond_ease(seen: ca.SX) -> ca.SX:
    """Return what is missing (3,) for work seen at (3,) [m], x along the comfortable line of sight.

    The direction is about twice the tangent of half of its angle, so it grows up to 150 deg. Only
    the part beyond the turn of the eyes counts, with a smooth transition.
    """
    distance = ca.sqrt(ca.sumsqr(seen) + 1e-8)
    toward = seen / distance
    aside = (2 + _BEHIND) / (1 + _BEHIND + toward[0]) * toward[1:]
    beyond = 1 - EYES_TURN / ca.sqrt(ca.sumsqr(aside) + EYES_TURN**2)
    near = VIEWING_DISTANCE - distance
    return ca.vertcat(aside * beyond, (near + ca.sqrt(near**2 + _SOFT**2)) / 2 / VIEWING_DISTANCE)


def _line_of_sight() -> ca.DM:
    """Return the rotation (3, 3) from the axes of the head to those of the eyes at ease."""
    c, s = np.cos(AT_EASE), np.sin(AT_EASE)
    return ca.DM(np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]))
