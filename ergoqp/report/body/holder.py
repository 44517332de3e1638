"""The robot in a replay: a sketch of an arm with two links on a post, solved in the plane.

It shows that a robot holds the object and from where. It does not show a particular robot,
because a problem does not describe one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ergoqp.report.body.coarse import coarse

_COLOUR: Final = (196, 201, 207)
_JOINT_COLOUR: Final = (120, 130, 142)
_RADIUS: Final = 0.024
"""Radius of the links [m]."""

_FLANGE: Final = 0.17
"""Distance from the contact along the tool axis to the end of the arm [m], behind the box."""

_BEHIND: Final = 0.55
"""Distance of the post from the middle of the object's path [m], on the far side of the person."""

_ASIDE: Final = 0.7
"""Angle of the post to the person's left, as seen from the object [rad]."""

_SLACK: Final = 1.08
"""Total length of the links, relative to the length needed."""


@dataclass(frozen=True)
class Arm:
    """One frame of the sketch: positions of shoulder, elbow and flange (3,) each [m]."""

    shoulder: NDArray[np.float64]
    elbow: NDArray[np.float64]
    flange: NDArray[np.float64]


def arm_of(poses: NDArray[np.float64], person: NDArray[np.float64]) -> list[Arm]:
    """Return the arm for every pose of the object (n, 4, 4).

    Args:
        poses: poses of the object's contact frame.
        person: position of the person on the floor (2,) [m].
    """
    flanges = poses[:, :3, 3] + _FLANGE * poses[:, :3, 0]
    middle = flanges.mean(axis=0)
    away = middle[:2] - person
    away /= max(float(np.linalg.norm(away)), 1e-9)
    # Move it to the left, so that it is not between person and camera.
    cosine, sine = np.cos(_ASIDE), np.sin(_ASIDE)
    away = np.array([[cosine, -sine], [sine, cosine]]) @ away
    shoulder = np.array([*(middle[:2] + _BEHIND * away), middle[2] - 0.05])
    reach = float(np.linalg.norm(flanges - shoulder, axis=1).max()) * _SLACK / 2
    return [Arm(shoulder, _elbow(shoulder, flange, reach), flange) for flange in flanges]


def _elbow(
    shoulder: NDArray[np.float64], flange: NDArray[np.float64], link: float
) -> NDArray[np.float64]:
    """Return the elbow of two equal links, bent upward."""
    way = flange - shoulder
    half = float(np.linalg.norm(way)) / 2
    along = way / max(2 * half, 1e-9)
    up = np.array([0.0, 0.0, 1.0]) - along[2] * along
    up /= max(float(np.linalg.norm(up)), 1e-9)
    return shoulder + way / 2 + up * float(np.sqrt(max(link**2 - half**2, 0.0)))


class Holder:
    """The arm in a scene.

    Args:
        server: server of the scene.
        poses: poses of the object's contact frame (n, 4, 4).
        person: position of the person on the floor (2,) [m].
        floor: height of the floor [m].
    """

    def __init__(
        self, server: Any, poses: NDArray[np.float64], person: NDArray[np.float64], floor: float
    ) -> None:
        """Draw post, links and joints."""
        self._arms = arm_of(poses, person)
        first = self._arms[0]
        length = float(np.linalg.norm(first.elbow - first.shoulder))
        scene, shoulder = server.scene, first.shoulder
        height = float(shoulder[2]) - floor
        scene.add_cylinder(
            "/robot/post",
            radius=1.6 * _RADIUS,
            height=height,
            position=(*shoulder[:2], floor + height / 2),
            color=_COLOUR,
        )
        self._links = [
            scene.add_cylinder(f"/robot/link{i}", radius=_RADIUS, height=length, color=_COLOUR)
            for i in range(2)
        ]
        self._joints = [
            scene.add_icosphere(f"/robot/joint{i}", radius=1.35 * _RADIUS, color=_JOINT_COLOUR)
            for i in range(3)
        ]

    def show(self, frame: int) -> None:
        """Move the arm to a frame."""
        arm = self._arms[frame]
        points = (arm.shoulder, arm.elbow, arm.flange)
        for joint, point in zip(self._joints, points, strict=True):
            joint.position = coarse(point)
        for link, begin, end in zip(self._links, points, points[1:], strict=False):
            link.position = coarse((begin + end) / 2)
            link.wxyz = coarse(_upright_to(end - begin))


def _upright_to(way: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the quaternion wxyz that rotates z to a direction."""
    x, y, z = way / max(float(np.linalg.norm(way)), 1e-9)
    quaternion = np.array([1.0 + z, -y, x, 0.0])
    size = float(np.linalg.norm(quaternion))
    return quaternion / size if size > 1e-9 else np.array([0.0, 1.0, 0.0, 0.0])
