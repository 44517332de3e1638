"""The state that one step hands to the next, as one vector.

The same inputs and the same state always give the same answers.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ergoqp.arguments import check_kind, flag, read_array
from ergoqp.problem.problem import Problem
from ergoqp.step.model import StepModel
from ergoqp.step.robot_watch.watch import taken_over
from ergoqp.step.under_way.history import initial_history


def initial_state(problem: Problem, twist: Any = None, *, guided: bool = False) -> np.ndarray:
    """Return the state (n,) at the start of a loop: the input ``state`` of `step_function`.

    The state is all that a step leaves to the next: the twists of the last periods with their ages,
    the pose and what of the motion is still under way, the last posture, whether the loop is on
    hold, the state of rest, the comparison of the robot with what it was sent, the time for which
    the posture has asked the object back, and what was learned about the guide. The order of the
    entries may change from version to version.

    Args:
        problem: the task.
        twist: twist (6,) with which the object moves already [m/s, rad/s], clipped to the speed
            limits. None: the object stands still.
        guided: whether the state is that of a step with a guide.

    Returns:
        The entries (n,), in the units of the step: metres, radians, seconds.

    Raises:
        InputError: if `problem` is not a Problem, `twist` is not six finite numbers, or `guided` is
            not a bool.

    Example:
        >>> import ergoqp
        >>> problem = ergoqp.load_problem("screwing")
        >>> state = ergoqp.initial_state(problem)
        >>> state.shape == ergoqp.step_function(problem).size_in("state")[:1]
        True
    """
    check_kind("problem", problem, Problem, "a Problem, such as ergoqp.load_problem gives")
    return state_at_start(StepModel(problem, flag("guided", guided)), twist)


def state_at_start(model: StepModel, twist: Any = None) -> np.ndarray:
    """Return the initial state of a step, see `initial_state`."""
    if twist is not None:
        speed = model.problem.twist_limit.speed
        twist = np.clip(read_array("twist", twist, (6,), "6 finite numbers"), -speed, speed)
    parts = {name: np.zeros(size) for name, size in model.state.items()}
    history = initial_history(model.history, np.zeros(6) if twist is None else twist)
    parts["history"] = np.concatenate([part.ravel(order="F") for part in history.values()])
    if twist is not None:
        for name, block in taken_over(model, twist).items():
            parts[name] = block[:, None]
    return np.concatenate([part.ravel(order="F") for part in parts.values()])
