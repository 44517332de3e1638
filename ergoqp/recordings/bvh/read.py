"""Biovision hierarchy files (.bvh): skeleton by bvhio, joint centres by forward kinematics.

The kinematics runs over all frames at once.
"""

from __future__ import annotations

import tempfile
import warnings
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from ergoqp.errors import MissingExtraError, RecordingError
from ergoqp.recordings.bvh.text import BvhText, read_text
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
        MissingExtraError: bvhio is not installed.
    """
    bvhio = _import_bvhio()
    text = read_text(path)
    root = _skeleton(bvhio, path, text)
    names: list[str] = []
    positions: list[np.ndarray] = []
    rest: list[np.ndarray] = []
    column = 0
    pending = [
        (
            root,
            np.zeros(3),
            np.zeros((len(text.rows), 3)),
            np.broadcast_to(np.eye(3), (len(text.rows), 3, 3)),
        )
    ]
    while pending:  # depth first, children in their order: the order of the columns
        joint, parent_rest, parent_position, parent_rotation = pending.pop()
        width = len(joint.Channels)
        offset, rotation = _local(joint, text.rows[:, column : column + width])
        column += width
        position = parent_position + np.einsum("nij,nj->ni", parent_rotation, offset)
        names.append(joint.Name)
        rest.append(parent_rest + _vector(joint.Offset))
        positions.append(position)
        pending.extend(
            (child, rest[-1], position, parent_rotation @ rotation)
            for child in reversed(joint.Children)
        )
    note = f"The frames are uniform in time, {text.frame_time:g} s apart, as the file states."
    return JointMotion(
        tuple(names),
        np.stack(positions, axis=1),
        text.frame_time * np.arange(len(text.rows)),
        np.array(rest),
        (note,),
    )


def _import_bvhio() -> ModuleType:
    try:
        with warnings.catch_warnings():
            # Its own import of PyGLM announces a renaming that concerns bvhio, not the person
            # reading a recording.
            warnings.simplefilter("ignore")
            import bvhio
    except ImportError:
        raise MissingExtraError("reading BVH files", "mocap", "bvhio") from None
    return bvhio


def _skeleton(bvhio: ModuleType, path: Path, text: BvhText) -> Any:
    """Let bvhio read the checked skeleton alone, with an empty movement behind it.

    So it cannot run past the end.
    """
    with tempfile.TemporaryDirectory() as folder:
        checked = Path(folder) / "skeleton.bvh"
        try:
            checked.write_text(
                "\n".join((*text.header, "MOTION", "Frames: 0", "Frame Time: 1", ""))
            )
            return bvhio.readAsBvh(str(checked)).Root
        except SyntaxError as error:
            raise RecordingError(
                f"{path.name}: got {str(error.text).strip()!r}, allowed BVH: {error.msg}"
            ) from None
        except RecursionError:
            raise RecordingError(
                f"{path.name}: got joints nested too deeply, allowed a person's skeleton"
            ) from None
        except (IndexError, ValueError) as error:
            raise RecordingError(
                f"{path.name}: the skeleton cannot be read ({error}), allowed BVH"
            ) from None


def _local(joint: Any, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a joint's offset (n, 3) and rotation (n, 3, 3) in its parent.

    Position channels replace the offset.
    """
    offset = np.tile(_vector(joint.Offset), (len(values), 1))
    rotation = np.broadcast_to(np.eye(3), (len(values), 3, 3))
    for channel, value in zip(joint.Channels, values.T, strict=True):
        if channel.endswith("position"):
            offset[:, _AXES[channel[0]]] = value
        else:
            rotation = rotation @ _turn(_AXES[channel[0]], np.radians(value))
    return offset, rotation


def _vector(offset: Any) -> np.ndarray:
    return np.array(offset.to_tuple(), dtype=float)


def _turn(axis: int, angle: np.ndarray) -> np.ndarray:
    """Return the rotations about a coordinate axis, shape (n, 3, 3)."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn = np.zeros((len(angle), 3, 3))
    turn[:, axis, axis] = 1.0
    turn[:, i, i] = turn[:, j, j] = np.cos(angle)
    turn[:, j, i] = np.sin(angle)
    turn[:, i, j] = -turn[:, j, i]
    return turn
