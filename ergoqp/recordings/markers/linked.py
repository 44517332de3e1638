"""Markers of limbs that keep their distances, and those that do not: another's, or fallen off.

Two or three markers are no shape that could be followed (`ergoqp.recordings.markers.rigid`), but
along a limb each keeps its distance from those beside it, as far as skin and joints let it.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import Final

import numpy as np
from scipy.ndimage import binary_dilation

from ergoqp.joints import SIDES

_TOGETHER: Final = (
    ("shoulder", "upper_arm", "outer_elbow", "inner_elbow"),
    ("outer_elbow", "inner_elbow", "forearm", "wrist_thumb", "wrist_small"),
    ("wrist_thumb", "wrist_small", "hand"),
    ("hip", "thigh", "outer_knee", "inner_knee"),
    ("outer_knee", "inner_knee", "shank", "outer_ankle", "inner_ankle"),
    ("outer_ankle", "inner_ankle", "heel", "forefoot"),
)
"""Landmarks and joint centres of a side of which any two keep their distance: markers beside joints
are near their axes."""
_SHARE: Final = 0.25
"""For so much of the time at least a marker is where it belongs."""
_TIMES: Final = 6.0
"""By how many times its usual deviation a distance may be another."""
_LEEWAY: Final = (0.025, 0.08)
"""By how much it may be so at least, as skin moves, and at most [m]."""
_BLADE: Final = 0.06
"""By how much at least those from a shoulder: the blade turns with a raised arm, and its marker is
not where the joint is [m]."""


class Links:
    """The distances that markers of a person keep.

    Args:
        at: landmark -> positions (n, 3) [m] in a sample of frames; NaN where not seen.
    """

    def __init__(self, at: Mapping[str, np.ndarray]) -> None:
        """Measure them."""
        pairs = {
            (f"{side}_{one}", f"{side}_{other}")
            for side in SIDES
            for group in _TOGETHER
            for one, other in combinations(group, 2)
        }
        self._usual: dict[tuple[str, str], tuple[float, float]] = {}
        for one, other in sorted(pairs):
            if one in at and other in at:
                middle = usual_distance(at[one], at[other])
                if np.isfinite(middle):
                    least = _BLADE if "shoulder" in one + other else _LEEWAY[0]
                    off = np.abs(np.linalg.norm(at[one] - at[other], axis=1) - middle)
                    varies = 1.4826 * float(np.nanmedian(off))
                    leeway = float(np.clip(_TIMES * varies, least, _LEEWAY[1]))
                    self._usual[one, other] = (middle, leeway)

    def astray(self, at: Mapping[str, np.ndarray], around: int = 0) -> dict[str, np.ndarray]:
        """Return the landmarks that are elsewhere -> those frames (n,) bool.

        It is each that alone explains every distance that does not hold; where none does, the one
        of which the most do not hold is elsewhere, and so on. Who is right of two that are apart,
        and both near all others, nobody knows: neither is taken.

        Args:
            at: landmark -> positions (n, 3) [m]; NaN where not seen.
            around: frames before and after those, in which it is on its way.
        """
        if not self._usual:
            return {}
        names = sorted({name for pair in self._usual for name in pair})
        which = np.array([[names.index(name) for name in pair] for pair in self._usual])
        usual, leeway = np.array(list(self._usual.values())).T
        length = np.stack(
            [np.linalg.norm(at[one] - at[other], axis=1) for one, other in self._usual], axis=1
        )
        seen = np.isfinite(length)
        broken = seen & (np.abs(np.where(seen, length, usual) - usual) > leeway)
        rows = np.flatnonzero(broken.any(axis=1))
        found = np.zeros((len(length), len(names)), dtype=bool)
        if len(rows):
            found[rows] = _out(broken[rows], which, len(names))
            found = binary_dilation(found, np.ones((2 * around + 1, 1), dtype=bool))
        return {name: found[:, i] for i, name in enumerate(names) if found[:, i].any()}


def _out(broken: np.ndarray, which: np.ndarray, count: int) -> np.ndarray:
    """Return which of some markers are elsewhere (n, count) bool.

    Args:
        broken: links whose distance does not hold (n, links) bool.
        which: their ends (links, 2).
        count: of the markers.
    """
    ends = np.zeros((len(which), count))
    ends[np.arange(len(which))[:, None], which] = 1.0
    out = np.zeros((len(broken), count), dtype=bool)
    for _ in range(count):
        bad = broken @ ends
        now = (bad == bad.max(axis=1, keepdims=True)) & (bad > 0)
        if not now.any():
            break
        out |= now
        broken = broken & ((now @ ends.T) == 0)
    return out


def usual_distance(one: np.ndarray, other: np.ndarray) -> float:
    """Return the distance at which two points (n, 3) mostly are; NaN if they are never seen.

    It is where a quarter of the frames is the nearest to one another: either may fall off later.
    """
    length = np.linalg.norm(one - other, axis=1)
    ordered = np.sort(length[np.isfinite(length)])
    if not len(ordered):
        return float("nan")
    count = max(1, round(_SHARE * len(ordered)))
    first = int(np.argmin(ordered[count - 1 :] - ordered[: len(ordered) - count + 1]))
    return float(np.median(ordered[first : first + count]))
