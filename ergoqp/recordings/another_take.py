"""Check of another recording in which the same person should stand straight."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.joints import SIDES
from ergoqp.recordings.fitting.neutral import stands_straight
from ergoqp.recordings.fitting.person import measured_lengths

_SIMILAR: Final = math.log(1.15)
"""Largest log ratio of a segment's proportions between two recordings of the same person."""
_STANDS: Final = math.radians(12)
"""Largest lean of the straight legs of a person who stands [rad]."""


def check_same_person(
    where: str, own: Mapping[str, np.ndarray], other: Mapping[str, np.ndarray], unit: float | None
) -> None:
    """Raise if the skeletons of two recordings have different proportions.

    Args:
        where: the recording's name, for messages.
        own: centre -> positions (n, 3) [m].
        other: the same of the other recording, in its unit.
        unit: that unit [m]; None if it is unknown.

    Raises:
        RecordingError: if they differ, with the segment that differs most.
    """
    mine, theirs = measured_lengths(own), measured_lengths(other)
    both = [name for name in mine if name in theirs]
    if len(both) < 3:
        return
    ratios = np.array([math.log(theirs[name] / mine[name]) for name in both])
    off = np.abs(ratios - np.median(ratios))
    # One segment may be measured badly in one of the recordings.
    if np.sort(off)[-2] <= _SIMILAR:
        return
    worst = both[int(np.argmax(off))]
    sizes = f"{100 * (math.exp(off.max()) - 1):.0f} % off"
    if unit is not None:
        sizes += f": {mine[worst]:.2f} m here, {unit * theirs[worst]:.2f} m there"
    raise RecordingError(
        f"{where}: neutral: got a skeleton with other proportions ({worst.replace('_', ' ')}"
        f" {sizes}), allowed that of the same person, a time of this recording, or vertical"
    )


def check_stands(where: str, places: Mapping[str, np.ndarray]) -> None:
    """Raise if the straight legs of another recording are not vertical.

    Args:
        where: the recording's name, for messages.
        places: centre -> positions (n, 3), along our axes as they are in the first recording.

    Raises:
        RecordingError: if they are not: the person leans as a whole there, or the camera's tilt is
            another.
    """
    stands = stands_straight(places)
    legs = [
        places[f"{side}_hip"] - places[f"{side}_ankle"]
        for side in SIDES
        if f"{side}_hip" in places and f"{side}_ankle" in places
    ]
    if not legs or not stands.any():
        return
    leg = np.nanmedian(np.mean(legs, axis=0)[stands], axis=0)
    angle = math.acos(float(np.clip(leg[2] / np.linalg.norm(leg), -1, 1)))
    if angle > _STANDS:
        raise RecordingError(
            f"{where}: neutral: got a recording in which straight legs lean by"
            f" {math.degrees(angle):.0f} deg to this one's vertical axis, allowed one with the same"
            " camera and the same axes"
        )
