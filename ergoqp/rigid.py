"""Rigid motion as expressions: turning by a rotation vector, and how far a matrix is from a rotation."""

from __future__ import annotations

import casadi as ca


def exp_rotation(pose: ca.SX, displacement: ca.SX) -> ca.SX:
    """Return `pose` (4, 4) moved by a world-aligned displacement (6,): shifted by its first three, turned by its last three.

    The rotation is the exact exponential; one Newton step keeps it orthonormal over any number of periods.
    """
    turn = displacement[3:]
    angle = ca.sqrt(ca.sumsqr(turn) + 1e-30)
    cross = ca.skew(turn)
    rotation = ca.SX.eye(3) + ca.sin(angle) / angle * cross + (2 * ca.sin(angle / 2) ** 2) / angle**2 * (cross @ cross)
    turned = rotation @ pose[:3, :3]
    turned = 1.5 * turned - 0.5 * turned @ (turned.T @ turned)
    bottom = ca.SX([[0, 0, 0, 1]])
    return ca.vertcat(ca.horzcat(turned, pose[:3, 3] + displacement[:3]), bottom)


def rotation_error(rotation: ca.SX) -> ca.SX:
    """Return how far a 3 x 3 matrix is from a rotation: the largest entry of R'R - I, or 2 for a mirror; NaN stays NaN."""
    apart = ca.mmax(ca.fabs(ca.reshape(rotation.T @ rotation - ca.SX.eye(3), 9, 1)))
    return ca.if_else(ca.det(rotation) < 0, 2.0, apart)
