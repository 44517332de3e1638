"""The poses of a node of the scene in all frames, written into viser's recording."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


def coarse(values: ArrayLike) -> NDArray[np.float64]:
    """Return values rounded to 1/8192 (0.1 mm), which halves the scene with no visible change."""
    return np.rint(np.asarray(values, dtype=float) * 8192) / 8192


class Track:
    """The way of one node.

    A setter of viser takes 40 us to check a pose and to send it, and nobody is connected. So the
    first message of each kind is made by the setter, and the following ones are copies of it with
    another value, encoded at once.

    Args:
        node: its handle.
        positions: in every frame (n, 3) [m].
        turns: quaternions in every frame, w first (n, 4); None: it does not turn.
    """

    def __init__(self, node: Any, positions: ArrayLike, turns: ArrayLike | None = None) -> None:
        """Round the poses of all frames at once."""
        self._node = node
        self._ways = {"position": coarse(positions).tolist()}
        if turns is not None:
            self._ways["wxyz"] = coarse(turns).tolist()
        self._now: dict[str, list[float]] = {}
        self._first: dict[str, dict[str, Any]] = {}

    def show(self, frame: int, recording: Any = None) -> None:
        """Move the node to a frame, by messages of a recording if there is one."""
        for what, way in self._ways.items():
            value = way[frame]
            if value == self._now.get(what):
                continue
            self._now[what] = value
            if recording is None:
                setattr(self._node, what, value)
            elif what in self._first:
                message = self._encoded({**self._first[what], what: value})
                recording._messages.append((recording._time, self._raw(message)))
            else:
                self._begin(what, value, recording)

    def _begin(self, what: str, value: list[float], recording: Any) -> None:
        """Have the setter make the first message."""
        import msgspec  # comes with viser

        self._encoded, self._raw = msgspec.msgpack.Encoder().encode, msgspec.Raw
        count = len(recording._messages)
        setattr(self._node, what, value)
        # What the setter takes for no change has no message.
        if len(recording._messages) > count:
            self._first[what] = recording._messages[-1][1]
