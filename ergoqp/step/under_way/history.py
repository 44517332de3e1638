"""What the step keeps of the past: what it planned, what it sent, and when."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import casadi as ca
import numpy as np

from ergoqp.problem.problem import Problem
from ergoqp.step.packing import Sizes

FAR: Final = 1e3
"""Age of what was before the first step: older than anything counts [s]."""

SHORTEST_DT: Final = 1e-5
"""What is shorter is no control period either [s]."""

LONGEST_DT: Final = 1.0
"""What is longer is no control period [s]."""

_SPARE: Final = 1.5
"""The history holds this many times its seconds at the problem's period.

So periods may be that much shorter on average.
"""


@dataclass(frozen=True)
class History:
    """How much of the past the step keeps.

    Attributes:
        planned: how many planned twists, newest first.
        sent: how many sent ones.
        lags: whether the declared robot has still to do some of what is older than these.
        clings: whether it may have held on to it.
        owes: whether anything of what was sent is left for later.
    """

    planned: int
    sent: int
    lags: bool = False
    clings: bool = False
    owes: bool = False

    @classmethod
    def of(cls, problem: Problem) -> History:
        """Return what the mean and the declared robot of a problem need."""

        def periods(seconds: float) -> int:
            return int(np.ceil(_SPARE * seconds / problem.dt)) + 1 if seconds else 0

        robot = problem.robot
        planned, sent = 1 + periods(problem.average), 1 + periods(robot.dead_time)
        lags = bool(robot.lag)
        return cls(planned, sent, lags, lags and bool(robot.longest_hold), robot.owes)

    @property
    def ages(self) -> int:
        """How many ends of periods, the present one not counted."""
        return max(self.planned - 1, self.sent)

    @property
    def sizes(self) -> Sizes:
        """Shape of every part of the state that is history, see `initial_history`."""
        sizes = {"planned": (6, self.planned), "sent": (6, self.sent), "ages": (self.ages, 1)}
        sizes |= {"idle": (1, 1)}
        if self.lags:
            sizes |= {"tail": (6, 2), "swift": (6, 2)}
        if self.clings:
            sizes["clung"] = (6, 2)
        return sizes | ({"owed": (6, 1)} if self.owes else {})


def initial_history(history: History, twist: np.ndarray) -> dict[str, np.ndarray]:
    """Return the history of an object that has moved at `twist` (6,) for ever."""
    parts = {name: np.zeros(size) for name, size in history.sizes.items()}
    parts["planned"][:], parts["sent"][:], parts["ages"][:] = twist[:, None], twist[:, None], FAR
    parts["idle"][:] = 0.0 if np.any(twist) else FAR
    return parts


def remaining_seconds(younger: Any, older: Any, dead: float, lag: float) -> Any:
    """Seconds for which twists sent between two ages still act."""
    seconds = ca.fmin(older, dead) - ca.fmin(younger, dead)
    if lag:
        seconds += lag * (
            ca.exp(-ca.fmax(younger - dead, 0) / lag) - ca.exp(-ca.fmax(older - dead, 0) / lag)
        )
    return seconds
