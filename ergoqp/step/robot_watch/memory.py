"""State of the fault watch, and the measures that its parts share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import casadi as ca
import numpy as np

from ergoqp.problem.problem import Problem
from ergoqp.step.packing import Sizes

UNIT: Final = np.repeat([0.001, np.radians(0.2)], 3)
"""Difference of measured and declared motion that is no fault yet, per axis (6,) [m, rad]."""

COMPARED: Final = {
    "apart": (6, 1),  # measured motion minus sent motion, by the pose
    "least": (6, 1),  # bounds of their constant difference
    "most": (6, 1),
    "calm": (1, 1),  # for how long the object has stood still, as far as known
    "halted": (1, 1),  # 1 until it has come to rest
    "rests": (1, 1),  # how often it has come to rest, or was not enabled
    "begun": (1, 1),  # 1 while it stands still and the poses are compared from there
    "seen": (1, 1),  # how many poses were measured
    "latched": (
        1,
        1,
    ),  # 1 from a fault without a measured pose until one is measured, or `try_again`
    "doubted": (1, 1),  # 1 from such a fault until a pose is measured
    "presumed": (1, 1),  # 1 while the pose is that of a posture, moved on
}
REPORTED: Final = {
    "drift": (6, 1),  # measured motion minus sent motion, by the reported twist
    "path": (2, 1),  # distance and angle of its path since it stood still
    # variance of the drift: by the reverted changes of the samples, and by their second differences
    "blur": (6, 2),
    "surprise": (6, 2),  # the last difference to the sent twist, and its last change
    # what a declared robot still owed at the start of this, along each axis and against it
    "due": (6, 2),
    "rested": (1, 1),  # value of ``rests`` at that time
    # since a pose was measured: from the computed position to that by the reported twist, and the
    # turn between the two, in the axes of the computed one
    "aside": (3, 1),
    "turned_aside": (3, 3),
    "farthest": (7, 1),  # see `ASTRAY`
    "since": (1, 1),  # value of ``seen`` at that time, plus 1
}
NAMED: Final = {
    # since the fault began: sent motion, measured motion, change of the sent twist
    "moved": (6, 3),
    "last": (6, 1),  # the sent twist before the last one
    "fit": (5, 1),  # sums of the products of `moved`
    "named_for": (1, 1),  # for how long the fault has had a name [s]
    "worst": (6, 1),  # largest difference since then that is not declared [m, rad]
    # of the poses of faulty robots that stand still: the last change, how much of the changes is
    # taken back, and their squares (shift and turn each), and the largest change
    "shaken": (6, 1),
    "taken_back": (2, 1),
    "squares": (2, 1),
    "widest": (2, 1),
}
SAID: Final = {
    # above 1 if the integral shows a fault; above 0 [m/s, rad/s] if one sample shows it
    "signs": (2, 1),
    "fault": (2, 1),  # a `Fault` and its amount
}
STORY: Final = {**REPORTED, **NAMED}
ASTRAY: Final = 7
"""Size of how far the object may be from its computed pose: along x, y and z and against them [m],
and by what angle [rad].
"""


def watch_blocks(problem: Problem) -> dict[str, Sizes]:
    """Return the blocks of the state for the fault watch, with their parts; all zero at first."""
    # The fastest twist that the robot may have held, along each axis and against it, since the last
    # measured pose. For a late robot it is since the object stood still, because there a hold shows
    # little by little and does not stand out.
    held = {"held": (6, 2)} if problem.robot.longest_hold else {}
    # The turn of the object by what was sent since it stood still, and how it was turned then.
    # Turns do not commute, and differences of consecutive noisy poses would add up to a random
    # walk.
    turn = {"turned": (3, 3), "turned_from": (3, 3)} if problem.robot.pose_noise_deg else {}
    # By how much the turn of a late robot differs from that, as turns do not commute.
    area = {"area": (3, 1)} if turn and problem.robot.owes else {}
    # For the same reason, without ``turned``: the angle by which the object was turned by what was
    # sent since it was measured.
    blind = {"blind": (1, 1)} if problem.robot.owes and not turn else {}
    # The part of one hold that may be unseen in the comparison, in addition to noise.
    slip = {"slip": (6, 1)} if problem.robot.longest_hold and not problem.robot.owes else {}
    return {
        "compared": COMPARED | held | slip | turn | area | blind,
        "story": STORY,
        "said": SAID,
    }


def leap_beyond(now: Mapping[str, ca.SX], went: ca.SX) -> ca.SX:
    """Return by how much (6,) the pose moved beyond what the robot can have done in this period.

    It includes whatever the robot still owed.
    """
    lasted = now["lasted"] * now["started"]
    return ca.fmax(went - now["fastest"] * lasted, 0) + ca.fmin(went - now["slowest"] * lasted, 0)


def length(excess: ca.SX) -> ca.SX:
    """Return the larger length of the two halves of a vector (6,); only positive entries count."""
    beyond = ca.fmax(excess, 0)
    return ca.sqrt(ca.fmax(ca.sumsqr(beyond[:3]), ca.sumsqr(beyond[3:])))
