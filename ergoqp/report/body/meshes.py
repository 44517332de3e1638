"""Triangle meshes of the shapes of a scene.

The body is defined by the capsules of the model. The drawing differs only in looks: limbs are
thinner at their far end, and the rings of the trunk are joined into one surface.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ergoqp.report.body.person import Part

Mesh = tuple[NDArray[np.float32], NDArray[np.uint32]]
"""Vertices (v, 3) [m] and triangles (f, 3)."""

_AROUND: Final = 24
_ALONG: Final = 7  # rings from the equator to a pole
_NEAR, _FAR = 1.06, 0.74  # radius of a limb at its ends, relative to the model
_LIMBS: Final = ("upper_arm", "forearm", "thigh", "shank")


def body_mesh(parts: Sequence[Part]) -> Mesh:
    """Return the surface of parts with the same owner, in the frame of the owner.

    Args:
        parts: one or more parts; several parts of the trunk become one torso.
    """
    if len(parts) > 1 and all(part.segment == "trunk" and part.capsule for part in parts):
        return _torso(parts)
    return _joined([_part_mesh(part) for part in parts])


def _part_mesh(part: Part) -> Mesh:
    half = float(part.size[1]) if part.capsule else 0.0
    axes = np.full(3, part.size[0]) if part.capsule else part.size
    upper = np.linspace(np.pi / 2, 0, _ALONG)
    latitude = np.concatenate([upper, -upper[::-1]])
    width, height = np.cos(latitude), np.sin(latitude) * axes[2] + np.repeat([half, -half], _ALONG)
    if part.name.endswith(_LIMBS):
        towards_owner = np.sign(-part.position @ part.rotation[:, 2])
        width = width * np.interp(towards_owner * height, [-half, half], [_FAR, _NEAR])
    rings = _rings(np.outer(width, axes[:2]), height)
    return (rings @ part.rotation.T + part.position).astype(np.float32), _between_rings(len(height))


def _torso(parts: Sequence[Part]) -> Mesh:
    """Return one surface through the rings of the trunk, which lie across it (along y)."""
    ordered = sorted(parts, key=lambda part: part.position[2])
    z = np.array([part.position[2] for part in ordered])
    depth = np.array([part.size[0] for part in ordered])
    width = depth + np.array([part.size[1] for part in ordered])
    forward = np.array([part.position[0] for part in ordered])
    # At the ends, the lowest ring extends into the pelvis, and the highest closes over the
    # shoulders.
    heights = np.concatenate(
        [
            [z[0] - depth[0]],
            np.linspace(z[0], z[-1], 18),
            z[-1] + depth[-1] * np.linspace(0.3, 1, 6),
        ]
    )
    over = np.clip((heights - z[-1]) / depth[-1], 0, 1)
    closing = np.sqrt(1 - over**2)
    half_axes = np.stack(
        [
            np.interp(heights, z, depth) * closing,
            np.interp(heights, z, width) - depth[-1] * (1 - closing) - 0.08 * over,
        ],
        axis=1,
    )
    half_axes[-1] = 0.0
    rings = _rings(half_axes, heights)
    rings[:, 0] += np.repeat(np.interp(heights, z, forward), _AROUND)
    # These rings go upwards, so their triangles are flipped to face outwards.
    return rings.astype(np.float32), _between_rings(len(heights))[:, ::-1].copy()


def _joined(meshes: Sequence[Mesh]) -> Mesh:
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
    vertices = np.concatenate([vertices for vertices, _ in meshes])
    faces = np.concatenate(
        [faces + np.uint32(start) for (_, faces), start in zip(meshes, starts, strict=False)]
    )
    return vertices, faces


def _rings(half_axes: NDArray[np.float64], heights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points of ellipses with half axes (n, 2) at heights (n,), ring after ring."""
    angle = np.linspace(0, 2 * np.pi, _AROUND, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    flat = (half_axes[:, None, :] * circle).reshape(-1, 2)
    return np.column_stack([flat, np.repeat(heights, _AROUND)])


def _between_rings(count: int) -> NDArray[np.uint32]:
    """Return triangles between successive rings. They face outwards if the rings go down."""
    ring, spoke = np.meshgrid(np.arange(count - 1), np.arange(_AROUND), indexing="ij")
    here, beside = ring * _AROUND + spoke, ring * _AROUND + (spoke + 1) % _AROUND
    quads = np.stack([here, here + _AROUND, beside + _AROUND, beside], axis=-1).reshape(-1, 4)
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.uint32)
