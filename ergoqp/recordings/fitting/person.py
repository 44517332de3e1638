"""Whose body is fitted, where nobody says: what the recording itself says of the lengths."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Final

import numpy as np

from ergoqp.human import FRACTIONS, Body
from ergoqp.human.body import believable

_TELLING: Final = (("thigh", "shank", "trunk"), ("upper_arm", "forearm"))
"""Segments that tell the stature: those that a person stands up with.

Only without them do the arms tell it, which rigs often shorten.
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
"""Lengths that are the distance of two centres, with both sides where there are two."""


def measured_lengths(centres: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Return the segment lengths between named centres: frame medians, left and right averaged.

    Args:
        centres: centre -> positions (n, 3), any unit; NaN where not seen.

    Returns:
        Segment of `FRACTIONS`, or ``ankle_to_toe`` -> length in the same unit, for those whose ends
        were seen.
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
    """Return the side on which alone a segment is measured; None for both, or one in the middle.

    Args:
        segment: of `FRACTIONS`.
        centres: those that the recording has.
    """
    pairs = _BETWEEN.get("ankle_to_toe" if segment == "foot_length" else segment, ())
    seen = [a for a, b in pairs if a in centres and b in centres]
    return seen[0].partition("_")[0] if len(seen) == 1 < len(pairs) else None


def suggested_stature(lengths: Mapping[str, float]) -> float | None:
    """Return the stature that the long segments suggest, in the unit of the lengths.

    It is None if none of them was measured.

    Their sum counts, not each alone: it does not depend on where along the chain a skeleton puts
    the joints between them.
    """
    for chain in _TELLING:
        if present := [segment for segment in chain if segment in lengths]:
            return sum(lengths[segment] for segment in present) / sum(
                FRACTIONS[segment] for segment in present
            )
    return None


def measured_person(lengths: Mapping[str, float], stature: float) -> tuple[Body, list[str]]:
    """Return the body with the measured lengths that can be a person's.

    The segments left at average proportions are returned too.

    Args:
        lengths: segment -> length [m]; ``ankle_to_toe`` is taken as a foot length that puts the
            body's toe joint there.
        stature: what the long ones suggest [m].

    Raises:
        InputError: the stature is not that of a person.
    """
    lengths = dict(lengths)
    if ankle_to_toe := lengths.pop("ankle_to_toe", None):
        forward, _, down = Body.of_stature(stature).model.site("right_toe").pos
        toe_forward = math.sqrt(max(ankle_to_toe**2 - down**2, 0.0))
        lengths["foot_length"] = FRACTIONS["foot_length"] * stature * toe_forward / forward
    believed = {}
    for segment, length in lengths.items():
        # Outside, the file's joint is not the anatomical one.
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
