"""What every reader hands on: the centres of a recording's own joints over time.

They are in the recording's own unit and axes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class JointMotion:
    """Joint centres as the file states them, before any naming, unit or axis is chosen.

    Attributes:
        names: the file's joint names, unique, shape (m,).
        positions: joint centres in the file's unit and axes, shape (n, m, 3); NaN where a joint is
            not seen.
        time: time stamps from the file, increasing from zero, shape (n,) [s].
        rest: joint centres of the skeleton's rest pose, in the same unit and axes, shape (m, 3);
            None if the format has none.
        notes: sentences about how the file was read that its user should know.
    """

    names: tuple[str, ...]
    positions: np.ndarray
    time: np.ndarray
    rest: np.ndarray | None = None
    notes: tuple[str, ...] = ()

    def of(self, name: str) -> np.ndarray:
        """Return the path of one joint centre, shape (n, 3) [file unit].

        Args:
            name: one of ``names``.

        Raises:
            ValueError: there is no joint of that name.
        """
        return self.positions[:, self.names.index(name)]
