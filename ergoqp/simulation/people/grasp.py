"""How hands hold the object: where its contact frame is, and which turns the grasp leaves free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ergoqp.errors import InputError
from ergoqp.problem.problem import Problem
from ergoqp.responses.ik import IkResponse

_TOOL_IN_GRIP = {"along": np.eye(3), "thumb": np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]])}
"""Rotation of the tool in the grip: out of the fist along the forearm, or past the thumb."""


@dataclass(frozen=True)
class Work:
    """What a problem says of how the object is worked on, whoever does it.

    Attributes:
        hands: that hold the object.
        stance: ``"standing"`` or ``"seated"``.
        seat_height: height of the hip centres when seated [m]; None: set to the person.
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
            InputError: if its response does not say.
        """
        said = problem.response
        if not isinstance(said, IkResponse):
            raise InputError(
                f"simulated person: got a response of type {type(said).__name__}, allowed"
                " IkResponse"
            )
        return cls(said.hands, said.stance, said.seat_height, said.tool, said.free_about_tool)

    def contact(self, grips: Sequence[np.ndarray]) -> np.ndarray:
        """Return the object's contact frame (4, 4) where the hands' grips (4, 4) each are.

        x is the tool's axis. One hand: at the grip. Two: midway, y from the right to the left one.
        """
        axes = [grip[:3, :3] @ _TOOL_IN_GRIP[self.tool] for grip in grips]
        frame = np.eye(4)
        frame[:3, 3] = np.mean([grip[:3, 3] for grip in grips], axis=0)
        if len(grips) == 1:
            frame[:3, :3] = axes[0]
            return frame
        y = grips[1][:3, 3] - grips[0][:3, 3]
        y /= np.linalg.norm(y)
        x = axes[0][:, 0] + axes[1][:, 0]
        x -= y * (x @ y)
        x /= np.linalg.norm(x)
        frame[:3, :3] = np.column_stack([x, y, np.cross(x, y)])
        return frame
