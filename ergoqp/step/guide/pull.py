"""The term of the objective that draws the object to a guide.

`ergoqp.step.guide.trial` decides when the object is drawn. Travelling changes only the objective.
Rows, certification and braking are those of every step.
"""

from __future__ import annotations

from typing import Final

import casadi as ca
import numpy as np

from ergoqp.expressions.linear import dense, is_set
from ergoqp.expressions.rigid import is_rigid, normalised
from ergoqp.step.guide.trial import BACK, LOOK, is_journey, place_of
from ergoqp.step.model import StepModel

GUIDE_INPUTS: Final = ("guide", "guided", "promise")
"""Pose of the guide (4, 4), whether there is one (0 or 1), and the cost it promises [points]."""

GUIDE_OUTPUTS: Final = ("drawn",)
"""Phase in which the guide led this step: travel, wait at the place or travel back; else 0."""

_APPROACH: Final = 0.3
"""Time constant of the end of the approach [s]."""

_GENTLE: Final = 0.5
"""Share of the acceleration that the approach uses."""


def pull_function(model: StepModel) -> ca.Function:
    """Return the function that gives the term of a guide in the objective.

    It is ``(landed, guide, guided, trial) -> (pull_H (6, 6), pull_g (6,), distance [s], on,
    drawn)``.

    While the object travels, the term is ``1/2 |xi - v|^2`` in the norm of effort, times
    `Control.guide_weight`. The velocity v leads to the place along a straight line: all axes arrive
    together, none exceeds its speed, and all slow down in time. Only the position and the tool's
    axis are led; a turn about this axis is free. H is positive semidefinite.

    `distance` is the time that the slowest axis needs to the present goal at full speed. `on` is 1
    if there is a usable guide. `drawn` is the phase if the object travels or waits at the place,
    else 0.
    """
    control, limit = model.problem.control, model.problem.twist_limit
    sx = model.symbols(("landed", "guide", "guided", "trial"))
    pose, guide, guided, trial = sx["landed"], sx["guide"], sx["guided"], sx["trial"]
    on = ca.logic_and(is_set(guided), is_rigid(guide))
    # An unusable guide is replaced here, because a product of NaN and zero is NaN.
    goal = ca.if_else(on, place_of(normalised(guide)), place_of(pose))
    goal = ca.if_else(trial[0] == BACK, trial[7:], goal)
    free = (limit.speed > 0).astype(float)
    speed, gentle = ca.DM(np.where(free > 0, limit.speed, 1.0)), ca.DM(_GENTLE * limit.acceleration)
    way = ca.DM(free) * _way(pose, goal)
    far = ca.fabs(way)
    distance = ca.mmax(far / speed)
    slowing = ca.sqrt(ca.mmax(far / (2 * gentle)))
    velocity = way / ca.fmax(_APPROACH, ca.fmax(distance, slowing))
    axis = pose[:3, 0]
    turning = control.effort_angular * (ca.SX.eye(3) - axis @ axis.T)
    weight = control.guide_weight * ca.diagcat(control.effort_linear * ca.SX.eye(3), turning)
    travels = ca.logic_and(on, is_journey(trial[0]))
    drawn = on * ca.logic_or(is_journey(trial[0]), trial[0] == LOOK) * trial[0]
    outputs = [travels * weight, -(travels * (weight @ velocity)), distance, on, drawn]
    names = ["pull_H", "pull_g", "distance", "on", "drawn"]
    return ca.Function("pull", list(sx.values()), ca.cse(dense(outputs)), list(sx), names)


def _way(pose: ca.SX, goal: ca.SX) -> ca.SX:
    """Return the straight displacement (6,) from a pose to a place, with the shortest turn."""
    axis, wanted = pose[:3, 0], goal[3:]
    normal = ca.cross(axis, wanted)
    sine = ca.sqrt(ca.sumsqr(normal) + 1e-18)
    return ca.vertcat(goal[:3] - pose[:3, 3], normal / sine * ca.atan2(sine, ca.dot(axis, wanted)))
