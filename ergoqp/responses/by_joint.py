"""Values by the name of a joint, with the default weights and comfort angles of a person."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from ergoqp.errors import InputError
from ergoqp.joints import INDEX, JOINTS, SIDES

DEFAULT_WEIGHTS: Final[dict[str, float]] = {
    "trunk_flexion": 3.5,
    "trunk_side_bend": 8.0,
    "trunk_twist": 5.0,
    "shoulder_flexion": 1.0,
    "shoulder_abduction": 3.0,
    "shoulder_rotation": 0.8,
    "elbow_flexion": 0.6,
    "forearm_pronation": 0.4,
    "wrist_flexion": 1.0,
    "wrist_deviation": 1.5,
    "hip_flexion": 2.0,
    "hip_abduction": 5.0,
    "hip_rotation": 5.0,
    "knee_flexion": 3.5,
    "ankle_flexion": 3.0,
    "ankle_inversion": 5.0,
}
"""Relative cost of moving each joint, the same on both sides.

The trunk carries half of the body; the forearm carries little.
"""

DEFAULT_COMFORT_DEG: Final[dict[str, dict[str, float]]] = {
    "standing": {"hip_flexion": 4.0, "knee_flexion": 8.0, "ankle_flexion": 4.0},
    "seated": {"hip_flexion": 85.0, "knee_flexion": 85.0},
}
"""Comfort angles of the legs if a problem does not give them [deg].

People do not stand with locked knees, and locked knees cannot follow.
"""


def per_joint(
    given: Mapping[str, float], defaults: Mapping[str, float], rest: float, what: str
) -> np.ndarray:
    """Return one value per joint (32,) from values by name.

    A name without a side means both sides.

    Raises:
        InputError: if a name is not the name of a joint.
    """
    values = np.full(len(JOINTS), rest)
    for table in (defaults, given):
        # Names with a side come last. So they override the name of both sides in any order.
        for name in sorted(table, key=lambda key: key in INDEX):
            targets = [name] if name in INDEX else [f"{side}_{name}" for side in SIDES]
            if any(target not in INDEX for target in targets):
                raise InputError(
                    f"{what}: got {name!r}, allowed a joint such as 'trunk_flexion' or"
                    " 'elbow_flexion'"
                )
            for target in targets:
                values[INDEX[target]] = table[name]
    return values
