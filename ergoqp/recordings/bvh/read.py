"""Biovision hierarchy files (.bvh): joint centres by forward kinematics, all frames at once."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ergoqp.recordings.bvh.parse import Joint, read_text
from ergoqp.recordings.motion import JointMotion

_AXES = {"X": 0, "Y": 1, "Z": 2}


def read_bvh(path: Path) -> JointMotion:
    """Read a BVH file.

    End sites are not joints: they say how long the last bone is drawn, not where something was
    measured.

    Args:
        path: the file.

    Returns:
        The centres of all joints of the file's skeleton.

    Raises:
        RecordingError: the file is not a complete, finite BVH file.
    """
    text = read_text(path)
    positions: list[np.ndarray] = []
    rest: list[np.ndarray] = []
    column = 0
    # Rest, position and rotation of all that the next joint may hang from, the world first.
    above = [
        (
            np.zeros(3),
            np.zeros((len(text.rows), 3)),
            np.broadcast_to(np.eye(3), (len(text.rows), 3, 3)),
        )
    ]
    for joint in text.joints:
        parent_rest, parent_position, parent_rotation = above[joint.depth]
        width = len(joint.channels)
        offset, rotation = _local(joint, text.rows[:, column : column + width])
        column += width
        rest.append(parent_rest + joint.offset)
        positions.append(parent_position + np.einsum("nij,nj->ni", parent_rotation, offset))
        above[joint.depth + 1 :] = [(rest[-1], positions[-1], parent_rotation @ rotation)]
    note = f"The frames are uniform in time, {text.frame_time:g} s apart, as the file states."
    return JointMotion(
        tuple(joint.name for joint in text.joints),
        np.stack(positions, axis=1),
        text.frame_time * np.arange(len(text.rows)),
        np.array(rest),
        (note,),
    )


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
