"""Whose body is fitted: a stature, a person file, or what the recording itself says.

The recording says something about the lengths between its joints.

A person file is TOML with a stature, measured segment lengths, or both (`ergoqp.human.FRACTIONS`
names the segments; what is not given follows from the stature, and the stature from the lengths)::

    stature = 1.68        # m
    mass = 62             # kg, optional

    [lengths]             # m, optional
    upper_arm = 0.30
    forearm = 0.25
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from numbers import Real
from pathlib import Path
from typing import Any, Final

import numpy as np

from ergoqp.errors import InputError
from ergoqp.files.text import read_toml
from ergoqp.human import FRACTIONS, Body

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

_BELIEVABLE: Final = (
    0.6,
    1.6,
)  # measured over average length; outside, the file's joint is not the anatomical one


def given_person(person: float | str | Path) -> Body:
    """Return the body of a person that the user describes.

    Args:
        person: stature [m], or path of a person file.

    Raises:
        InputError: the value is neither, or the file does not describe a person.
    """
    if isinstance(person, Real) and not isinstance(person, bool):
        return Body.of_stature(_float(person))
    if not isinstance(person, str | Path):
        raise InputError(f"person: got {person!r}, allowed a stature in m, a person file or None")
    path = Path(person)
    entries = read_toml(path, "person file")
    if unknown := set(entries) - {"stature", "mass", "lengths"}:
        raise InputError(
            f"person file {path.name}: got {sorted(unknown)}, allowed stature, mass and the table"
            " lengths"
        )
    lengths = entries.get("lengths", {})
    if not isinstance(lengths, dict) or not (lengths or "stature" in entries):
        raise InputError(
            f"person file {path.name}: got neither, required are a stature in m, a table lengths in"
            " m, or both"
        )
    measured = {name: _number(path, f"lengths.{name}", value) for name, value in lengths.items()}
    mass = _number(path, "mass", entries.get("mass", 0.0))
    try:
        if "stature" not in entries:
            return Body.of_lengths(measured, mass)
        return Body(_number(path, "stature", entries["stature"]), measured, mass)
    except InputError as error:
        raise InputError(
            str(error) if path.name in str(error) else f"person file {path.name}: {error}"
        ) from None


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
    low, high = _BELIEVABLE
    believed = {
        s: length
        for s, length in lengths.items()
        if low <= length / (FRACTIONS[s] * stature) <= high
    }
    return Body(stature, believed), sorted(set(lengths) - set(believed))


def _between(centres: Mapping[str, np.ndarray], joint: str) -> np.ndarray | None:
    right, left = centres.get(f"right_{joint}"), centres.get(f"left_{joint}")
    return None if right is None or left is None else (right + left) / 2


def _median_distance(a: np.ndarray, b: np.ndarray) -> float:
    return _median(np.linalg.norm(a - b, axis=1))


def _median(values: np.ndarray) -> float:
    values = values[np.isfinite(values)]
    return float(np.median(values)) if len(values) else 0.0


def _number(path: Path, name: str, value: Any) -> float:
    number = (
        _float(value)
        if isinstance(value, int | float) and not isinstance(value, bool)
        else math.nan
    )
    if not math.isfinite(number):
        raise InputError(f"person file {path.name}: {name} is {value!r:.40}, allowed a number")
    return number


def _float(value: float | Real) -> float:
    """Return a number; infinity for an integer of hundreds of digits."""
    try:
        return float(value)
    except OverflowError:
        return math.inf
