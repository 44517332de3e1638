"""Closed-form kinematics of the right arm on the trunk.

It gives elbow and wrist of a posture, and the postures of a given elbow and wrist.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ergoqp.coordinates import FOREARM
from ergoqp.human import Body, Kinematics
from ergoqp.joints import INDEX, JOINTS
from ergoqp.sheets.angles import read_postures

Array = NDArray[np.float64]

ARM_JOINTS: Final[tuple[str, ...]] = (
    "trunk_flexion",
    "trunk_side_bend",
    "trunk_twist",
    "right_shoulder_flexion",
    "right_shoulder_abduction",
    "right_shoulder_rotation",
    "right_elbow_flexion",
)
"""The joints that elbow and wrist depend on, in the order of the solutions of `Arm`."""

ARM_INDEX: Final[list[int]] = [INDEX[joint] for joint in ARM_JOINTS]
"""Position of each of `ARM_JOINTS` in a posture."""


class Arm:
    """Lengths of a person's right arm on the trunk, and its inverse kinematics.

    Args:
        body: the person.

    Attributes:
        root: origin of the trunk's hinges, in the pelvis frame (3,) [m].
        shoulder: shoulder centre in the trunk frame (3,) [m].
        upper: distance from the shoulder to the elbow [m].
        fore: distance from the elbow to the wrist [m].
    """

    def __init__(self, body: Body) -> None:
        """Read the loaded model."""
        model = body.model
        self.root, self.shoulder, *bones = (
            np.asarray(model.body(name).pos)
            for name in (
                "trunk_flexion",
                "right_shoulder_flexion",
                "right_elbow_flexion",
                "right_wrist_flexion",
            )
        )
        self.upper, self.fore = (float(np.linalg.norm(bone)) for bone in bones)

    def solve_by_bend(self, points: Array, bend: Array, twist: Array) -> tuple[Array, Array]:
        """Return all postures of trunk and right arm with given points, side bends and twists.

        The distance from the shoulder to the elbow must be one upper arm. With side bend and
        twist given, this is a cos f + b sin f = c for the flexion f of the trunk, with two
        roots. Then shoulder and elbow follow from the two directions. The intrinsic angles of
        the shoulder have two solutions too.

        Args:
            points: elbow and wrist in the pelvis frame (n, 6) [m].
            bend: side bends of the trunk (n, m) [rad].
            twist: twists of the trunk (n, m) [rad].

        Returns:
            Angles in the order of `ARM_JOINTS` (7, n, 4 m) [rad], and by how much a root is
            missed (n, 4 m), without a unit; 0 where there is a root.
        """
        (x, y, z), wrist = self._elbow_and_forearm(points)
        sx, sy, sz = _bend(bend, *_twist(twist, *self.shoulder))
        c = (self.shoulder @ self.shoulder + x * x + y * y + z * z - self.upper**2) / 2 - y * sy
        flexion, missing = _roots(x * sx + z * sz, x * sz - z * sx, c)
        flexion, bend, twist = _wrap(flexion), _twice(bend), _twice(twist)
        dx, dy, dz = (
            e - s
            for e, s in zip(_into_trunk(flexion, bend, twist, x, y, z), self.shoulder, strict=True)
        )
        abduction, shoulder = np.arctan2(-dy, np.hypot(dx, dz)), np.arctan2(dx, -dz)
        trunk = _twice(flexion), _twice(bend), _twice(twist)
        shoulder = np.hstack([shoulder, _wrap(shoulder + np.pi)])
        abduction = np.hstack([abduction, np.pi - abduction])
        return self._whole(wrist, trunk, shoulder, abduction), _twice(missing)

    def solve_by_shoulder(
        self, points: Array, shoulder: Array, twist: Array
    ) -> tuple[Array, Array]:
        """Return all postures of trunk and right arm at given points, shoulder flexions and twists.

        Near 90 deg of abduction the flexion of the shoulder changes fast with the trunk, so
        here it is given. The distance of the elbow from the pelvis gives the abduction (two
        roots). The y coordinate of the elbow gives the side bend (two roots). The rest
        follows.

        Args:
            points: elbow and wrist in the pelvis frame (n, 6) [m].
            shoulder: flexions of the right shoulder (n, m) [rad].
            twist: twists of the trunk (n, m) [rad].

        Returns:
            As `solve_by_bend`.
        """
        (x, y, z), wrist = self._elbow_and_forearm(points)
        c = (x * x + y * y + z * z - self.shoulder @ self.shoulder - self.upper**2) / (
            2 * self.upper
        )
        forward = self.shoulder[0] * np.sin(shoulder) - self.shoulder[2] * np.cos(shoulder)
        abduction, no_abduction = _roots(forward, np.full_like(forward, -self.shoulder[1]), c)
        shoulder, twist = _twice(shoulder), _twice(twist)
        cos_a = np.cos(abduction)
        arm = np.sin(shoulder) * cos_a, -np.sin(abduction), -np.cos(shoulder) * cos_a
        vx, vy, vz = _twist(
            twist, *(s + self.upper * d for s, d in zip(self.shoulder, arm, strict=True))
        )
        bend, no_bend = _roots(vy, vz, y)
        vx, vy, vz = _bend(bend, _twice(vx), _twice(vy), _twice(vz))
        trunk = np.arctan2(x * vz - z * vx, x * vx + z * vz), _wrap(bend), _twice(twist)
        shoulder, abduction = _twice(shoulder), _wrap(_twice(abduction))
        missing = _twice(no_abduction) + no_bend
        return self._whole(wrist, trunk, shoulder, abduction), missing

    def _elbow_and_forearm(self, points: Array) -> tuple[Array, Array]:
        """Return the elbow from the trunk's root and the wrist from the elbow, (3, n, 1) each."""
        return np.moveaxis(points[:, None, :3] - self.root, -1, 0), np.moveaxis(
            points[:, None, 3:] - points[:, None, :3], -1, 0
        )

    def _whole(
        self, forearm: Array, trunk: tuple[Array, Array, Array], shoulder: Array, abduction: Array
    ) -> Array:
        """Return all angles, with upper arm and elbow turned to a direction of the forearm."""
        gx, gy, gz = _into_trunk(*trunk, *forearm)
        # Into the frame of the upper arm before its own rotation: back by the flexion (about
        # -y), then by the abduction (about -x).
        sin_f = np.sin(shoulder)
        cos_f = np.cos(shoulder)
        sin_a = np.sin(abduction)
        cos_a = np.cos(abduction)
        gx, gz = cos_f * gx + sin_f * gz, cos_f * gz - sin_f * gx
        gy, gz = cos_a * gy - sin_a * gz, sin_a * gy + cos_a * gz
        away = np.hypot(gx, gy)
        # With a straight elbow the rotation is free.
        rotation = np.where(away > 1e-9 * self.fore, np.arctan2(gy, gx), 0.0)
        return np.stack([*trunk, shoulder, abduction, rotation, np.arctan2(away, -gz)])


def forearm_length(body: Body | None = None) -> float:
    """Return the distance of the wrist from the elbow [m]."""
    return Arm(body or Body()).fore


def forearm_points(postures: ArrayLike, body: Body | None = None) -> Array:
    """Return elbow and wrist of the right arm in the pelvis frame, shape (n, 6) [m].

    Args:
        postures: shape (n, 32) or (32,) [rad].
        body: the person; default: the nominal one.
    """
    rows = read_postures(postures)
    if not len(rows):
        return np.empty((0, len(FOREARM)))
    body = body or Body()
    function = _forward(body.stature, tuple(body.lengths.items()))
    return np.array(function.map(len(rows))(rows.T)).T


@lru_cache(maxsize=8)
def _forward(stature: float, lengths: tuple[tuple[str, float], ...]) -> ca.Function:
    """Return ``posture (32,) -> points (6,)`` of a body.

    The key of the cache is only what affects the points, so not the mass.
    """
    kinematics = Kinematics(Body(stature, dict(lengths)))
    q = ca.SX.sym("q", len(JOINTS))
    points = (kinematics.at(f"right_{name}", q)[0] for name in ("elbow", "wrist"))
    return ca.Function("forearm", [q], [ca.cse(ca.vertcat(*points))])


def _wrap(angle: Array) -> Array:
    return (angle + np.pi) % (2 * np.pi) - np.pi


def _twice(values: Array) -> Array:
    return np.concatenate([values, values], axis=1)


def _roots(a: Array, b: Array, c: Array) -> tuple[Array, Array]:
    """Return both roots (n, 2 m) of a cos t + b sin t = c, and by how much a root is missed.

    Without a root, the nearest value is returned.
    """
    ratio = c / np.maximum(np.hypot(a, b), 1e-12)
    middle, half = np.arctan2(b, a), np.arccos(np.clip(ratio, -1, 1))
    return np.concatenate([middle + half, middle - half], axis=1), _twice(
        np.maximum(np.abs(ratio) - 1, 0)
    )


def _twist(angle: Array, x: Array, y: Array, z: Array) -> tuple[Array, Array, Array]:
    """Rotate a vector about z."""
    return np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y, z


def _bend(angle: Array, x: Array, y: Array, z: Array) -> tuple[Array, Array, Array]:
    """Rotate a vector about -x."""
    return x, np.cos(angle) * y + np.sin(angle) * z, np.cos(angle) * z - np.sin(angle) * y


def _into_trunk(
    flexion: Array, bend: Array, twist: Array, x: Array, y: Array, z: Array
) -> tuple[Array, Array, Array]:
    """Return a vector of the pelvis frame in the axes of the trunk."""
    x, z = np.cos(flexion) * x - np.sin(flexion) * z, np.sin(flexion) * x + np.cos(flexion) * z
    return _twist(-twist, *_bend(-bend, x, y, z))
