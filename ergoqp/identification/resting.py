"""When the person is at rest, and in which posture; angles are noisy and people follow late."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from ergoqp.arguments import as_tuple, read_array, shown
from ergoqp.errors import InputError
from ergoqp.expressions.rigid import read_pose
from ergoqp.joints import JOINTS

WINDOW: Final = 1.0
"""Time over which postures are averaged [s]."""

LONGEST: Final = 5.0
"""An object at rest for this long is judged, even if the person is not steady [s]."""

STEADY: Final = float(np.radians(1.0))
"""Largest RMS difference of the means of two consecutive windows at rest [rad]."""


@dataclass(frozen=True)
class Resting:
    """A measured rest.

    Attributes:
        time: time of the loop at the end of the rest [s].
        pose: pose of the object (4, 4) [m].
        posture: mean posture of the last second, over the frames in which a joint was seen (32,)
            [rad]; NaN if it was never seen.

    Example:
        >>> import numpy as np
        >>> from ergoqp.identification.resting import Resting
        >>> rest = Resting(time=4.2, pose=np.eye(4), posture=np.zeros(32))
        >>> rest.posture.shape
        (32,)
    """

    time: float
    pose: np.ndarray
    posture: np.ndarray


class RestWatch:
    """Collects postures while the object is at rest, and detects when the person rests too."""

    def __init__(self) -> None:
        """Start with an object that moves."""
        self.begin()

    def begin(self) -> None:
        """Delete what was collected, because the object moves."""
        self._still, self._windows = 0.0, []
        self._sum, self._count, self._in_window = np.zeros(1), np.zeros(1), 0.0

    def add(
        self, now: float, dt: float, still: bool, posture: np.ndarray, pose: np.ndarray
    ) -> Resting | None:
        """Add a period; return the rest as soon as it is detected.

        Args:
            now: time of the loop [s].
            dt: period [s].
            still: whether the object is at rest in this period.
            posture: measured posture (32,) [rad], NaN for joints that are not seen or not new.
            pose: pose of the object (4, 4) [m].
        """
        if not still:
            if self._still:
                self.begin()
            return None
        seen = np.isfinite(posture)
        self._sum = self._sum + np.where(seen, posture, 0.0)
        self._count = self._count + seen
        self._still += dt
        self._in_window += dt
        if self._in_window < WINDOW - dt / 2:
            return None
        mean = np.full(posture.shape, np.nan)
        np.divide(self._sum, self._count, out=mean, where=self._count > 0)
        self._windows.append(mean)
        self._sum, self._count, self._in_window = np.zeros(1), np.zeros(1), 0.0
        if not (self._steady() or self._still >= LONGEST - dt / 2):
            return None
        self.begin()
        return Resting(now, pose.copy(), mean)

    def _steady(self) -> bool:
        if len(self._windows) < 2:
            return False
        apart = self._windows[-1] - self._windows[-2]
        both = np.isfinite(apart)
        return bool(both.any() and np.sqrt(np.mean(apart[both] ** 2)) < STEADY)


def rests_of(given: Any) -> list[Resting]:
    """Return the rests in what a user gives.

    Args:
        given: `Resting`s, or pairs of a posture (32,) [rad] and a pose (4, 4) [m].

    Raises:
        InputError: if there is none, or one cannot be read.
    """
    found = []
    for number, each in enumerate(as_tuple("rests", given)):
        if isinstance(each, Resting):
            found.append(each)
            continue
        where = f"rests[{number}]"
        try:
            posture, pose = each
        except (TypeError, ValueError):
            raise InputError(f"{where}: got {shown(each)}, allowed a posture and a pose") from None
        angles = _angles(f"{where}: posture", posture)
        found.append(Resting(0.0, read_pose(f"{where}: pose", pose), angles))
    if not found:
        raise InputError("rests: got none, allowed at least one")
    return found


def _angles(what: str, value: Any) -> np.ndarray:
    """Return angles (32,) [rad], NaN for joints that were not seen."""
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError):
        array = np.zeros(0)
    allowed = f"{len(JOINTS)} angles [rad], NaN for what is not seen"
    if array.shape != (len(JOINTS),):
        raise InputError(f"{what}: got {shown(value)}, allowed {allowed}")
    return read_array(what, np.where(np.isnan(array), 0.0, array), array.shape, allowed) + array * 0
