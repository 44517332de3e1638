"""Which reader reads a motion-capture file; what an own one hands on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from ergoqp.arguments import shown
from ergoqp.errors import ErgoqpError, RecordingError, in_words
from ergoqp.progress import Progress, unseen
from ergoqp.recordings.formats.kinds import KINDS, TABLE, kind_of
from ergoqp.recordings.formats.rows import Asked
from ergoqp.recordings.motion import JointMotion
from ergoqp.registry import check_free, own_term, registered

READERS: Final = tuple(
    ending[1:] for kind in KINDS if kind is not TABLE for ending in kind.endings if ending != ".csv"
)
"""Endings that no reader of one's own may have; tables are anybody's."""


def read_motion(path: Path, progress: Progress = unseen, asked: Asked | None = None) -> JointMotion:
    """Read a motion-capture file.

    A reader of the user's own reads the files of its ending; else what is in a file decides.

    Args:
        path: the file.
        progress: told how much of the file is read, if the reader tells.
        asked: what the file may not say.

    Raises:
        RecordingError: if there is none, or it cannot read the file, whatever it raises.
        InputError: if an own reader cannot be imported, or its name is another's too.
    """
    ending = path.suffix.lower()
    if ending[1:] in READERS:
        check_free("reader", [ending[1:]])
    elif ending in [f".{name}" for name in registered("reader")]:
        return _own_motion(path, own_term("reader", ending[1:]))
    kind = kind_of(path)
    motion = kind.read(path, progress, asked or Asked())
    if kind.endings and ending not in kind.endings:
        said = (
            f"The file is read as {kind.title}, by what is in it, although its ending is"
            f" {ending or 'none'}."
        )
        return replace(motion, notes=(said, *motion.notes))
    return motion


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
