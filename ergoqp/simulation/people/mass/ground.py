"""Distribution of the body's push over the corners of soles and seat, within friction."""

from __future__ import annotations

from typing import Final

import daqp
import numpy as np

from ergoqp.simulation.people.mass.table import FRICTION, HABITS
from ergoqp.simulation.people.mass.vectors import cross

_EDGES: Final = np.array(
    [[x, y, 1.0] for x, y in HABITS.grip_used * FRICTION * np.vstack([np.eye(2), -np.eye(2)])]
)
"""Edges of a pyramid within the friction cone (4, 3). Every push is a sum of them."""

_SCALE: Final = np.array([1.0, 1.0, 10.0, 4.0, 4.0, 4.0])
"""Weights of the missing force and torque [1/m].

The weight of the body comes first. If not everything is possible, the trunk rather turns than
the centre of mass is given up.
"""

_SPREAD: Final = 1e-3
"""Cost of force itself: enough that all corners share, and too little to miss the wrench by 1 N."""


def shared(points: np.ndarray, wrench: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """Return the forces (k, 3) [N] at points whose sum is nearest to a wrench.

    No force pulls, and none needs more friction than there is. So if the wrench is not
    possible, the centre of pressure stays at the edge of the support.

    Args:
        points: points relative to the reference of the torque (k, 3) [m].
        wrench: wanted force and torque (6,) [N, N m].
        shares: relative share of each point (k,).
    """
    columns = np.empty((6, len(points), len(_EDGES)))
    columns[:3] = _EDGES.T[:, None]
    columns[3:] = np.moveaxis(cross(points[:, None], _EDGES), -1, 0)
    rows = columns.reshape(6, -1) * _SCALE[:, None]
    size = rows.shape[1]
    hessian = rows.T @ rows
    hessian[np.diag_indices(size)] += np.repeat(_SPREAD / shares, len(_EDGES))
    along = daqp.solve(
        hessian,
        -rows.T @ (_SCALE * wrench),
        np.zeros((0, size)),
        np.full(size, np.inf),
        np.zeros(size),
        np.zeros(size, dtype=np.int32),
    )[0]
    return along.reshape(-1, len(_EDGES)) @ _EDGES
