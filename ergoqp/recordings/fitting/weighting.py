"""What counts in a fit: the place of every joint centre and the direction of every bone.

A joint's own calm counts weakly.

A person's shoulders and hips move in ways that the body has no joints for. With places alone the
limbs would turn to make up for it, and the angles are what a posture is scored by; so each bone, as
a vector, counts beside the places of its ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from ergoqp.joints import JOINTS, SIDES

_BONES: Final[tuple[tuple[tuple[str, ...], str], ...]] = (
    (("right_hip", "left_hip"), "neck"),
    (("neck",), "head"),
    (("head",), "head_top"),
    (("right_shoulder",), "left_shoulder"),
    (("right_hip",), "left_hip"),
    *(
        ((f"{side}_{start}",), f"{side}_{end}")
        for side in SIDES
        for start, end in (
            ("shoulder", "elbow"),
            ("elbow", "wrist"),
            ("wrist", "knuckles"),
            ("hip", "knee"),
            ("knee", "ankle"),
            ("ankle", "toe"),
        )
    ),
)
"""From the middle of some centres to another."""

_BONE_WEIGHT: Final = 2.0  # twice what a centre counts
_TRUNK_WEIGHT: Final = (
    8.0  # the shoulders pull at the trunk from both sides, and every arm angle is measured from it
)


# A turn about the own axis of a limb shows only in what is bent beyond it, and a limb measured as
# bent slightly the wrong way would throw it over to the other end of its range. These pulls decide
# such cases and give way elsewhere: at an elbow bent by 30 degrees the pull takes 1 % of the
# shoulder's rotation, at 90 degrees 0.3 %.
_CALM: Final[dict[str, tuple[float, float]]] = {
    "shoulder_rotation": (0.02, 0.01),
    "hip_rotation": (0.01, 0.01),
    "ankle_inversion": (0.008, 0.015),
}
_PULLS: Final = [_CALM.get(joint.partition("_")[2], (0.001, 0.004)) for joint in JOINTS]

PULL_NEUTRAL: Final = np.array([neutral for neutral, _ in _PULLS])
"""How hard each joint is drawn to zero (32,) [m/rad]: like a centre on a lever of this length."""

PULL_PREVIOUS: Final = np.array([previous for _, previous in _PULLS])
"""How hard each joint is drawn to the frame before, shape (32,) [m/rad]."""


def weight_matrix(centres: Sequence[str], seen: np.ndarray) -> np.ndarray:
    """Return the matrix M of the squared residual r' M r over the seen centres, shape (3 k, 3 k).

    Args:
        centres: names of the centres, length m.
        seen: which of them are measured, shape (m,) bool with k true.
    """
    present = [name for name, is_seen in zip(centres, seen, strict=True) if is_seen]
    matrix = np.eye(len(present))
    for starts, end in _BONES:
        if end in present and all(start in present for start in starts):
            row = np.zeros(len(present))
            row[present.index(end)] = 1.0
            row[[present.index(start) for start in starts]] = -1.0 / len(starts)
            matrix += (_TRUNK_WEIGHT if end == "neck" else _BONE_WEIGHT) * np.outer(row, row)
    return np.kron(matrix, np.eye(3))
