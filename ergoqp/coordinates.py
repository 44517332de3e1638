"""Which entries of a state a model reads: joints of the person, or coordinates of points."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Final

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ergoqp.errors import InputError
from ergoqp.joints import INDEX, JOINTS, UPPER_BODY

FOREARM: Final[tuple[str, ...]] = ("elbow_x", "elbow_y", "elbow_z", "wrist_x", "wrist_y", "wrist_z")
"""State of the problem ``forearm``: elbow and wrist of the right arm in the pelvis frame [m]."""

_KNEES: Final = ("right_knee_flexion", "left_knee_flexion")

REPORT_JOINTS: Final[tuple[str, ...]] = (
    *(joint for joint in UPPER_BODY if not joint.endswith("shoulder_rotation")),
    *_KNEES,
)
"""The EPFL report's 20 joints: neck 3, trunk 3, knees 2, per arm shoulder 2, elbow 1, wrist 3."""


SCORED_JOINTS: Final[tuple[str, ...]] = (*UPPER_BODY, *_KNEES)
"""The 22 joints that the sheet reads: those of the report, and the rotation of both shoulders."""


class Coordinates:
    """Names of the inputs of a model, and their positions in a state.

    If the names are joints, in any number and order, the state is a posture (32,). With any
    other names the state consists of exactly these inputs.

    Args:
        names: names of the inputs, each once.

    Raises:
        InputError: if there are no names, a name occurs twice, or joints are mixed with other
            names.

    Example:
        >>> import numpy as np
        >>> from ergoqp.coordinates import Coordinates
        >>> coordinates = Coordinates(["trunk_twist", "neck_flexion"])
        >>> coordinates.indices, coordinates.read(np.zeros((3, 32))).shape
        ([2, 3], (3, 2))
        >>> coordinates.spread([[0.1, 0.2]])[0, 2:4].tolist()
        [0.1, 0.2]
    """

    def __init__(self, names: Sequence[str]) -> None:
        """Check the names."""
        self.names = tuple(names)
        known = [name for name in self.names if name in INDEX]
        if not self.names or len(set(self.names)) < len(self.names):
            raise InputError(
                f"coordinates: got {self.names!r}, allowed one or more names, each once"
            )
        if known and len(known) < len(self.names):
            other = next(name for name in self.names if name not in INDEX)
            raise InputError(
                f"coordinates: got {other!r} among joints, allowed names of ergoqp.JOINTS only"
            )
        self.state = JOINTS if known else self.names

    def __len__(self) -> int:
        """Return the number of inputs."""
        return len(self.names)

    @cached_property
    def indices(self) -> list[int]:
        """Position of each input in the state."""
        return [self.state.index(name) for name in self.names]

    def pick(self, q: ca.MX) -> ca.MX:
        """Return the inputs (d,) from a state, an expression.

        Raises:
            InputError: if the state has another size.
        """
        if q.shape != (len(self.state), 1):
            raise InputError(
                f"posture: got an expression of shape {q.shape}, allowed ({len(self.state)}, 1)"
            )
        return q if self.indices == list(range(q.shape[0])) else q[self.indices]

    def read(self, states: ArrayLike) -> NDArray[np.float64]:
        """Return the inputs (n, d) from states (n, N), or (N,) for one.

        Raises:
            InputError: if the number of entries is wrong.
        """
        rows = np.atleast_2d(np.asarray(states, dtype=float))
        if rows.ndim != 2 or rows.shape[1] != len(self.state):
            what = (
                "in the order of ergoqp.JOINTS" if self.state == JOINTS else ", ".join(self.state)
            )
            raise InputError(
                f"postures: got shape {np.shape(states)}, allowed (n, {len(self.state)}), {what}"
            )
        return rows[:, self.indices]

    def rows(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return inputs (n, d), or (d,) for one, as an array (n, d).

        Raises:
            InputError: if the shape is wrong.
        """
        rows = np.atleast_2d(np.asarray(points, dtype=float))
        if rows.ndim != 2 or rows.shape[1] != len(self):
            raise InputError(
                f"points: got shape {np.shape(points)}, allowed (n, {len(self)}):"
                f" {', '.join(self.names)}"
            )
        return rows

    def spread(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return states (n, N) from inputs (n, d). All other entries are zero."""
        rows = self.rows(points)
        states = np.zeros((len(rows), len(self.state)))
        states[:, self.indices] = rows
        return states
