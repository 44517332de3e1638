"""How the hands hold the object: its contact frame, and the turns that the grasp leaves free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from ergoqp.errors import InputError
from ergoqp.problem.problem import Problem
from ergoqp.responses.ik import IkResponse

AXIS: Final = {"along": (1.0, 0.0, 0.0), "thumb": (0.0, 0.0, 1.0)}
"""The tool axis in the frame of a grip: out of the fist, or past the thumb."""


@dataclass(frozen=True)
class Work:
    """A problem's description of how the object is held, independent of the person.

    Attributes:
        hands: hands that hold the object.
        stance: ``"standing"`` or ``"seated"``.
        seat_height: height of the hip centres when seated [m]; None: adapted to the person.
        tool: axis of the tool in the hand.
        free_about_tool: whether the hand may turn about it.
    """

    hands: tuple[str, ...]
    stance: str
    seat_height: float | None
    tool: str
    free_about_tool: bool

    @classmethod
    def of(cls, problem: Problem) -> Work:
        """Return the work of a problem.

        Raises:
            InputError: if its response is not an `IkResponse`.
        """
        said = problem.response
        if not isinstance(said, IkResponse):
            raise InputError(
                f"simulated person: got a response of type {type(said).__name__}, allowed"
                " IkResponse"
            )
        return cls(said.hands, said.stance, said.seat_height, said.tool, said.free_about_tool)

    def contact(self, grips: Sequence[np.ndarray]) -> np.ndarray:
        """Return the contact frame of the object (4, 4) for the grips of the hands (4, 4) each."""
        return contact_of(grips, self.tool)


def contact_of(grips: Sequence[np.ndarray], tool: str) -> np.ndarray:
    """Return the contact frame (4, 4) [m] for grips (4, 4) each. Its x axis is the tool axis.

    One hand: it is at the grip. Two hands: it is midway, y points from the right grip to the
    left one, and x is as close as possible to the mean of the two tool axes.
    """
    frame = np.eye(4)
    frame[:3, 3] = np.mean([grip[:3, 3] for grip in grips], axis=0)
    x = np.sum([grip[:3, :3] @ AXIS[tool] for grip in grips], axis=0)
    if len(grips) == 1:
        frame[:3, 0], frame[:3, 1] = x, grips[0][:3, 1]
    else:
        y = grips[1][:3, 3] - grips[0][:3, 3]
        frame[:3, 1] = y / np.linalg.norm(y)
        x = x - frame[:3, 1] * (frame[:3, 1] @ x)
        frame[:3, 0] = x / np.linalg.norm(x)
    frame[:3, 2] = np.cross(frame[:3, 0], frame[:3, 1])
    return frame
