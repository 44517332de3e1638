"""What the next call of a stepper starts from, as one value that is replaced and never changed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

import numpy as np

from ergoqp.step.guide.place import Guide
from ergoqp.step.model import StepModel

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
