"""The result of every reader: a recording's own joints, markers, segments and objects over time.

All are in the recording's own unit and axes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np


@dataclass(frozen=True)
class JointMotion:
    """Content of a file, before any naming, unit or axis is chosen.

    Attributes:
        names: names of the file's joints or markers, unique, shape (m,).
        positions: their positions in the file's unit and axes, shape (n, m, 3); NaN where not seen.
        time: time stamps from the file, increasing from zero, shape (n,) [s].
        rest: joint centres of the skeleton's rest pose, in the same unit and axes, shape (m, 3);
            None if the format has none.
        notes: sentences for the user about how the file was read.
        turns: name of a joint or segment -> its orientation in the file's axes, unit quaternions
            (x, y, z, w), shape (n, 4); NaN where not seen.
        objects: name of an object -> its pose in the file's unit and axes, shape (n, 4, 4).
        angles: name of a joint angle that the file itself holds -> its values (n,) [rad].
        markers: whether the positions are those of markers on the skin and not of joint centres.
        unit: the file's unit of length [m]; None if the file does not state it.
        measures: the file's name of a body measure, in small letters -> its value [m].
        up: the file's vertical axis, one of `ergoqp.recordings.fitting.axes.UPS`; None if the file
            does not state it.

    Example:
        >>> import numpy as np
        >>> from ergoqp.recordings.motion import JointMotion
        >>> motion = JointMotion(("hip", "knee"), np.zeros((10, 2, 3)), np.arange(10) / 100)
        >>> motion.of("knee").shape, motion.unit
        ((10, 3), None)
    """

    names: tuple[str, ...]
    positions: np.ndarray
    time: np.ndarray
    rest: np.ndarray | None = None
    notes: tuple[str, ...] = ()
    turns: Mapping[str, np.ndarray] = field(default_factory=dict)
    objects: Mapping[str, np.ndarray] = field(default_factory=dict)
    angles: Mapping[str, np.ndarray] = field(default_factory=dict)
    markers: bool = False
    unit: float | None = None
    up: str | None = None
    measures: Mapping[str, float] = field(default_factory=dict)

    def of(self, name: str) -> np.ndarray:
        """Return the path of one joint centre, shape (n, 3) [file unit].

        Args:
            name: one of ``names``.

        Raises:
            ValueError: if there is no joint of that name.
        """
        return self.positions[:, self.names.index(name)]

    def at(self, frames: np.ndarray) -> JointMotion:
        """Return the motion in some of the frames, given as (n,) bool."""
        return replace(
            self,
            positions=self.positions[frames],
            time=self.time[frames],
            turns={name: each[frames] for name, each in self.turns.items()},
            objects={name: each[frames] for name, each in self.objects.items()},
            angles={name: each[frames] for name, each in self.angles.items()},
        )

    def joints(self, keep: Mapping[str, str]) -> JointMotion:
        """Return the motion of some of the joints, given as name -> new name."""
        places = [i for i, name in enumerate(self.names) if name in keep]
        return replace(
            self,
            names=tuple(keep[self.names[i]] for i in places),
            positions=self.positions[:, places],
            rest=None if self.rest is None else self.rest[places],
            turns={keep[name]: each for name, each in self.turns.items() if name in keep},
        )
