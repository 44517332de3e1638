"""The history of a step: the planned twists, the sent twists, and their ages."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import casadi as ca
import numpy as np

from ergoqp.problem.problem import Problem
from ergoqp.step.packing import Sizes

FAR: Final = 1e3
"""Age of everything before the first step: older than any age that matters [s]."""

SHORTEST_DT: Final = 1e-5
"""Shortest control period [s]."""

LONGEST_DT: Final = 1.0
"""Longest control period [s]."""

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


@dataclass(frozen=True)
class History:
    """How much of the past the step keeps.

    Attributes:
        planned: number of planned twists, newest first.
        sent: number of sent twists, newest first.
        lags: whether the declared robot may still have to do a part of older sent twists.
        clings: whether the robot may have held one of those older twists for too long.
        owes: whether a part of what was sent is still to come.
    """

    planned: int
    sent: int
    lags: bool = False
    clings: bool = False
    owes: bool = False

    @classmethod
    def of(cls, problem: Problem) -> History:
        """Return the history that the mean and the declared robot of a problem need."""

        def periods(seconds: float) -> int:
            return int(np.ceil(_SPARE * seconds / problem.dt)) + 1 if seconds else 0

        robot = problem.robot
        planned, sent = 1 + periods(problem.average), 1 + periods(robot.dead_time)
        lags = bool(robot.lag)
        return cls(planned, sent, lags, lags and bool(robot.longest_hold), robot.owes)

    @property
    def ages(self) -> int:
        """Number of ends of periods, without the present one."""
        return max(self.planned - 1, self.sent)

    @property
    def sizes(self) -> Sizes:
        """Shape of every part of the history in the state, see `initial_history`."""
        sizes = {"planned": (6, self.planned), "sent": (6, self.sent), "ages": (self.ages, 1)}
        sizes |= {"idle": (1, 1)}
        if self.lags:
            sizes |= {"tail": (6, 2), "swift": (6, 2)}
        if self.clings:
            sizes["clung"] = (6, 2)
        return sizes | ({"owed": (6, 1)} if self.owes else {})


def initial_history(history: History, twist: np.ndarray) -> dict[str, np.ndarray]:
    """Return the history of an object that has always moved at `twist` (6,)."""
    parts = {name: np.zeros(size) for name, size in history.sizes.items()}
    parts["planned"][:], parts["sent"][:], parts["ages"][:] = twist[:, None], twist[:, None], FAR
    parts["idle"][:] = 0.0 if np.any(twist) else FAR
    return parts


def remaining_seconds(younger: Any, older: Any, dead: float, lag: float) -> Any:
    """Return the seconds for which twists that were sent between two ages still act."""
    seconds = ca.fmin(older, dead) - ca.fmin(younger, dead)
    if lag:
        seconds += lag * (
            ca.exp(-ca.fmax(younger - dead, 0) / lag) - ca.exp(-ca.fmax(older - dead, 0) / lag)
        )
    return seconds
