"""Which reader reads a motion-capture file, by the file's ending; what an own one hands on."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np

from ergoqp.arguments import shown
from ergoqp.errors import ErgoqpError, RecordingError, in_words
from ergoqp.progress import Progress, unseen
from ergoqp.recordings.bvh.read import read_bvh
from ergoqp.recordings.motion import JointMotion
from ergoqp.registry import check_free, own_term, registered

READERS: Final[dict[str, Callable[[Path, Progress], JointMotion]]] = {".bvh": read_bvh}
"""File name ending -> reader. An own one is an entry point, see `ergoqp.registry`."""


def read_motion(path: Path, progress: Progress = unseen) -> JointMotion:
    """Read a motion-capture file by the reader of its ending.

    Args:
        path: the file.
        progress: told how much of the file is read, if the reader tells.

    Raises:
        RecordingError: if there is none, or it cannot read the file, whatever it raises.
        InputError: if an own reader cannot be imported, or its name is another's too.
    """
    ending = path.suffix.lower()
    if ending in READERS:
        check_free("reader", [ending[1:]])
        return READERS[ending](path, progress)
    own = [f".{name}" for name in registered("reader")]
    if ending in own:
        return _own_motion(path, own_term("reader", ending[1:]))
    if os.path.isdir(path):  # where a name is too long `Path.is_dir` raises
        raise RecordingError(f"{str(path)!r} is a folder, allowed the recording file itself")
    raise RecordingError(
        f"{path.name}: got the ending {path.suffix!r}, allowed {', '.join([*READERS, *own])}"
    )


def _own_motion(path: Path, reader: Any) -> JointMotion:
    """Return what a reader of the user's own makes of a file."""
    try:
        motion = reader(path)
        wrong = lacking(motion)
    except RecordingError:
        raise
    except ErgoqpError as error:
        raise RecordingError(f"{path.name}: {error}") from None
    except Exception as error:  # whatever the code of a user's own reader does
        raise RecordingError(
            f"{path.name}: got {in_words(error)}, allowed what {shown(reader)} reads"
        ) from None
    if wrong:
        raise RecordingError(
            f"{path.name}: got {wrong} from {shown(reader)}, allowed a JointMotion of"
            " ergoqp.recordings.motion"
        )
    return motion


def lacking(motion: Any) -> str:
    """Return what of a motion is not as `JointMotion` says, or an empty text."""
    if not isinstance(motion, JointMotion):
        return shown(motion)
    names = motion.names
    if not names or not all(isinstance(name, str) for name in names):
        return f"the names {shown(names)}"
    if len(set(names)) < len(names):
        return "a name twice"
    times = np.asarray(motion.time)
    shapes: list[tuple[str, Any, tuple[int, ...]]] = [
        ("positions", motion.positions, (len(times), len(names), 3))
    ]
    if motion.rest is not None:
        shapes.append(("rest", motion.rest, (len(names), 3)))
    for what, values, shape in shapes:
        array = np.asarray(values)
        if array.dtype.kind not in "iuf" or array.shape != shape:
            return f"{what} of shape {array.shape} and not {shape}"
        if np.isinf(array).any():
            return f"{what} without end"
    if times.ndim != 1 or not len(times) or times.dtype.kind not in "iuf":
        return f"the times {shown(motion.time)}"
    if not np.isfinite(times).all() or not (np.diff(times) > 0).all():
        return "times that do not increase"
    return ""
