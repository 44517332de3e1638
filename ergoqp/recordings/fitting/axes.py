"""From the file's unit and axes to metres with x forward, y left, z up.

What the file does not state is found from the body.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from ergoqp.errors import RecordingError

UNITS: Final[dict[str, float]] = {
    "m": 1.0,
    "cm": 0.01,
    "mm": 0.001,
    "inch": 0.0254,
    "0.056444 m": 0.056444,
}
"""Units of length that recordings come in [m]; the last one is that of the CMU database."""

LIKELY_STATURE: Final = (1.4, 2.1)
"""The statures that tell which unit is meant [m]."""

_UPPER = (("head",), ("neck",), ("right_shoulder", "left_shoulder"))
_MIDDLE = (("right_hip", "left_hip"), ("pelvis",))
_LOWER = (("right_ankle", "left_ankle"), ("right_knee", "left_knee"), *_MIDDLE)
# mean component of the unit vectors from the feet to the head and to the hips: 53 degrees from the
# axis
_CLEARLY_UP = 0.6


def find_unit(stature: float, where: str) -> float:
    """Return the only unit that makes the stature that of an adult.

    Args:
        stature: stature that the bones suggest [file unit].
        where: the file's name, for messages.

    Returns:
        The size of the unit [m].

    Raises:
        RecordingError: no unit fits, or more than one.
    """
    low, high = LIKELY_STATURE
    fitting = {name: size for name, size in UNITS.items() if low <= stature * size <= high}
    if len(fitting) != 1:
        which = (
            f"several units ({', '.join(fitting)}) give"
            if fitting
            else f"none of {', '.join(UNITS)} gives"
        )
        raise RecordingError(
            f"{where}: the unit of length is not known: the bones suggest a stature of"
            f" {stature:.4g} file units, and {which} {low} to {high} m; state the unit (unit_to_m)"
        )
    return next(iter(fitting.values()))


def find_up(centres: Mapping[str, np.ndarray]) -> str | None:
    """Return the file's vertical axis, ``"y"`` or ``"z"``.

    It is the one along which head and hips are above the feet.

    The head alone would not do for a person who stoops all the time, nor the hips for one who
    squats.

    Args:
        centres: centre -> positions (n, 3) in the file's axes.

    Returns:
        The axis, or None when neither clearly points from the feet to the head.
    """
    feet = _middle(centres, _LOWER)
    rise = np.concatenate([_middle(centres, _UPPER) - feet, _middle(centres, _MIDDLE) - feet])
    length = np.linalg.norm(rise, axis=1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        direction = rise / length
    seen = np.isfinite(direction).all(
        axis=1
    )  # without legs the hips are the feet, and have no direction
    mean = direction[seen].mean(axis=0) if seen.any() else np.zeros(3)
    axis = 1 + int(np.argmax(mean[1:]))
    return "xyz"[axis] if mean[axis] >= _CLEARLY_UP else None


def to_world(positions: np.ndarray, unit: float, up: str) -> np.ndarray:
    """Return positions (..., 3) in metres, x forward, y left, z up.

    A file with y up has x to the left and z forward for a person who faces along z, so its axes
    turn into ours by moving on one place; the heading within the floor is the file's own.

    Args:
        positions: shape (..., 3) [file unit].
        unit: size of the file's unit [m].
        up: the file's vertical axis, ``"y"`` or ``"z"``.
    """
    return unit * (positions[..., [2, 0, 1]] if up == "y" else positions)


def _middle(centres: Mapping[str, np.ndarray], choices: tuple[tuple[str, ...], ...]) -> np.ndarray:
    """Return the middle of the first group of which anything is there."""
    # There is one: the namings refuse a recording without pelvis or upper trunk.
    group = next(group for group in choices if any(name in centres for name in group))
    return np.mean([centres[name] for name in group if name in centres], axis=0)
