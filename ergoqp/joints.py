"""The 32 joints of the person: names, order, ranges and signs.

All other modules of the package may use this one.

Zero is upright with hanging arms and palms to the thighs. Positive is flexion, bending and
twisting to the left, abduction, inward rotation, pronation and ulnar deviation. The two sides
of the body share signs (anatomical, not geometric). Hinges are intrinsic rotations in the
order listed. The first one is proximal.

Ranges are a box of active ranges of motion: AAOS and five adult studies as tabulated in F.A.
Davis, appendix A.1, rounded to what healthy adults reach. Trunk values are for the whole spine
including the pelvis. The pelvis is upright by definition, so a stoop from the hips counts as
trunk flexion.
"""

from __future__ import annotations

from typing import Final

import numpy as np

SIDES: Final = ("right", "left")

_TRUNK_AND_NECK = (
    ("trunk_flexion", -30, 110),
    ("trunk_side_bend", -40, 40),
    ("trunk_twist", -45, 45),
    ("neck_flexion", -50, 60),
    ("neck_side_bend", -35, 35),
    ("neck_twist", -70, 70),
)
_ARM = (
    ("shoulder_flexion", -60, 175),
    ("shoulder_abduction", -45, 175),
    ("shoulder_rotation", -90, 90),
    ("elbow_flexion", 0, 150),
    ("forearm_pronation", -85, 85),
    ("wrist_flexion", -70, 75),
    ("wrist_deviation", -25, 35),
)
_LEG = (
    ("hip_flexion", -30, 125),
    ("hip_abduction", -30, 45),
    ("hip_rotation", -45, 45),
    ("knee_flexion", 0, 145),
    ("ankle_flexion", -50, 35),
    ("ankle_inversion", -30, 35),
)
_TABLE = (
    *_TRUNK_AND_NECK,
    *((f"{side}_{name}", low, high) for side in SIDES for name, low, high in _ARM),
    *((f"{side}_{name}", low, high) for side in SIDES for name, low, high in _LEG),
)

JOINTS: Final[tuple[str, ...]] = tuple(name for name, _, _ in _TABLE)
"""The 32 joint names, in the order of every posture vector.

Source:
    The ranges of the joints are those of AAOS and of five adult studies, as tabulated in F. A.
    Davis, appendix A.1.

Example:
    >>> from ergoqp import JOINTS
    >>> len(JOINTS), JOINTS[0], JOINTS.index("right_elbow_flexion")
    (32, 'trunk_flexion', 9)
"""

UPPER_BODY: Final[tuple[str, ...]] = JOINTS[:20]
"""Trunk, neck and both arms."""

INDEX: Final[dict[str, int]] = {name: i for i, name in enumerate(JOINTS)}
"""Position of each joint in a posture, by its name.

Example:
    >>> from ergoqp.joints import INDEX
    >>> INDEX["neck_flexion"]
    3
"""

LOWER: Final[np.ndarray] = np.radians([low for _, low, _ in _TABLE])
"""Lower end of each joint's range, shape (32,) [rad]."""

UPPER: Final[np.ndarray] = np.radians([high for _, _, high in _TABLE])
"""Upper end of each joint's range, shape (32,) [rad]."""

LOWER.setflags(write=False)
UPPER.setflags(write=False)


def spoken(joint: str) -> str:
    """Return the name of a joint with spaces, for example ``"left elbow flexion"``."""
    return joint.replace("_", " ")
