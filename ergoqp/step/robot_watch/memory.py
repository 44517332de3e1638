"""What the watch over a robot keeps from step to step, and what its parts measure with."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import casadi as ca
import numpy as np

from ergoqp.problem.problem import Problem
from ergoqp.step.packing import Sizes

UNIT: Final = np.repeat([0.001, np.radians(0.2)], 3)
"""Difference of measured and declared motion that is none yet, per axis (6,) [m, rad]."""

COMPARED: Final = {
    "apart": (6, 1),  # measured motion less sent motion, by the pose
    "least": (6, 1),  # ends of their constant difference
    "most": (6, 1),
    "calm": (1, 1),  # for how long the object has stood still, as far as is seen
    "halted": (1, 1),  # 1 until it has come to rest
    "rests": (1, 1),  # how often it has come to rest, or was not enabled
    "begun": (1, 1),  # 1 while it stands still, once the poses are compared from there
}
REPORTED: Final = {
    "drift": (6, 1),  # measured motion less sent motion, by the reported twist
    "path": (2, 1),  # how far it went, and turned, since it stood still
    # variance of the drift: by how changes of the samples come back, and by their second
    # differences
    "blur": (6, 2),
    "surprise": (6, 2),  # the last sample, and the last change of one
    # what a declared robot still owed when this was begun, along each axis and against it
    "due": (6, 2),
    "rested": (1, 1),  # what ``rests`` was then
}
NAMED: Final = {
    # since there is a fault: sent motion, measured motion, change of the sent twist
    "moved": (6, 3),
    "last": (6, 1),  # the sent twist before the last one
    "fit": (5, 1),  # sums of the products of `moved`
}
SAID: Final = {
    # above 1 where the integral says that there is a fault; above 0 [m/s, rad/s] where one sample
    # does
    "signs": (2, 1),
    "fault": (2, 1),  # a `Fault` and its amount
}
STORY: Final = {**REPORTED, **NAMED}
ACCOUNT: Final = {
    "short": (6, 2),  # way that was sent and not reported yet, along each axis and against it
    "ahead": (6, 1),  # how much further the object is reckoned to be than was reported
}


def watch_blocks(problem: Problem) -> dict[str, Sizes]:
    """Return the state's blocks that watch the robot, and their parts; all zero at the start."""
    # The fastest that may have been held on to, along each axis and against it: since the last
    # measured pose; of a late robot, in which a hold shows little by little and so does not stand
    # out, since it stood still.
    held = {"held": (6, 2)} if problem.robot.longest_hold else {}
    # Turns do not commute: differences of neighbouring noisy poses would add up to a random walk.
    # How the object was turned by what was sent since it stood still.
    turn = {"turned": (3, 3)} if problem.robot.pose_noise_deg else {}
    # For the same reason: by which angle the object was turned by what was sent since it was
    # measured, if not by that.
    blind = {"blind": (1, 1)} if problem.robot.owes and not turn else {}
    # What one hold may have left in the comparison unseen, beside noise.
    slip = {"slip": (6, 1)} if problem.robot.longest_hold and not problem.robot.owes else {}
    return {
        "compared": COMPARED | held | slip | turn | blind,
        "story": STORY,
        "said": SAID,
        "account": ACCOUNT,
    }


def leap_beyond(now: Mapping[str, ca.SX], went: ca.SX) -> ca.SX:
    """Return by how much (6,) the pose moved beyond what the robot can have done in this period.

    That holds whatever the robot still owed.
    """
    lasted = now["lasted"] * now["started"]
    return ca.fmax(went - now["fastest"] * lasted, 0) + ca.fmin(went - now["slowest"] * lasted, 0)


def length(excess: ca.SX) -> ca.SX:
    """Return the larger length of a vector's (6,) two halves; only what is positive counts."""
    beyond = ca.fmax(excess, 0)
    return ca.sqrt(ca.fmax(ca.sumsqr(beyond[:3]), ca.sumsqr(beyond[3:])))
