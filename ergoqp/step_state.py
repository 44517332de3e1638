"""What one step leaves to the next, as one vector: the same inputs and the same state give the same answers, always."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from ergoqp.rest import STATES
from ergoqp.step_guide import TRIAL
from ergoqp.step_watch import WATCH
from ergoqp.step_way import history_sizes, initial_history

if TYPE_CHECKING:
    from ergoqp.problem import Problem


def state_sizes(problem: Problem, guided: bool = False) -> dict[str, tuple[int, int]]:
    """Return the shape of every part of the state, in order."""
    sizes = history_sizes(problem) | {"stored": (4, 4), "started": (1, 1), "rest": (STATES, 1)} | WATCH
    if asks_back(problem):
        sizes["asked"] = (2, 1)
    return sizes | ({"trial": (TRIAL, 1)} if guided else {})


def asks_back(problem: Problem) -> bool:
    """Whether some row of the person's posture may ask the object to come back."""
    return any(not limit.hard and any(limit.returns) for limit in problem.row_limits)


def state_size(problem: Problem, guided: bool = False) -> int:
    """Return how many numbers the state has."""
    return sum(rows * columns for rows, columns in state_sizes(problem, guided).values())


def split_state(problem: Problem, state: Any, guided: bool = False) -> dict[str, Any]:
    """Return the parts of the state by name, each in its shape."""
    parts, start = {}, 0
    for name, (rows, columns) in state_sizes(problem, guided).items():
        part = state[start : start + rows * columns]
        parts[name] = part if columns == 1 else ca.reshape(part, rows, columns)
        start += rows * columns
    return parts


def joined_state(problem: Problem, parts: Mapping[str, Any], guided: bool = False) -> Any:
    """Return the state from its parts."""
    return ca.vertcat(*(ca.vec(parts[name]) for name in state_sizes(problem, guided)))


def initial_state(problem: Problem, guided: bool = False, twist: np.ndarray | None = None) -> np.ndarray:
    """Return the state of a loop that begins.

    Args:
        problem: the task.
        guided: whether the step can be drawn toward a given place.
        twist: with which the object moves already (6,) [m/s, rad/s]; None: it stands still.
    """
    parts = {name: np.zeros(size) for name, size in state_sizes(problem, guided).items()}
    parts |= initial_history(problem, np.zeros(6) if twist is None else twist)
    return np.concatenate([part.ravel(order="F") for part in parts.values()])
