"""What the next call of a stepper starts from, as one value that is replaced and never changed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ergoqp.step.guide.place import Guide
from ergoqp.step.model import StepModel


class Ready(NamedTuple):
    """What the next call starts from.

    It is never written to, but replaced as one, as the last operation of a call. So an exception at
    any point of a call (a signal handler, Ctrl-C) leaves the stepper as it was before the call.

    Attributes:
        inputs: all inputs of the function: the usual ones, the guide, and the state.
        notes: what was wrong with the guide.
        frame: posture and mask of the last frame, as read (n,) each.
    """

    inputs: np.ndarray
    notes: Mapping[str, str]
    frame: tuple[np.ndarray, np.ndarray]


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

    def usual(self, size: int, state: np.ndarray, place: Guide | None) -> Ready:
        """Return what the first call starts from.

        Args:
            size: number of all inputs.
            state: the initial state.
            place: place of the guide. None: there is none.
        """
        inputs, at = np.zeros(size), self.at
        for name in ("observed", "frame", "enable"):
            inputs[at[name]] = 1.0
        inputs[at["dt"]], inputs[at["state"]] = self._dt, state
        if place is not None:
            self.lead(inputs, place)
        return Ready(inputs, {}, (np.zeros(self._n), np.ones(self._n)))

    def lead(self, inputs: np.ndarray, place: Guide | None) -> None:
        """Write the inputs of a guide; None: there is none."""
        at = self.at
        inputs[at["guided"]] = place is not None
        if place is not None:
            inputs[at["guide"]], inputs[at["promise"]] = place.pose.T.ravel(), place.expected

    def state(self, ready: Ready) -> np.ndarray:
        """Return the state, which must not be written to."""
        return ready.inputs[self.at["state"]]

    def with_state(self, ready: Ready, state: np.ndarray) -> Ready:
        """Return the same with another state."""
        inputs = ready.inputs.copy()
        inputs[self.at["state"]] = state
        return Ready(inputs, ready.notes, ready.frame)

    def forgotten(self, ready: Ready, *names: str) -> Ready:
        """Return the same with parts of the state that are zero."""
        state = self.state(ready).copy()
        for name in names:
            state[self.parts[name]] = 0.0
        return self.with_state(ready, state)
