"""The person as solid parts, each with its segment of the sheet, and their poses in a posture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from ergoqp.expressions.quaternions import matrix_of
from ergoqp.human import Body
from ergoqp.joints import JOINTS

_SEGMENT_OF: Final = {
    "pelvis": "legs",
    "abdomen": "trunk",
    "waist": "trunk",
    "chest": "trunk",
    "shoulders": "trunk",
    "neck": "neck",
    "head": "neck",
    "nose": "neck",
    "upper_arm": "upper_arm",
    "forearm": "lower_arm",
    "palm": "wrist",
    "fingers": "wrist",
    "thumb": "wrist",
    "thigh": "legs",
    "shank": "legs",
}
"""The score that colours each shape of the model. Hair and shoes have their own colours."""


@dataclass(frozen=True, eq=False)
class Part:
    """A capsule or an ellipsoid of the body.

    Attributes:
        name: name of the shape in the model.
        owner: name of the model's body that it is fixed to.
        segment: key of the score that colours it, None without one.
        capsule: whether it is a capsule along its own z axis; else it is an ellipsoid.
        size: capsule: radius and half length of the straight part; ellipsoid: the three half
            axes [m].
        position: centre in the owner, shape (3,) [m].
        rotation: axes in the owner, shape (3, 3).
    """

    name: str
    owner: str
    segment: str | None
    capsule: bool
    size: NDArray[np.float64]
    position: NDArray[np.float64]
    rotation: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Placement:
    """Poses of the bodies of the model in n postures.

    Attributes:
        owners: names of the bodies.
        positions: shape (n, bodies, 3) [m].
        quaternions: w first, shape (n, bodies, 4).
    """

    owners: tuple[str, ...]
    positions: NDArray[np.float64]
    quaternions: NDArray[np.float64]

    def of(self, owner: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return positions (n, 3) and quaternions (n, 4) of one body."""
        i = self.owners.index(owner)
        return self.positions[:, i], self.quaternions[:, i]


def parts_of(body: Body) -> list[Part]:
    """Return the shapes of a person's model."""
    model = body.model
    parts = []
    for number in range(model.ngeom):
        geom = model.geom(number)
        side, _, rest = geom.name.partition("_")
        sided = side in ("right", "left")
        segment = _SEGMENT_OF.get(rest if sided else geom.name)
        if sided and segment not in (None, "legs"):
            segment = f"{side}_{segment}"
        parts.append(
            Part(
                name=geom.name,
                owner=model.body(int(geom.bodyid[0])).name,
                segment=segment,
                capsule=int(geom.type[0]) == mujoco.mjtGeom.mjGEOM_CAPSULE,
                size=geom.size.copy(),
                position=geom.pos.copy(),
                rotation=matrix_of(geom.quat),
            )
        )
    return parts


def place(body: Body, postures: NDArray[np.float64], base_poses: NDArray[np.float64]) -> Placement:
    """Return the pose of every body of the model.

    Args:
        body: the person.
        postures: shape (n, 32) [rad], finite.
        base_poses: pelvis in the world, upright, shape (n, 4, 4) [m].
    """
    model = body.model
    data = mujoco.MjData(model)
    base = [model.joint(name).qposadr[0] for name in ("base_x", "base_y", "base_z")]
    yaw = model.joint("base_yaw").qposadr[0]
    hinges = [model.joint(name).qposadr[0] for name in JOINTS]
    owners = tuple(dict.fromkeys(part.owner for part in parts_of(body)))
    numbers = [model.body(owner).id for owner in owners]
    positions, quaternions = (
        np.empty((len(postures), len(owners), 3)),
        np.empty((len(postures), len(owners), 4)),
    )
    for i, (posture, pose) in enumerate(zip(postures, base_poses, strict=True)):
        data.qpos[base] = pose[:3, 3]
        data.qpos[yaw] = np.arctan2(pose[1, 0], pose[0, 0])
        data.qpos[hinges] = posture
        mujoco.mj_kinematics(model, data)
        positions[i], quaternions[i] = data.xpos[numbers], data.xquat[numbers]
    return Placement(owners, positions, quaternions)
