"""How the corners of soles and seat share what the body pushes with, as floor and friction let."""

from __future__ import annotations

from typing import Final

import daqp
import numpy as np

from ergoqp.simulation.people.mass.table import FRICTION, HABITS
from ergoqp.simulation.people.mass.vectors import cross

_EDGES: Final = np.array(
    [[x, y, 1.0] for x, y in HABITS.grip_used * FRICTION * np.vstack([np.eye(2), -np.eye(2)])]
)
"""Of a pyramid within the cone of friction (4, 3): any push is a sum of these."""

_SCALE: Final = np.array([1.0, 1.0, 10.0, 4.0, 4.0, 4.0])
"""What is missing counts, by force and by torque [1/m]: the body is carried above all, and where
the rest cannot all be had, the trunk rather turns than that the centre of mass is let go."""

_SPREAD: Final = 1e-3
"""What force itself costs: enough that all corners share, too little to miss the wrench by 1 N."""


def shared(points: np.ndarray, wrench: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """Return the forces (k, 3) [N] at points whose sum is nearest to a wrench.

    None pulls, and none asks for more friction than there is. So where the wrench cannot be had,
    the centre of pressure stays at the edge of what carries.

    Args:
        points: from where the torque counts (k, 3) [m].
        wrench: force and torque that are wanted (6,) [N, N m].
        shares: how much rather a point carries than others (k,).
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
