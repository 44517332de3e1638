"""Biovision hierarchy files (.bvh): joint centres by forward kinematics, all frames at once."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ergoqp.progress import Progress, unseen
from ergoqp.recordings.bvh.parse import Joint, opened
from ergoqp.recordings.formats.stamps import repeated
from ergoqp.recordings.motion import JointMotion

_AXES = {"X": 0, "Y": 1, "Z": 2}


def read_bvh(path: Path, progress: Progress = unseen) -> JointMotion:
    """Read a BVH file.

    End sites are not joints: they state the drawn length of the last bone, not a measured point.

    Args:
        path: the file.
        progress: is called with the share of the file that is read.

    Returns:
        The centres of all joints of the file's skeleton.

    Raises:
        RecordingError: if the file is not a complete, finite BVH file.
    """
    with opened(path, progress) as text:
        # Single precision is finer than any measurement and halves the memory.
        positions = np.empty((text.most, len(text.joints), 3), dtype=np.float32)
        count = 0
        for rows in text.blocks:
            positions[count : count + len(rows)] = _places(text.joints, rows)
            count += len(rows)
    rest = _places(
        [Joint(joint.name, joint.offset, (), joint.depth) for joint in text.joints],
        np.zeros((1, 0)),
    )
    note = f"The frames are uniform in time, {text.frame_time:g} s apart, as the file states."
    return JointMotion(
        tuple(joint.name for joint in text.joints),
        positions[:count],
        text.frame_time * np.arange(count),
        rest[0],
        (note, *repeated(positions[:count])),
    )


def _places(joints: Sequence[Joint], rows: np.ndarray) -> np.ndarray:
    """Return the centres of joints (n, m, 3) by forward kinematics [file unit]."""
    positions = np.empty((len(rows), len(joints), 3))
    column = 0
    # Positions and rotations of the possible parents of the next joint, the world first.
    above = [
        (np.zeros((len(rows), 3)), np.broadcast_to(np.eye(3), (len(rows), 3, 3))),
    ]
    for number, joint in enumerate(joints):
        parent_position, parent_rotation = above[joint.depth]
        width = len(joint.channels)
        offset, rotation = _local(joint, rows[:, column : column + width])
        column += width
        positions[:, number] = parent_position + np.einsum("nij,nj->ni", parent_rotation, offset)
        above[joint.depth + 1 :] = [(positions[:, number], parent_rotation @ rotation)]
    return positions


def _local(joint: Joint, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a joint's offset (n, 3) and rotation (n, 3, 3) in its parent.

    Position channels replace the offset.
    """
    offset = np.tile(joint.offset, (len(values), 1))
    rotation = np.broadcast_to(np.eye(3), (len(values), 3, 3))
    for channel, value in zip(joint.channels, values.T, strict=True):
        if channel.endswith("position"):
            offset[:, _AXES[channel[0]]] = value
        else:
            rotation = rotation @ _turn(_AXES[channel[0]], np.radians(value))
    return offset, rotation


def _turn(axis: int, angle: np.ndarray) -> np.ndarray:
    """Return the rotations about a coordinate axis, shape (n, 3, 3)."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn = np.zeros((len(angle), 3, 3))
    turn[:, axis, axis] = 1.0
    turn[:, i, i] = turn[:, j, j] = np.cos(angle)
    turn[:, j, i] = np.sin(angle)
    turn[:, i, j] = -turn[:, j, i]
    return turn
