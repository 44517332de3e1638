"""Rigid motion as expressions: turning by a rotation vector, and how far a matrix is from a rotation."""

from __future__ import annotations

import casadi as ca


def exp_rotation(pose: ca.SX, displacement: ca.SX) -> ca.SX:
    """Return `pose` (4, 4) moved by a world-aligned displacement (6,), for any number of times: it stays orthonormal."""
    moved = shifted(pose, displacement)
    rotation = moved[:3, :3]
    # One Newton step.
    moved[:3, :3] = 1.5 * rotation - 0.5 * rotation @ (rotation.T @ rotation)
    return moved


def shifted(pose: ca.SX, displacement: ca.SX) -> ca.SX:
    """Return `pose` (4, 4) shifted by the first three of a world-aligned displacement (6,) and turned by its last three.

    The rotation is the exact exponential.
    """
    bottom = ca.SX([[0, 0, 0, 1]])
    return ca.vertcat(ca.horzcat(turned(displacement[3:], pose[:3, :3]), pose[:3, 3] + displacement[:3]), bottom)


def turned(turn: ca.SX, vectors: ca.SX) -> ca.SX:
    """Return vectors (3, n) turned by a rotation vector (3,) [rad]."""
    angle = ca.sqrt(ca.sumsqr(turn) + 1e-30)
    cross = ca.skew(turn)
    rotation = ca.SX.eye(3) + ca.sin(angle) / angle * cross + (2 * ca.sin(angle / 2) ** 2) / angle**2 * (cross @ cross)
    return rotation @ vectors


def rotation_error(rotation: ca.SX) -> ca.SX:
    """Return how far a 3 x 3 matrix is from a rotation: the largest entry of R'R - I, or 2 for a mirror and for NaN."""
    apart = ca.mmax(ca.fabs(ca.reshape(rotation.T @ rotation - ca.SX.eye(3), 9, 1)))
    # mmax drops NaN; a determinant keeps it, and NaN is not above zero either.
    return ca.if_else(ca.det(rotation) > 0, apart, 2.0)


def is_rigid(pose: ca.SX) -> ca.SX:
    """Return whether a matrix (4, 4) is a rigid motion, finite and within 100 m."""
    bottom = ca.sumsqr(pose[3, :] - ca.DM([[0, 0, 0, 1]])) < 1e-6
    return ca.logic_and(ca.logic_and(rotation_error(pose[:3, :3]) < 1e-3, bottom), ca.sumsqr(pose[:3, 3]) < 1e4)
