"""Postures to start a fit from when there is no frame before.

They are upright and stooped, with the arms in their usual places.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import product
from typing import Final

import numpy as np

from ergoqp.joints import INDEX, SIDES
from ergoqp.recordings.fitting.centre_model import BASE, UNKNOWNS, CentreModel

_ARMS: Final[tuple[Mapping[str, float], ...]] = (
    {"shoulder_flexion": 20, "shoulder_abduction": 10, "elbow_flexion": 20},
    {"shoulder_flexion": 10, "shoulder_abduction": 80, "elbow_flexion": 10},
    {"shoulder_flexion": 80, "shoulder_abduction": 10, "elbow_flexion": 60},
    {"shoulder_flexion": 150, "shoulder_abduction": 10, "elbow_flexion": 20},
)
_TRUNK_FLEXION: Final = (5, 60)
_PRONATION: Final = (-45, 45)
_LEGS: Final[Mapping[str, float]] = {"hip_flexion": 15, "knee_flexion": 25}


def starts(model: CentreModel, target: np.ndarray, seen: np.ndarray) -> Iterator[np.ndarray]:
    """Yield configurations (36,) with the pelvis placed and headed like the measured centres.

    Args:
        model: the body's centres.
        target: measured positions, shape (m, 3) [m].
        seen: which of them are measured, shape (m,) bool.
    """
    place = {name: target[i] for i, name in enumerate(model.centres) if seen[i]}
    heading = _heading(place)
    for trunk, arms, pronation in product(_TRUNK_FLEXION, _ARMS, _PRONATION):
        z = np.zeros(UNKNOWNS)
        z[BASE + INDEX["trunk_flexion"]] = np.radians(trunk)
        for side in SIDES:
            for joint, angle in {**arms, **_LEGS, "forearm_pronation": pronation}.items():
                z[BASE + INDEX[f"{side}_{joint}"]] = np.radians(angle)
        z[3] = heading
        z[:3] = (target[seen] - model(z)[0][seen]).mean(axis=0)
        yield z


def _heading(place: Mapping[str, np.ndarray]) -> float:
    """Return the yaw [rad] at which the body's left is where the recording has it.

    It is 0 when no pair of sides is seen.
    """
    for joint in ("hip", "shoulder", "knee", "elbow", "ankle", "wrist"):
        if f"right_{joint}" in place and f"left_{joint}" in place:
            left = place[f"left_{joint}"] - place[f"right_{joint}"]
            return float(np.arctan2(-left[0], left[1]))
    return 0.0
