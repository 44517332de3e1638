"""Body of an unknown person: segment lengths and stature, measured in the recording."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Final

import numpy as np

from ergoqp.human import FRACTIONS, Body
from ergoqp.human.body import believable

_TELLING: Final = (("thigh", "shank", "trunk"), ("upper_arm", "forearm"))
"""Segments from which the stature is estimated: legs and trunk.

The arms are used only if those are missing, because character rigs often shorten the arms.
"""

_BETWEEN: Final[dict[str, tuple[tuple[str, str], ...]]] = {
    "neck": (("neck", "head"),),
    "head": (("head", "head_top"),),
    "shoulder_width": (("right_shoulder", "left_shoulder"),),
    "hip_width": (("right_hip", "left_hip"),),
    "upper_arm": (("right_shoulder", "right_elbow"), ("left_shoulder", "left_elbow")),
    "forearm": (("right_elbow", "right_wrist"), ("left_elbow", "left_wrist")),
    "thigh": (("right_hip", "right_knee"), ("left_hip", "left_knee")),
    "shank": (("right_knee", "right_ankle"), ("left_knee", "left_ankle")),
    "ankle_to_toe": (("right_ankle", "right_toe"), ("left_ankle", "left_toe")),
}
"""Segment -> the pairs of centres whose distance is its length, one pair per side."""


def measured_lengths(centres: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Return the segment lengths between named centres: frame medians, left and right averaged.

    Args:
        centres: centre -> positions (n, 3), any unit; NaN where not seen.

    Returns:
        Segment of `FRACTIONS`, or ``ankle_to_toe`` -> length in the same unit, for the segments
        whose ends were seen.
    """
    lengths = {}
    for segment, pairs in _BETWEEN.items():
        sides = [
            _median_distance(centres[a], centres[b])
            for a, b in pairs
            if a in centres and b in centres
        ]
        if sides := [side for side in sides if side > 0]:
            lengths[segment] = float(np.mean(sides))
    hips, shoulders = (_between(centres, joint) for joint in ("hip", "shoulder"))
    hips = centres.get("pelvis") if hips is None else hips
    if hips is not None and "neck" in centres:
        trunk = centres["neck"] - hips
        lengths["trunk"] = _median_distance(hips, centres["neck"])
        if shoulders is not None:
            with np.errstate(invalid="ignore", divide="ignore"):
                along = np.einsum("ni,ni->n", shoulders - hips, trunk) / np.linalg.norm(
                    trunk, axis=1
                )
            lengths["shoulder_height"] = _median(along)
    return {segment: length for segment, length in lengths.items() if length > 0}


def side_measured(segment: str, centres: Collection[str]) -> str | None:
    """Return the only side on which a segment is measured; None for both, or a middle segment.

    Args:
        segment: segment of `FRACTIONS`.
        centres: centres of the recording.
    """
    pairs = _BETWEEN.get("ankle_to_toe" if segment == "foot_length" else segment, ())
    seen = [a for a, b in pairs if a in centres and b in centres]
    return seen[0].partition("_")[0] if len(seen) == 1 < len(pairs) else None


def suggested_stature(lengths: Mapping[str, float]) -> float | None:
    """Return the stature estimated from the long segments, in the unit of the lengths.

    It is None if none of them was measured. The sum of the segments is used and not each one,
    because the sum does not depend on where a skeleton puts the joints between them.
    """
    for chain in _TELLING:
        if present := [segment for segment in chain if segment in lengths]:
            return sum(lengths[segment] for segment in present) / sum(
                FRACTIONS[segment] for segment in present
            )
    return None


def measured_person(lengths: Mapping[str, float], stature: float) -> tuple[Body, list[str]]:
    """Return the body with the measured lengths that are within a person's range.

    The names of the segments that keep average proportions are returned too.

    Args:
        lengths: segment -> length [m]; ``ankle_to_toe`` is converted to the foot length that puts
            the body's toe joint there.
        stature: stature estimated from the long segments [m].

    Raises:
        InputError: if the stature is not that of a person.
    """
    lengths = dict(lengths)
    if ankle_to_toe := lengths.pop("ankle_to_toe", None):
        forward, _, down = Body.of_stature(stature).model.site("right_toe").pos
        toe_forward = math.sqrt(max(ankle_to_toe**2 - down**2, 0.0))
        lengths["foot_length"] = FRACTIONS["foot_length"] * stature * toe_forward / forward
    believed = {}
    for segment, length in lengths.items():
        # With a length outside this range, the file's joint is not the anatomical one.
        low, high = believable(segment, stature)
        if low <= length <= high:
            believed[segment] = length
    return Body(stature, believed), sorted(set(lengths) - set(believed))


def _between(centres: Mapping[str, np.ndarray], joint: str) -> np.ndarray | None:
    right, left = centres.get(f"right_{joint}"), centres.get(f"left_{joint}")
    return None if right is None or left is None else (right + left) / 2


def _median_distance(a: np.ndarray, b: np.ndarray) -> float:
    return _median(np.linalg.norm(a - b, axis=1))


def _median(values: np.ndarray) -> float:
    values = values[np.isfinite(values)]
    return float(np.median(values)) if len(values) else 0.0
