"""A guide: a place as users give it, and the term of the objective that draws the object to it.

A guide as users give it: an optimum or a pose.

It is read and checked against the problem.

The term of the objective that draws the object to a guide. `ergoqp.step.rest` decides when the
object is drawn. Travelling changes only the objective. Rows, certification and braking are those of
every step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import casadi as ca
import numpy as np

from ergoqp.arguments import check_number, flag, read_array, shown
from ergoqp.errors import InputError
from ergoqp.expressions import is_rigid, is_set, normalised, read_pose
from ergoqp.joints import JOINTS
from ergoqp.limits import AxisCone, WorkspaceBox
from ergoqp.problem.problem import Problem
from ergoqp.step.model import StepModel
from ergoqp.step.rest import BACK, FIRM, LOOK, UNKNOWN, is_journey, place_of

_ROUNDING: Final = 1e-4
"""A place this far outside the workspace counts as on its edge [m, rad]."""


@dataclass(frozen=True)
class Guide:
    """A place for the object.

    Attributes:
        pose: pose of the contact frame in the world (4, 4) [m]. Only its position and its x axis,
            the tool's axis, are used.
        promise: cost that the model person has there [points]. None: unknown; the place is tried to
            find out.
        firm: whether the caller judges the place. The object then goes there from rest, continues
            by descent, and comes back only if the way costs the person too much.
    """

    pose: np.ndarray
    promise: float | None = None
    firm: bool = False

    @property
    def expected(self) -> float:
        """The promise as the step takes it, with `FIRM` or `UNKNOWN` for the special cases."""
        if self.firm:
            return FIRM
        return UNKNOWN if self.promise is None else self.promise


RECORDED: Final = Guide(np.eye(4))
"""Stands for the guide of a recorded loop, which is part of every entry of the log."""


def read_guide(problem: Problem, guide: Any) -> Guide:
    """Return the guide that a user gives.

    Args:
        problem: problem of the object.
        guide: a pose (4, 4), or anything with ``.pose`` such as the `Optimum` of `ergoqp.optimise`.
            If it has a ``.posture`` too, the cost of that posture is the promise of the place. An
            `Optimum` must be of this problem and of the mode ``"stackelberg"``: in the other mode
            the posture is chosen, and no person has to take it.

    Raises:
        InputError: if it is not a rigid pose, is outside the problem's workspace or cone, is of
            another problem or mode, or the problem does not move a pose.
    """
    if guide is RECORDED:
        return guide
    if tuple(problem.coordinates) != JOINTS:
        raise InputError(
            f"guide: problem {problem.name} moves {', '.join(problem.coordinates)}, allowed"
            " problems of a person"
        )
    _check_origin(problem, guide)
    pose = read_pose("guide", getattr(guide, "pose", guide))
    _check_place(problem, pose)
    if isinstance(guide, Guide):
        flag("guide.firm", guide.firm)
        if guide.promise is not None:
            check_number("guide.promise", guide.promise, -1e6, 1e6, "points")
        return guide
    posture = getattr(guide, "posture", None)
    if posture is None:
        return Guide(pose)
    angles = read_array(
        "guide.posture", posture, (len(JOINTS),), f"{len(JOINTS)} finite angles in radians"
    )
    return Guide(pose, float(problem.cost(angles)[0]))


def _check_origin(problem: Problem, guide: Any) -> None:
    found, mode = getattr(guide, "problem", problem.name), getattr(guide, "mode", "stackelberg")
    if found != problem.name:
        raise InputError(
            f"guide: got a place of problem {shown(found)}, allowed one of problem {problem.name}"
        )
    if mode != "stackelberg":
        raise InputError(
            f"guide: got a place of mode {mode}, in which the posture was chosen too, allowed a"
            " place of mode stackelberg"
        )


def _check_place(problem: Problem, pose: np.ndarray) -> None:
    box, cone, place = problem.limit_of(WorkspaceBox), problem.limit_of(AxisCone), pose[:3, 3]
    if box is not None:
        lower, upper = np.asarray(box.lower), np.asarray(box.upper)
        if not np.all((place >= lower - _ROUNDING) & (place <= upper + _ROUNDING)):
            raise InputError(
                f"guide: got the place {_short(place)} m, allowed the workspace {_short(lower)} to"
                f" {_short(upper)} m"
            )
    if cone is not None:
        angle = np.degrees(np.arccos(np.clip(pose[:3, 0] @ np.asarray(cone.direction), -1, 1)))
        if angle > cone.half_angle_deg + np.degrees(_ROUNDING):
            raise InputError(
                f"guide: got a tool axis {angle:.1f} deg from the middle of its cone, allowed at"
                f" most {cone.half_angle_deg:g} deg"
            )
    if broken := problem.own_limits.broken(pose):
        raise InputError(
            f"guide: got the place {_short(place)} m, which is {broken}, allowed where all limits"
            " hold"
        )


def _short(point: Any) -> str:
    return "(" + ", ".join(f"{number:.3g}" for number in point) + ")"


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
    sx = model.symbols(("landed", "guide", "guided", "trial"))
    control, stop = sx.of("control"), sx.of("stop")
    pose, guide, guided, trial = sx["landed"], sx["guide"], sx["guided"], sx["trial"]
    on = ca.logic_and(is_set(guided), is_rigid(guide))
    # An unusable guide is replaced here, because a product of NaN and zero is NaN.
    goal = ca.if_else(on, place_of(normalised(guide)), place_of(pose))
    goal = ca.if_else(trial[0] == BACK, trial[7:], goal)
    free = (model.problem.twist_limit.speed > 0).astype(float)
    # Along an axis that cannot move there is no way either.
    speed, gentle = stop.speed + ca.DM(1 - free), _GENTLE * stop.acceleration
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
    found = {"pull_H": travels * weight, "pull_g": -(travels * (weight @ velocity))}
    return sx.function("pull", found | {"distance": distance, "on": on, "drawn": drawn})


def _way(pose: ca.SX, goal: ca.SX) -> ca.SX:
    """Return the straight displacement (6,) from a pose to a place, with the shortest turn."""
    axis, wanted = pose[:3, 0], goal[3:]
    normal = ca.cross(axis, wanted)
    sine = ca.sqrt(ca.sumsqr(normal) + 1e-18)
    return ca.vertcat(goal[:3] - pose[:3, 3], normal / sine * ca.atan2(sine, ca.dot(axis, wanted)))
