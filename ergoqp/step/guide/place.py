"""A guide as users give it: an optimum or a pose.

It is read and checked against the problem.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from ergoqp.arguments import check_number, flag, read_array, shown
from ergoqp.errors import InputError
from ergoqp.expressions.rigid import read_pose
from ergoqp.joints import JOINTS
from ergoqp.limits import AxisCone, WorkspaceBox
from ergoqp.problem.problem import Problem
from ergoqp.step.guide.trial import FIRM, UNKNOWN

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
            allowed = f"at most {cone.half_angle_deg:g} deg"
            raise InputError(
                f"guide: got a tool axis {angle:.1f} deg from the middle of its cone, allowed"
                f" {allowed}"
            )
    if broken := problem.own_limits.broken(pose):
        raise InputError(
            f"guide: got the place {_short(place)} m, which is {broken}, allowed where all limits"
            " hold"
        )


def _short(point: Any) -> str:
    return "(" + ", ".join(f"{number:.3g}" for number in point) + ")"
