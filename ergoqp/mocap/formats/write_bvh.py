"""Postures as a BVH file: the body's own skeleton under our own joint names, y up, centimetres."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import casadi as ca
import numpy as np

from ergoqp.errors import InputError
from ergoqp.files.atomic import write_whole
from ergoqp.human import Body, Kinematics
from ergoqp.joints import JOINTS, SIDES

_PARENT: Final[dict[str, str]] = {
    "trunk": "pelvis",
    "neck": "trunk",
    "head": "neck",
    "head_top": "head",
    "nose": "head",
    **{f"{side}_shoulder": "trunk" for side in SIDES},
    **{f"{side}_hip": "pelvis" for side in SIDES},
    **{
        f"{side}_{child}": f"{side}_{parent}"
        for side in SIDES
        for parent, child in (
            ("shoulder", "elbow"),
            ("elbow", "wrist"),
            ("wrist", "knuckles"),
            ("wrist", "thumb"),
            ("hip", "knee"),
            ("knee", "ankle"),
            ("ankle", "toe"),
        )
    },
}
"""Joint of the file -> its parent; each rotates with the body's frame of the same name."""

# The usual axes of the format: x to the left, y up, z forward.
_TO_FILE: Final = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
_UNITS_PER_METRE: Final = 100.0
_ROTATIONS: Final = "Zrotation Xrotation Yrotation"


def write_bvh(
    path: str | Path, postures: np.ndarray, base_poses: np.ndarray, body: Body, frame_time: float
) -> Path:
    """Write a movement of the body as a BVH file that `ergoqp.load_recording` reads back.

    Args:
        path: file to write.
        postures: joint angles, shape (n, 32) [rad].
        base_poses: poses of the upright pelvis in the world, shape (n, 4, 4) [m].
        body: the person.
        frame_time: period between two postures [s].

    Returns:
        The path written.

    Raises:
        InputError: if a shape does not fit, a value is not finite, or the frame time is not
            positive.
    """
    postures, base_poses = np.asarray(postures, dtype=float), np.asarray(base_poses, dtype=float)
    frames = len(postures)
    if postures.shape != (frames, len(JOINTS)) or base_poses.shape != (frames, 4, 4) or not frames:
        raise InputError(
            f"postures and base_poses: got the shapes {postures.shape} and {base_poses.shape}, "
            f"allowed (n, {len(JOINTS)}) and (n, 4, 4)"
        )
    if not (
        np.isfinite(postures).all() and np.isfinite(base_poses).all() and 0 < frame_time < np.inf
    ):
        raise InputError(
            "postures, base_poses and frame_time: got a value that is not finite or a period that"
            " is not positive, allowed finite values and a period above 0"
        )
    kinematics = Kinematics(body)
    turned = {"pelvis": np.broadcast_to(np.eye(3), (frames, 3, 3))}
    for name in _PARENT:
        _, rotation, _ = kinematics.function(name)(ca.DM(postures.T))
        turned[name] = rotation.full().reshape(3, frames, 3).transpose(1, 0, 2)
    root = base_poses[:, :3, 3] @ _TO_FILE.T * _UNITS_PER_METRE
    columns = [root, _angles(base_poses[:, :3, :3])]
    lines = ["HIERARCHY"]
    for name in _write_joint("pelvis", lines, 0, _offsets(kinematics)):
        parent = turned[_PARENT[name]]
        columns.append(_angles(parent.transpose(0, 2, 1) @ turned[name]))
    lines += ["MOTION", f"Frames: {frames}", f"Frame Time: {frame_time:.9g}"]
    lines += [" ".join(f"{value:.6f}" for value in row) for row in np.hstack(columns)]
    path = Path(path)
    write_whole(path, "\n".join(lines) + "\n")
    return path


def _offsets(kinematics: Kinematics) -> dict[str, np.ndarray]:
    """Return each joint's position in its parent at the zero posture, shape (3,) [m].

    The trunk rotates about the pelvis.
    """
    at = {
        name: np.array(kinematics.at(name, ca.DM.zeros(len(JOINTS)))[0]).ravel()
        for name in ("pelvis", *_PARENT)
    }
    at["trunk"] = at["pelvis"]
    return {"pelvis": np.zeros(3)} | {
        name: at[name] - at[parent] for name, parent in _PARENT.items()
    }


def _write_joint(
    name: str, lines: list[str], depth: int, offsets: dict[str, np.ndarray]
) -> Iterator[str]:
    """Append a joint and its descendants; yield the names of the descendants in channel order."""
    tab = "  " * depth
    offset = _TO_FILE @ offsets[name] * _UNITS_PER_METRE
    lines += [
        f"{tab}{'JOINT' if depth else 'ROOT'} {name}",
        f"{tab}{{",
        f"{tab}  OFFSET {offset[0]:.6f} {offset[1]:.6f} {offset[2]:.6f}",
        (
            f"{tab}  CHANNELS 3 {_ROTATIONS}"
            if depth
            else f"{tab}  CHANNELS 6 Xposition Yposition Zposition {_ROTATIONS}"
        ),
    ]
    children = [child for child, parent in _PARENT.items() if parent == name]
    for child in children:
        yield child
        yield from _write_joint(child, lines, depth + 1, offsets)
    if not children:
        lines += [
            f"{tab}  End Site",
            f"{tab}  {{",
            f"{tab}    OFFSET 0.000000 0.000000 0.000000",
            f"{tab}  }}",
        ]
    lines.append(f"{tab}}}")


def _angles(rotations: np.ndarray) -> np.ndarray:
    """Return the angles of rotations (n, 3, 3) about the file's z, x, y in turn.

    The rotations are given in our axes; the angles have shape (n, 3) [deg].
    """
    r = _TO_FILE @ rotations @ _TO_FILE.T
    x = np.arcsin(np.clip(r[:, 2, 1], -1.0, 1.0))
    # With x at a quarter turn, z and y rotate about the same line, and z gets the whole angle.
    upright = np.hypot(r[:, 0, 1], r[:, 1, 1]) > 1e-9
    z = np.where(upright, np.arctan2(-r[:, 0, 1], r[:, 1, 1]), np.arctan2(r[:, 1, 0], r[:, 0, 0]))
    y = np.where(upright, np.arctan2(-r[:, 2, 0], r[:, 2, 2]), 0.0)
    return np.degrees(np.stack([z, x, y], axis=1))
