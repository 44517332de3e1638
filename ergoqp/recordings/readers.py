"""Which reader reads a motion-capture file."""

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
"""Endings that no reader of one's own may have; tables are anybody's.

Example:
    >>> from ergoqp.recordings import READERS
    >>> "bvh" in READERS, "c3d" in READERS
    (True, True)
"""


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
        own = _own_motion(path, ending[1:], own_term("reader", ending[1:]))
        return _noted(own, _unused(asked, None))
    kind = kind_of(path)
    motion = _noted(kind.read(path, progress, asked or Asked()), _unused(asked, kind))
    # A bag may be a folder, and then has no ending.
    if ending not in kind.endings and not os.path.isdir(path):
        said = (
            f"The file is read as {kind.title}, by what is in it, although its ending is"
            f" {ending or 'none'}."
        )
        return _noted(motion, [said])
    return motion


def _noted(motion: JointMotion, notes: list[str]) -> JointMotion:
    """Return a motion with sentences before its own."""
    return replace(motion, notes=(*notes, *motion.notes)) if notes else motion


def _unused(asked: Asked | None, kind: Kind | None) -> list[str]:
    """Say what was stated of a file that its format, or an own reader, does not ask for."""
    notes = []
    if asked and asked.columns and kind is not TABLE:
        notes.append("The stated names (columns) are not used: only tables have none of their own.")
    if asked and asked.rate is not None and kind not in (TABLE, BODIES):
        notes.append(
            "The stated frames per second (rate) are not used: the file has its own times."
        )
    return notes


def _own_motion(path: Path, name: str, reader: Any) -> JointMotion:
    """Return what the user's own reader of this name makes of a file."""
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
