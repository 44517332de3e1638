"""Sizes and layouts of what a step keeps: its history, the motion under way, the fault watch."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import casadi as ca
import numpy as np

from ergoqp.expressions import present, slices
from ergoqp.problem.problem import Problem
from ergoqp.step.rows import limit_values

Sizes = Mapping[str, tuple[int, int]]
"""Shape of each part, in order."""


def count(sizes: Sizes) -> int:
    """Return the number of entries of all parts."""
    return sum(rows * columns for rows, columns in sizes.values())


def split(sizes: Sizes, vector: Any) -> dict[str, Any]:
    """Return the parts of a vector by name, each in its shape."""
    parts = {name: vector[at] for name, at in places(sizes).items()}
    wide = {name: size for name, size in sizes.items() if size[1] != 1}
    return parts | {name: ca.reshape(parts[name], *size) for name, size in wide.items()}


def places(sizes: Sizes) -> dict[str, slice]:
    """Return the slice of the vector that holds each part."""
    return slices({name: rows * columns for name, (rows, columns) in sizes.items()})


def joined(sizes: Sizes, parts: Mapping[str, Any]) -> Any:
    """Return the vector of the parts."""
    return ca.vertcat(*(ca.vec(ca.densify(parts[name])) for name in sizes))


FAR: Final = 1e3
"""Age of everything before the first step: older than any age that matters [s]."""

SHORTEST_DT: Final = 1e-5
"""Shortest control period [s]."""

LONGEST_DT: Final = 1.0
"""Longest control period [s]."""

AT_ALL: Final = 1e-9
"""Durations below this count as zero [s]."""

CLOCK_ROUNDING: Final = 1e-3
"""By how much the stamp of a frame may be ahead of the clock of the loop [s]; its age is then 0.

Stamps that are kept in whole milliseconds are rounded by up to this much, and the difference of two
times since 1970 as floats by 0.5 us. An age is only compared with `Control.max_age`, so one that is
too small by this much changes no limit.
"""

_SPARE: Final = 1.5
"""The history holds this many times its seconds at the period of the problem.

So periods may be shorter by this factor on average.
"""


_FEWEST: Final = 12
"""A history has one entry, or so many, or twice as many, and so on.

So problems of other periods and delays have the same functions. 12 are enough for the usual average
at 100 Hz.
"""


class History:
    """How much of the past the step keeps.

    Of both kinds of twists it keeps a number of entries that is rounded up, newest first. Only the
    first ones count; how many is a number of the problem.

    Attributes:
        planned: number of planned twists.
        sent: number of sent twists.
        counted: number of ``planned`` and ``sent`` twists that count.
    """

    def __init__(self, problem: Problem) -> None:
        """Take what the mean and the declared robot of a problem need."""

        def periods(seconds: float) -> int:
            return int(np.ceil(_SPARE * seconds / problem.dt)) + 1 if seconds else 0

        self._robot = problem.robot
        seconds = {"planned": problem.average, "sent": problem.robot.dead_time}
        self.counted = {name: 1 + periods(each) for name, each in seconds.items()}
        self.planned, self.sent = map(_rounded, self.counted.values())

    def constants(self) -> dict[str, np.ndarray]:
        """Return which of the entries count, by name; no entry where there is only one.

        ``planned`` and ``sent`` are 1 for those that count. ``oldest`` is 1 for the last of the
        sent ones that does. The rows of ``ends`` choose, of the ages of the ends of periods (3, n):
        those that must not be younger than the mean, now and in a period, and than the dead time.
        """
        planned, sent = self.counted.values()
        found = {
            "planned": (np.arange(self.planned) < planned).astype(float),
            "sent": (np.arange(self.sent) < sent).astype(float),
            "oldest": (np.arange(self.sent) == sent - 1).astype(float),
        }
        ends = np.zeros((3, self.ages))
        if self.planned > 1:
            ends[0, planned - 2] = ends[1, planned - 3] = 1.0
        if self.sent > 1:
            ends[2, sent - 2] = 1.0
        return found | {"ends": ends}

    @property
    def ages(self) -> int:
        """Number of ends of periods, without the present one."""
        return max(self.planned - 1, self.sent)

    @property
    def sizes(self) -> Sizes:
        """Shape of every part of the history in the state, see `initial_history`."""
        sizes = {"planned": (6, self.planned), "sent": (6, self.sent), "ages": (self.ages, 1)}
        sizes |= {"idle": (1, 1)}
        robot = self._robot
        if robot.lag:
            # What the robot still has to do of older twists, and may have held for too long.
            sizes |= {"tail": (6, 2), "swift": (6, 2)}
            sizes |= {"clung": (6, 2)} if robot.longest_hold else {}
        return sizes | ({"owed": (6, 1)} if robot.owes else {})


def _rounded(counted: int) -> int:
    """Return the number of entries of a history of which so many count."""
    entries = 1 if counted == 1 else _FEWEST
    while entries < counted:
        entries *= 2
    return entries


def initial_history(history: History, twist: np.ndarray) -> dict[str, np.ndarray]:
    """Return the history of an object that has always moved at `twist` (6,)."""
    parts = {name: np.zeros(size) for name, size in history.sizes.items()}
    parts["planned"][:], parts["sent"][:], parts["ages"][:] = twist[:, None], twist[:, None], FAR
    parts["idle"][:] = 0.0 if np.any(twist) else FAR
    return parts


def remaining_seconds(younger: Any, older: Any, dead: Any, lag: Any) -> Any:
    """Return the seconds for which twists that were sent between two ages still act."""
    seconds = ca.fmin(older, dead) - ca.fmin(younger, dead)
    if present(lag):
        seconds += lag * (
            ca.exp(-ca.fmax(younger - dead, 0) / lag) - ca.exp(-ca.fmax(older - dead, 0) / lag)
        )
    return seconds


class PendingMotionLayout:
    """The parts of the vector ``way``.

    Attributes:
        limits: limits of the object side.
        count: number of their rows that lose a part of their distance: all or none.
        turns: whether the angle of the object may differ from that of the landing pose.
        strays: whether the motion under way can turn about more than one axis, and a row bends.
        holds: whether the robot may hold once what is under way.
    """

    def __init__(self, problem: Problem) -> None:
        """Take the parts of a problem."""
        robot = problem.robot
        self.limits = tuple(limit for limit in problem.row_limits if limit.hard)
        # Where a pose is moved, it may be unknown in part.
        self.count = len(self.names) if problem.moves_pose else 0
        self.turns = robot.owes or bool(robot.pose_noise_deg)
        bends = bool(limit_values(self.limits, "curvature").any())
        self.strays, self.holds = problem.average > 0 and bends, robot.longest_hold > 0

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the rows of the object side."""
        return tuple(name for limit in self.limits for name in limit.names)

    @property
    def _sizes(self) -> dict[str, int]:
        """Sizes of the parts."""
        sizes = {"displacement": 6}
        if self.count:
            sizes |= {"below": self.count, "above": self.count}
            sizes |= {"turn": 1} if self.turns else {}
            sizes |= {"direction_error": 1, "overshoot_angle": 1} if self.strays else {}
            if self.holds:
                sizes |= {"below_held": self.count, "above_held": self.count, "turn_held": 1}
        return sizes

    @property
    def size(self) -> int:
        """Number of all entries."""
        return sum(self._sizes.values())

    def split(self, way: Any, held: bool = False, ahead: bool = False) -> dict[str, Any]:
        """Return the parts of a vector (size,) that an `ergoqp.limits.LimitContext` has.

        Args:
            way: the vector.
            held: whether the robot holds once what is under way (where declared).
            ahead: whether the motion after it counts too.
        """
        part = {name: way[at] for name, at in slices(self._sizes).items()}
        found = {"pending_displacement": part["displacement"]}
        if not self.count:
            return found
        end = "_held" if held and self.holds else ""
        below, above = part[f"below{end}"], part[f"above{end}"]
        rows = slices({limit.names[0]: len(limit.names) for limit in self.limits})
        found["margin_reduction"] = {name: (below[at], above[at]) for name, at in rows.items()}
        # The angle that the robot may have done already, plus the error of its measured angle.
        found["turn"] = part.get("turn_held" if self.holds and (held or ahead) else "turn")
        names = ("direction_error", "overshoot_angle") if self.strays else ()
        return found | {name: part[name] for name in names}


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
    # 1 from a fault without a measured pose until one is measured, or `try_again`
    "latched": (1, 1),
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


FRAMES: Final[Sizes] = {
    "wait": (1, 1),  # time until the next comparison [s]
    "beyond": (1, 1),  # comparisons beyond honest people, less those within them since
    "doubted": (1, 1),  # the same of those that nothing explains
    "agreed": (1, 1),  # comparisons within honest people in a row; stays at `AGREED`
    "distance": (1, 1),  # of the last comparison [m]
    "angle": (1, 1),  # the same of the tool's axis [rad]
}
"""What the comparison of posture and pose keeps; all zero at first."""


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
    return {"compared": COMPARED | held | slip | turn | area | blind, "story": STORY, "said": SAID}


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
