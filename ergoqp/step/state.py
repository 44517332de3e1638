"""What one step leaves to the next, as one vector.

The same inputs and the same state always give the same answers.
"""

from __future__ import annotations

import numpy as np

from ergoqp.problem.problem import Problem
from ergoqp.step.guide import TRIAL
from ergoqp.step.history import history_sizes, initial_history, owes
from ergoqp.step.parts import count
from ergoqp.step.rest import STATES
from ergoqp.step.story import watch_blocks
from ergoqp.step.watch import taken_over


def state_sizes(problem: Problem, guided: bool = False) -> dict[str, tuple[int, int]]:
    """Return the shape of every part of the state, in order."""
    sizes = {
        "history": (count(history_sizes(problem)), 1),
        "stored": (4, 4),
        "started": (1, 1),
        "rest": (STATES, 1),
    }
    sizes |= {name: (count(block), 1) for name, block in watch_blocks(problem).items()}
    if owes(problem):
        # How far the object may be from where it is reckoned, along each axis and against it, since
        # it was measured.
        sizes["unsure"] = (6, 2)
    if asks_back(problem):
        sizes["asked"] = (2, 1)
    return sizes | ({"trial": (TRIAL, 1)} if guided else {})


def asks_back(problem: Problem) -> bool:
    """Whether some row of the person's posture may ask the object to come back."""
    return any(not limit.hard and any(limit.returns) for limit in problem.row_limits)


def initial_state(
    problem: Problem, guided: bool = False, twist: np.ndarray | None = None
) -> np.ndarray:
    """Return the state of a loop that begins.

    Args:
        problem: the task.
        guided: whether the step can be drawn toward a given place.
        twist: with which the object moves already (6,) [m/s, rad/s]; None: it stands still.
    """
    parts = {name: np.zeros(size) for name, size in state_sizes(problem, guided).items()}
    history = initial_history(problem, np.zeros(6) if twist is None else twist)
    parts["history"] = np.concatenate([part.ravel(order="F") for part in history.values()])
    if twist is not None:
        for name, block in taken_over(problem, twist).items():
            parts[name] = block[:, None]
    return np.concatenate([part.ravel(order="F") for part in parts.values()])
