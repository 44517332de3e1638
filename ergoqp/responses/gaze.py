"""People look at what they work on: how far the head is from where the eyes reach with ease.

The eyes turn first, about a line of sight that is at ease below the head's level; what they would
have to turn beyond that, the head does, and with it neck and trunk. Nobody works with the eyes on
the work either: where it is nearer than a viewing distance, the head keeps away.

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
"""The eyes rest this far below the head's level [rad]."""

EYES_TURN: Final = float(np.radians(15.0))
"""And turn about this far before the head goes along [rad]."""

VIEWING_DISTANCE: Final = 0.30
"""Nearer than this nobody works for long [m]."""

ROWS: Final = 3
"""Two for the direction, one for the distance."""

_BEHIND: Final = 0.1
"""Keeps the direction finite where the work is behind the head."""

_SOFT: Final = 0.03
"""How smoothly the viewing distance begins [m]."""


@dataclass(frozen=True)
class Gaze:
    """How far the head is from seeing the work with ease; in pelvis axes.

    Attributes:
        residual: what is missing (3,): to the left and up [rad], and nearness, 1 where the work is
            at the eyes.
        by_joints: how it changes with joints while the work stays (3, n) [1/rad].
        by_work: how it changes with the work's place while the head stays (3, 3) [1/m].
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
    """Return what is missing (3,) where the work is seen at (3,) [m], x along the eyes at ease.

    The direction is about twice the tangent of half its angle, so that it grows up to 150 deg;
    of it counts what is beyond the turn of the eyes, smoothly.
    """
    distance = ca.sqrt(ca.sumsqr(seen) + 1e-8)
    toward = seen / distance
    aside = (2 + _BEHIND) / (1 + _BEHIND + toward[0]) * toward[1:]
    beyond = 1 - EYES_TURN / ca.sqrt(ca.sumsqr(aside) + EYES_TURN**2)
    near = VIEWING_DISTANCE - distance
    return ca.vertcat(aside * beyond, (near + ca.sqrt(near**2 + _SOFT**2)) / 2 / VIEWING_DISTANCE)


def _line_of_sight() -> ca.DM:
    """Turn (3, 3) from the head's axes to those of the eyes at ease."""
    c, s = np.cos(AT_EASE), np.sin(AT_EASE)
    return ca.DM(np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]))
