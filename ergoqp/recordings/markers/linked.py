"""Markers of limbs that keep their distances, and those that do not: another's, or fallen off.

Two or three markers are no shape that could be followed (`ergoqp.recordings.markers.rigid`), but
along a limb each keeps its distance from those beside it, as far as skin and joints let it.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import Final

import numpy as np

from ergoqp.joints import SIDES

_TOGETHER: Final = (
    ("upper_arm", "outer_elbow", "inner_elbow"),
    ("outer_elbow", "inner_elbow", "forearm", "wrist_thumb", "wrist_small"),
    ("wrist_thumb", "wrist_small", "hand"),
    ("thigh", "outer_knee", "inner_knee"),
    ("outer_knee", "inner_knee", "shank", "outer_ankle", "inner_ankle"),
    ("outer_ankle", "inner_ankle", "heel", "forefoot"),
)
"""Landmarks of a side of which any two keep their distance; joints are near their axes."""
_SHARE: Final = 0.25
"""For so much of the time at least a marker is where it belongs."""
_TIMES: Final = 6.0
"""By how many times its usual deviation a distance may be another."""
_LEEWAY: Final = (0.03, 0.08)
"""By how much it may be so at least, as skin moves, and at most [m]."""


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
                length = np.linalg.norm(at[one] - at[other], axis=1)
                length = length[np.isfinite(length)]
                if len(length):
                    self._usual[one, other] = _usual(length)

    def astray(self, at: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return the landmarks that are elsewhere -> those frames (n,) bool.

        Of those whose distances do not hold, the one is elsewhere of which the largest share does
        not; between equals the one of which the most do not; and both if that is equal, too.

        Args:
            at: landmark -> positions (n, 3) [m]; NaN where not seen.
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
            found[rows] = _out(seen[rows], broken[rows], which, len(names))
        return {name: found[:, i] for i, name in enumerate(names) if found[:, i].any()}


def _out(seen: np.ndarray, broken: np.ndarray, which: np.ndarray, count: int) -> np.ndarray:
    """Return which of some markers are elsewhere (n, count) bool.

    Args:
        seen: links of which both ends are seen (n, links) bool.
        broken: those whose distance does not hold (n, links) bool.
        which: their ends (links, 2).
        count: of the markers.
    """
    ends = np.zeros((len(which), count))
    ends[np.arange(len(which))[:, None], which] = 1.0
    out = np.zeros((len(seen), count), dtype=bool)
    for _ in range(count):
        bad, all_of = broken @ ends, seen @ ends
        if not bad.any():
            break
        blame = bad / np.maximum(all_of, 1) + 1e-3 * bad
        worst = blame.max(axis=1, keepdims=True)
        now = (blame > worst - 1e-9) & (worst > 0)
        out |= now
        kept = (now @ ends.T) == 0
        seen, broken = seen & kept, broken & kept
    return out


def _usual(length: np.ndarray) -> tuple[float, float]:
    """Return the distance at which two markers mostly are, and by how much it may be another."""
    ordered = np.sort(length)
    count = max(1, round(_SHARE * len(ordered)))
    widths = ordered[count - 1 :] - ordered[: len(ordered) - count + 1]
    first = int(np.argmin(widths))
    middle = float(np.median(ordered[first : first + count]))
    varies = 1.4826 * float(np.median(np.abs(ordered - middle)))
    return middle, float(np.clip(_TIMES * varies, *_LEEWAY))
