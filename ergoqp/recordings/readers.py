"""Choice of the reader for a motion-capture file."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from ergoqp.errors import ErgoqpError, RecordingError, in_words
from ergoqp.progress import Progress, unseen
from ergoqp.recordings.formats.kinds import BODIES, KINDS, TABLE, Kind, kind_of
from ergoqp.recordings.formats.rows import Asked
from ergoqp.recordings.motion import JointMotion
from ergoqp.recordings.own_motions import lacking, normalised
from ergoqp.registry import check_free, own_term, registered

READERS: Final = tuple(
    ending[1:] for kind in KINDS if kind is not TABLE for ending in kind.endings if ending != ".csv"
)
"""Endings that a user's own reader cannot have; those of tables are free.

Example:
    >>> from ergoqp.recordings import READERS
    >>> "bvh" in READERS, "c3d" in READERS
    (True, True)
"""


def read_motion(path: Path, progress: Progress = unseen, asked: Asked | None = None) -> JointMotion:
    """Read a motion-capture file.

    A user's own reader reads the files with its ending. Otherwise the content decides.

    Args:
        path: the file.
        progress: is called with the share of the file that is read, if the reader supports it.
        asked: what the file may lack.

    Raises:
        RecordingError: if there is no such file or the reader fails, with whatever exception.
        InputError: if a user's own reader cannot be imported, or its name is used twice.
    """
    ending = path.suffix.lower()
    if ending[1:] in READERS:
        check_free("reader", [ending[1:]])
    elif ending in [f".{name}" for name in registered("reader")]:
        own = _own_motion(path, ending[1:], own_term("reader", ending[1:]))
        return _noted(own, _unused(asked, None))
    kind = kind_of(path)
    motion = _noted(kind.read(path, progress, asked or Asked()), _unused(asked, kind))
    # A bag may be a folder, and then has no ending.
    if ending not in kind.endings and not os.path.isdir(path):
        said = (
            f"The file is read as {kind.title} because of its content, although its ending is"
            f" {ending or 'none'}."
        )
        return _noted(motion, [said])
    return motion


def _noted(motion: JointMotion, notes: list[str]) -> JointMotion:
    """Return a motion with further notes before its own."""
    return replace(motion, notes=(*notes, *motion.notes)) if notes else motion


def _unused(asked: Asked | None, kind: Kind | None) -> list[str]:
    """Return sentences about stated options that the format or a user's own reader ignores."""
    notes = []
    if asked and asked.columns and kind is not TABLE:
        notes.append("The stated names (columns) are not used: only a table can lack names.")
    if asked and asked.rate is not None and kind not in (TABLE, BODIES):
        notes.append(
            "The stated frames per second (rate) are not used: the file has its own times."
        )
    return notes


def _own_motion(path: Path, name: str, reader: Any) -> JointMotion:
    """Return the motion that the user's own reader of this name reads from a file."""
    try:
        motion = reader(path)
        wrong = lacking(motion)
        if not wrong:
            return normalised(motion)
    except RecordingError:
        raise
    except ErgoqpError as error:
        raise RecordingError(f"{path.name}: {error}") from None
    except Exception as error:  # whatever the code of a user's own reader does
        raise RecordingError(
            f"{path.name}: got {in_words(error)}, allowed what the reader {name} reads"
        ) from None
    raise RecordingError(
        f"{path.name}: got {wrong} from the reader {name}, allowed a JointMotion of"
        " ergoqp.recordings.motion"
    )
