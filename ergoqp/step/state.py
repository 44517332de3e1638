"""The state that one step hands to the next, and what the next call of a stepper starts from.

The state that one step hands to the next, as one vector.

The same inputs and the same state always give the same answers.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np

from ergoqp.arguments import check_kind, flag, read_array
from ergoqp.problem.problem import Problem
from ergoqp.step.faults import taken_over
from ergoqp.step.guide import Guide
from ergoqp.step.layout import initial_history
from ergoqp.step.model import StepModel


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


Frame: TypeAlias = tuple[np.ndarray, np.ndarray]
"""Posture and mask of a frame, as read (n,) each."""

Ready: TypeAlias = tuple[np.ndarray, np.ndarray, Mapping[str, str], Frame]
"""What the next call starts from: usual inputs, state, notes, and the last frame.

It is never written to, but replaced as one, as the last operation of a call. So an exception at any
point of a call (a signal handler, Ctrl-C) leaves the stepper as it was before the call. The usual
inputs are all inputs of the function, one after the other, with the guide; the notes say what was
wrong with the guide. A plain tuple is the fastest to make.
"""


class Layout:
    """Where everything is in the inputs of the function of a step.

    Attributes:
        at: slice of each input.
        parts: slice of each part of the state, within the state.
    """

    def __init__(self, model: StepModel, at: Mapping[str, slice]) -> None:
        """Keep the slices `at` of the inputs."""
        self.at, self.parts = at, model.places
        self._dt, self._n = model.problem.dt, len(model.problem.coordinates)

    def begin(self, size: int, state: np.ndarray, place: Guide | None) -> Ready:
        """Return what the first call starts from.

        Args:
            size: number of all inputs.
            state: the initial state.
            place: place of the guide. None: there is none.
        """
        usual = np.zeros(size)
        for name in ("observed", "frame", "enable"):
            usual[self.at[name]] = 1.0
        usual[self.at["dt"]] = self._dt
        if place is not None:
            usual = self.led(usual, place)
        return usual, state, {}, (np.zeros(self._n), np.ones(self._n))

    def led(self, usual: np.ndarray, place: Guide | None) -> np.ndarray:
        """Return the usual inputs with another guide; None: there is none."""
        usual, at = usual.copy(), self.at
        usual[at["guided"]] = place is not None
        if place is not None:
            usual[at["guide"]], usual[at["promise"]] = place.pose.T.ravel(), place.expected
        return usual

    def forgotten(self, state: np.ndarray, *names: str) -> np.ndarray:
        """Return a state with parts that are zero."""
        state = state.copy()
        for name in names:
            state[self.parts[name]] = 0.0
        return state
