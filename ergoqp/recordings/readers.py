"""Which reader reads a motion-capture file; what an own one hands on."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import replace
from numbers import Real
from pathlib import Path
from typing import Any, Final

import numpy as np

from ergoqp.arguments import shown
from ergoqp.errors import ErgoqpError, RecordingError, in_words
from ergoqp.progress import Progress, unseen
from ergoqp.recordings.fitting.axes import UPS
from ergoqp.recordings.formats.kinds import BODIES, KINDS, TABLE, Kind, kind_of
from ergoqp.recordings.formats.rows import Asked
from ergoqp.recordings.motion import JointMotion
from ergoqp.registry import check_free, own_term, registered

READERS: Final = tuple(
    ending[1:] for kind in KINDS if kind is not TABLE for ending in kind.endings if ending != ".csv"
)
"""Endings that no reader of one's own may have; tables are anybody's."""
_SLACK: Final = 0.1
"""By how much quaternions and axes may be longer or shorter than one."""


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
        return _noted(_own_motion(path, own_term("reader", ending[1:])), _unused(asked, None))
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
    listed = isinstance(names, tuple | list) and all(isinstance(n, str) and n for n in names)
    if not listed or not names:
        return f"the names {shown(names)}"
    if len(set(names)) < len(names):
        return "a name twice"
    times = np.asarray(motion.time)
    if times.ndim != 1 or not len(times) or times.dtype.kind not in "iuf":
        return f"the times {_line(motion.time)}"
    count = len(times)
    shapes: list[tuple[str, Any, tuple[int, ...]]] = [
        ("positions", motion.positions, (count, len(names), 3))
    ]
    if motion.rest is not None:
        shapes.append(("rest", motion.rest, (len(names), 3)))
    for what, each, shape in (
        ("turns", motion.turns, (count, 4)),
        ("objects", motion.objects, (count, 4, 4)),
        ("angles", motion.angles, (count,)),
    ):
        if not isinstance(each, Mapping) or not all(isinstance(name, str) for name in each):
            return f"the {what} {_line(each)}"
        shapes += [(f"{what} of {name}", values, shape) for name, values in each.items()]
    for what, values, shape in shapes:
        if wrong := _no_numbers(values, shape):
            return f"{what} {wrong}"
    if not np.isfinite(times).all() or not (np.diff(times) > 0).all():
        return "times that do not increase"
    return _no_turns(motion) or _no_words(motion)


def _no_numbers(values: Any, shape: tuple[int, ...]) -> str:
    """Return what of an array is not as it should be."""
    array = np.asarray(values)
    if array.shape != shape:
        return f"of shape {array.shape} and not {shape}"
    if array.dtype.kind not in "iuf":
        return f"of shape {array.shape} and not numbers"
    return "without end" if np.isinf(array).any() else ""


def _no_turns(motion: JointMotion) -> str:
    """Return which turns and poses of a motion are none."""
    for name, turns in motion.turns.items():
        seen = _seen(turns)
        # Of what is large the square would be infinite.
        if (np.abs(seen) > _SLACK + 1).any() or (
            np.abs(np.linalg.norm(seen, axis=1) - 1) > _SLACK
        ).any():
            return f"turns of {name} that are no unit quaternions"
    for name, poses in motion.objects.items():
        axes = _seen(np.asarray(poses)[:, :3, :3])
        if (np.abs(axes) > _SLACK + 1).any() or not (
            (np.abs(np.einsum("nij,nik->njk", axes, axes) - np.eye(3)) < _SLACK).all()
            and (np.linalg.det(axes) > 0).all()
        ):
            return f"objects of {name} that are no poses"
    return ""


def _seen(values: Any) -> np.ndarray:
    """Return those of some arrays (n, ...) of which nothing is lost."""
    array = np.asarray(values, dtype=float)
    return array[np.isfinite(array).reshape(len(array), -1).all(axis=1)]


def _no_words(motion: JointMotion) -> str:
    """Return which of the few words and numbers of a motion is none."""
    if motion.unit is not None and not (_is_number(motion.unit) and motion.unit > 0):
        return f"the unit {shown(motion.unit)}"
    if motion.up is not None and motion.up not in UPS:
        return f"the vertical axis {shown(motion.up)}"
    if not isinstance(motion.notes, tuple | list) or not all(
        isinstance(note, str) for note in motion.notes
    ):
        return f"the notes {shown(motion.notes)}"
    measures = motion.measures
    if not isinstance(measures, Mapping) or not all(map(_is_number, measures.values())):
        return f"the measures {shown(measures)}"
    return ""


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)


def _line(value: Any) -> str:
    """Return a value as a message shows it, in one line."""
    return " ".join(shown(value).split())
