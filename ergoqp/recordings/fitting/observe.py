"""Which joints a set of centres can tell at all: a question of rank, at generic postures."""

from __future__ import annotations

from typing import Final

import numpy as np

from ergoqp.joints import INDEX, JOINTS, LOWER, UPPER
from ergoqp.recordings.fitting.centre_model import BASE, CentreModel

_PROBES: Final = 4
# m/rad beyond what the joints before it can do; less is lost in the noise of any recording
_LEAST_MOTION: Final = 0.005

# The axial rotations come last: when a point too few is there to tell, it is they that stay open,
# and the bends are told.
_AXIAL: Final = tuple(
    name for name in JOINTS if name.endswith(("twist", "rotation", "pronation", "inversion"))
)
_ORDER: Final = tuple(INDEX[name] for name in (*(n for n in JOINTS if n not in _AXIAL), *_AXIAL))


def observable_joints(model: CentreModel, seen: np.ndarray) -> np.ndarray:
    """Return which joints the seen centres determine, shape (32,) bool.

    A joint counts when it moves the centres in a way that the pelvis and the joints counted before
    it cannot; bends are asked before turns about the own axis. Postures inside the ranges stand for
    all: at special ones (a straight elbow) a joint that counts may still be lost for a moment.

    Args:
        model: the body's centres.
        seen: which of the model's centres the recording holds, shape (m,) bool.
    """
    rows = np.repeat(seen, 3)
    observed = np.zeros(len(JOINTS), dtype=bool)
    generator = np.random.default_rng(0)
    for _ in range(_PROBES):
        z = np.concatenate(
            [np.zeros(BASE), LOWER + (UPPER - LOWER) * generator.uniform(0.25, 0.75, len(JOINTS))]
        )
        jacobian = model(z)[1][rows]
        basis: list[np.ndarray] = []
        for column in (*range(BASE), *(BASE + joint for joint in _ORDER)):
            left = jacobian[:, column].copy()
            for _ in range(2):  # the second pass removes what rounding left of the first
                for direction in basis:
                    left -= (direction @ left) * direction
            length = float(np.linalg.norm(left))
            if length > _LEAST_MOTION:
                basis.append(left / length)
                if column >= BASE:
                    observed[column - BASE] = True
    return observed
