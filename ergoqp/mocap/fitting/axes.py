"""Unit, axes and lean of a skeleton, and the moment in which the person stands straight.

Conversion of the file's unit and axes to metres with x forward, y left, z up. What the file does
not state is found from the body.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from ergoqp.errors import RecordingError
from ergoqp.joints import SIDES
from ergoqp.mocap.fitting.neutral import first_middle, stands_straight

UNITS: Final[dict[str, float]] = {
    "m": 1.0,
    "cm": 0.01,
    "mm": 0.001,
    "inch": 0.0254,
    "0.056444 m": 0.056444,
}
"""Units of length that recordings use [m]; the last one is that of the CMU database."""

LIKELY_STATURE: Final = (1.4, 2.1)
"""Range of an adult's stature, by which the unit is found [m]."""

UPS: Final = ("x", "y", "z", "-x", "-y", "-z")
"""Vertical axes that a file may have."""

_HIPS: Final = ("right_hip", "left_hip")
_SHOULDERS: Final = ("right_shoulder", "left_shoulder")
_UPPER = (("head",), ("neck",), _SHOULDERS)
_MIDDLE = (_HIPS, ("pelvis",))
_LOWER = (("right_ankle", "left_ankle"), ("right_knee", "left_knee"), *_MIDDLE)
# Smallest mean component along the vertical axis of the unit vectors from the feet to the head and
# to the hips; a single vector with this component is 53 degrees from the axis.
_CLEARLY_UP = 0.6
_IN_LINE: Final = np.cos(np.radians(10))
"""Smallest cosine between trunk and legs of a person who stands upright."""
_TILTED: Final = np.radians(12)
"""Smallest lean of people who stand upright that is taken for a tilt of the camera [rad]."""
_FEW: Final = 5
"""Fewer frames of standing upright than this do not count."""


def find_unit(stature: float, where: str) -> float:
    """Return the size of the only unit that gives the stature of an adult [m].

    Args:
        stature: stature estimated from the bones [file unit].
        where: the file's name, for messages.

    Returns:
        The size of the unit [m].

    Raises:
        RecordingError: if no unit fits, or more than one.
    """
    low, high = LIKELY_STATURE
    fitting = {name: size for name, size in UNITS.items() if low <= stature * size <= high}
    if len(fitting) != 1:
        which = f"none of {', '.join(UNITS)} gives"
        if fitting:
            which = f"several units ({', '.join(fitting)}) give"
        raise RecordingError(
            f"{where}: the unit of length is unknown: the bones correspond to a stature of"
            f" {stature:.4g} file units, and {which} {low} to {high} m; state the unit (unit_to_m)"
        )
    return next(iter(fitting.values()))


def find_up(centres: Mapping[str, np.ndarray]) -> str | None:
    """Return the file's vertical axis, one of `UPS`.

    It is the one along which head and hips are above the feet. The head alone would fail for a
    person who stoops all the time, and the hips alone for a person who squats.

    Args:
        centres: centre -> positions (n, 3) in the file's axes.

    Returns:
        The axis, or None if none clearly points from the feet to the head.
    """
    feet = _middle(centres, _LOWER)
    rise = np.concatenate([_middle(centres, _UPPER) - feet, _middle(centres, _MIDDLE) - feet])
    length = np.linalg.norm(rise, axis=1, keepdims=True)
    direction = rise / np.where(length > 0, length, np.nan)
    # Without legs the hips stand for the feet, and the vector to the hips has no direction.
    seen = np.isfinite(direction).all(axis=1)
    mean = direction[seen].mean(axis=0) if seen.any() else np.zeros(3)
    axis = int(np.argmax(np.abs(mean)))
    if abs(mean[axis]) < _CLEARLY_UP:
        return None
    return ("" if mean[axis] > 0 else "-") + "xyz"[axis]


def axes_of(up: str) -> np.ndarray:
    """Return the rotation (3, 3) from the file's axes to ours.

    In a file with y up, x is left and z is forward for a person who faces along z. A cyclic
    permutation therefore turns its axes into ours. The heading on the floor stays the file's own.

    Args:
        up: the file's vertical axis, one of `UPS`.
    """
    place = "xyz".index(up[-1])
    turn = np.roll(np.eye(3), 2 - place, axis=0)
    # Half a turn about the forward axis exchanges up and down.
    return turn if up == up[-1] else np.diag([1.0, -1.0, -1.0]) @ turn


def leg_of(places: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Return the mean vector from ankle to hip of the legs (n, 3); None without a leg."""
    legs = [
        places[f"{side}_hip"] - places[f"{side}_ankle"]
        for side in SIDES
        if f"{side}_hip" in places and f"{side}_ankle" in places
    ]
    return np.mean(legs, axis=0) if legs else None


def upright_line(places: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Return the direction (3,) of bodies that stand upright, with legs and trunk in line.

    One leg is enough, and the shoulders may replace the neck. None if nobody stands upright, or if
    too little is seen.

    Args:
        places: centre -> positions (n, 3), any unit, along our axes.
    """
    leg = leg_of(places)
    top = first_middle(places, ("neck",), _SHOULDERS)
    hips = first_middle(places, ("pelvis",), _HIPS)
    if leg is None or top is None or hips is None:
        return None
    trunk = top - hips
    size = np.linalg.norm(leg, axis=1) * np.linalg.norm(trunk, axis=1)
    line = (leg * trunk).sum(axis=1) > _IN_LINE * size
    upright = line & stands_straight(places)
    if upright.sum() < _FEW:
        return None
    body = np.median((leg + trunk)[upright], axis=0)
    return body / np.linalg.norm(body)


def tilt_of(line: np.ndarray) -> np.ndarray | None:
    """Return the rotation (3, 3) that makes a direction (3,) vertical; None if it almost is."""
    if np.arccos(np.clip(line[2], -1, 1)) < _TILTED:
        return None
    across = np.cross(line, [0.0, 0.0, 1.0])
    angle = np.arctan2(np.linalg.norm(across), line[2])
    return Rotation.from_rotvec(angle * across / np.linalg.norm(across)).as_matrix()


def _middle(centres: Mapping[str, np.ndarray], choices: tuple[tuple[str, ...], ...]) -> np.ndarray:
    """Return the middle of the first group of which at least one centre exists."""
    # There is such a group: recordings without pelvis or upper trunk have been refused before.
    group = next(group for group in choices if any(name in centres for name in group))
    return np.mean([centres[name] for name in group if name in centres], axis=0)
