"""Detection of limb markers that do not keep their distances: exchanged or fallen off.

Two or three markers are not a rigid shape that can be tracked (`ergoqp.recordings.markers.rigid`).
But along a limb each marker keeps its distance from its neighbours, as far as skin and joints
allow.
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
"""Groups of landmarks and joint centres of a side in which any two keep their distance: markers
beside a joint are near its axis."""
_SHARE: Final = 0.25
"""Least share of the time in which a marker is in its right place."""
_TIMES: Final = 6.0
"""Factor on the usual deviation of a distance by which it may differ."""
_LEEWAY: Final = (0.025, 0.08)
"""Limits of that difference: the smallest because skin moves, and the largest [m]."""
_BLADE: Final = 0.06
"""Its smallest limit for distances from a shoulder [m]: the shoulder blade turns with a raised arm,
and its marker is not at the joint."""


class Links:
    """The distances that markers of a person keep.

    Args:
        at: landmark -> positions (n, 3) [m] in a sample of frames; NaN where not seen.
    """

    def __init__(self, at: Mapping[str, np.ndarray]) -> None:
        """Measure the distances."""
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
        """Return the landmarks in a wrong place -> those frames (n,) bool.

        A landmark with the most wrong distances is in a wrong place. Its distances are removed, and
        this is repeated until no distance is wrong. Landmarks with equally many are all taken, so
        of two landmarks that only disagree with each other neither is used.

        Args:
            at: landmark -> positions (n, 3) [m]; NaN where not seen.
            around: number of frames before and after, in which a marker moves there and back.
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
    """Return which of some markers are in a wrong place (n, count) bool.

    Args:
        broken: links whose distance is wrong (n, links) bool.
        which: ends of the links (links, 2).
        count: number of markers.
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
    """Return the usual distance between two points (n, 3); NaN if they are never seen together.

    It is the median of the quarter of the frames in which the distance varies least, because either
    marker may fall off later.
    """
    length = np.linalg.norm(one - other, axis=1)
    ordered = np.sort(length[np.isfinite(length)])
    if not len(ordered):
        return float("nan")
    count = max(1, round(_SHARE * len(ordered)))
    first = int(np.argmin(ordered[count - 1 :] - ordered[: len(ordered) - count + 1]))
    return float(np.median(ordered[first : first + count]))
