"""Assignment of markers to landmarks of the body; the known marker sets are data."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import resources
from typing import Any, Final

from ergoqp.joints import SIDES
from ergoqp.recordings.names import squashed

MIDDLE: Final = ("c7", "back", "notch", "xiphoid", "sacrum")
"""Landmarks in the middle: vertebra C7, the spine at about T10, the notch above the breastbone, its
lower end, the sacrum between the two PSIS."""
SIDED: Final = (
    "head_front",
    "head_back",
    "acromion",
    "upper_arm",
    "outer_elbow",
    "inner_elbow",
    "forearm",
    "wrist_thumb",
    "wrist_small",
    "hand",
    "asis",
    "psis",
    "thigh",
    "outer_knee",
    "inner_knee",
    "shank",
    "outer_ankle",
    "inner_ankle",
    "heel",
    "forefoot",
)
"""Landmarks on each side: ``wrist_thumb`` and ``wrist_small`` on the sides of thumb and small
finger, ``hand`` on the back of the knuckles, ``forefoot`` on the foot above the second toe's ball,
``upper_arm``, ``forearm``, ``thigh`` and ``shank`` on the outside between the joints."""
LANDMARKS: Final = (*MIDDLE, *(f"{side}_{name}" for side in SIDES for name in SIDED))
"""Names of the places of markers on the skin; those on both sides begin with the side.

Example:
    >>> from ergoqp.recordings.markers.landmarks import LANDMARKS
    >>> "c7" in LANDMARKS, "right_asis" in LANDMARKS
    (True, True)
"""

RIGID: Final = {
    "pelvis": ("right_asis", "left_asis", "right_psis", "left_psis", "sacrum"),
    "trunk": ("c7", "back", "notch", "xiphoid"),
    "head": tuple(f"{side}_head_{end}" for side in SIDES for end in ("front", "back")),
}
"""Segments that are tracked as rigid shapes -> their landmarks."""
_BELOW: Final = ("asis", "psis", "sacrum", "thigh", "knee", "shank", "ankle", "heel", "forefoot")
_LEAST: Final = 8
"""Fewer landmarks than this may match by chance."""


@dataclass(frozen=True)
class MarkerSet:
    """A convention for the names of markers.

    Attributes:
        title: its name in messages.
        landmarks: landmark -> possible names; the first one in the recording is used.
        more: rigid segment -> further markers on it.
    """

    title: str
    landmarks: Mapping[str, tuple[str, ...]]
    more: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def found_in(self, names: tuple[str, ...]) -> dict[str, str]:
        """Return landmark -> its marker, for the markers among `names`."""
        there = {squashed(name): name for name in reversed(names)}
        found = {}
        for landmark, theirs in self.landmarks.items():
            marker = next((there[squashed(t)] for t in theirs if squashed(t) in there), None)
            if marker is not None:
                found[landmark] = marker
        return found

    def more_in(self, names: tuple[str, ...]) -> dict[str, tuple[str, ...]]:
        """Return rigid segment -> its further markers among `names`."""
        there = {squashed(name): name for name in reversed(names)}
        return {
            segment: tuple(there[squashed(t)] for t in theirs if squashed(t) in there)
            for segment, theirs in self.more.items()
        }


def above_hips(landmark: str) -> bool:
    """Return whether a landmark, a joint centre or a rigid segment is above the hips."""
    return not landmark.endswith((*_BELOW, "pelvis", "hip", "toe"))


@lru_cache(maxsize=1)
def known_sets() -> tuple[MarkerSet, ...]:
    """Return the sets of ``marker_sets.toml``, in its order."""
    file = resources.files("ergoqp.recordings.markers").joinpath("marker_sets.toml")
    entries = tomllib.loads(file.read_text(encoding="utf-8"))
    return tuple(_set(entry) for entry in entries.values())


def best_set(names: tuple[str, ...]) -> tuple[MarkerSet, int] | None:
    """Return the set with the most landmarks among `names`, and their number; None if too few."""
    counts = [(len(each.found_in(names)), each) for each in known_sets()]
    count, best = max(counts, key=lambda pair: pair[0])
    return (best, count) if count >= _LEAST else None


def _set(entry: Mapping[str, Any]) -> MarkerSet:
    landmarks = {name: _listed(theirs) for name, theirs in entry.get("middle", {}).items()}
    for side in SIDES:
        letters = {"S": side[0].upper(), "s": side[0], "side": side}
        for name, theirs in {**entry.get("sided", {}), **entry.get(side, {})}.items():
            landmarks[f"{side}_{name}"] = tuple(t.format(**letters) for t in _listed(theirs))
    more = {segment: tuple(theirs) for segment, theirs in entry.get("more", {}).items()}
    return MarkerSet(entry["title"], landmarks, more)


def _listed(theirs: str | list[str]) -> tuple[str, ...]:
    return (theirs,) if isinstance(theirs, str) else tuple(theirs)
