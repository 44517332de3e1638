"""The reader for a file: by its content, because endings are often wrong, or the user's own."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from importlib import import_module
from numbers import Real
from pathlib import Path
from typing import Any, Final

import numpy as np

from ergoqp.arguments import Progress, shown, unmasked, unseen
from ergoqp.errors import ErgoqpError, RecordingError, in_words
from ergoqp.files.mcap import profile_of
from ergoqp.mocap.fitting.axes import UPS
from ergoqp.mocap.formats.text import BAG_MARKS, TableOptions, beginning, is_number
from ergoqp.mocap.formats.times import FASTEST, LONGEST, SLOWEST
from ergoqp.mocap.recording import JointMotion
from ergoqp.registry import check_free, own_term, registered

_LOOKED_AT: Final = 1 << 17
"""Bytes in which the mark of a format is searched; a C3D file's parameters begin in them."""
_ROW: Final = 6
"""Least number of numbers in a row of a table: two points."""
_COMPRESSED: Final = (
    b"\x1f\x8b",  # gzip
    b"PK\3\4",  # zip
    b"PK\5\6",  # zip, empty
    b"7z\xbc\xaf\x27\x1c",
    b"\xfd7zXZ\0",
    b"BZh",  # bzip2
    b"\x28\xb5\x2f\xfd",  # Zstandard
    b"Rar!\x1a\7",
)
"""First bytes of compressed files."""
_SHEETS: Final = (b"[Content_Types].xml", b"xl/", b"opendocument.spreadsheet")
"""Texts near the start of a zip file that a spreadsheet program has written."""


@dataclass(frozen=True)
class Kind:
    """A format.

    Attributes:
        title: its name in messages.
        endings: endings of its files, in small letters.
        reader: file and function of its reader, which is imported when it is needed.
    """

    title: str
    endings: tuple[str, ...]
    reader: str

    def read(self, path: Path, progress: Progress, asked: TableOptions) -> JointMotion:
        """Read a file of this format."""
        return _function(self.reader)(path, progress, asked)


def _function(name: str) -> Callable[..., Any]:
    file, function = name.split(".")
    return getattr(import_module(f"ergoqp.mocap.formats.{file}"), function)


BVH: Final = Kind("BVH", (".bvh",), "bvh.read_bvh")
C3D: Final = Kind("C3D", (".c3d",), "c3d.read_c3d")
TRC: Final = Kind("TRC", (".trc",), "trc.read_trc")
STORAGE: Final = Kind("OpenSim motion", (".mot", ".sto"), "opensim.read_storage")
MVNX: Final = Kind("MVNX", (".mvnx",), "mvnx.read_mvnx")
MOTIVE: Final = Kind("Motive CSV", (".csv",), "motive.read_motive")
NEXUS: Final = Kind("Nexus CSV", (".csv",), "nexus.read_nexus")
TABLE: Final = Kind("table", (".csv", ".tsv", ".txt"), "table.read_table")
RECORD: Final = Kind("record of the service", (".mcap",), "service_record.read_service_record")
BAG: Final = Kind("ROS bag", (".bag", ".db3", ".mcap"), "bag.read_bag")
KINDS: Final = (BVH, C3D, TRC, STORAGE, MVNX, MOTIVE, NEXUS, TABLE, BAG, RECORD)
"""The formats that are read, with the usual endings of their files."""


def kind_of(path: Path) -> Kind:
    """Return the format of a file or folder.

    If the content has no mark of a format, the ending decides.

    Args:
        path: the file or folder.

    Raises:
        RecordingError: if the format is unknown.
    """
    if os.path.isdir(path):  # `Path.is_dir` raises if a name is too long
        if _function("bag.is_bag_folder")(path):
            return BAG
        raise RecordingError(
            f"{str(path)!r} is a folder; give the recording file itself, a bag's folder or one with"
            " the ending of a reader of your own"
        )
    ending = path.suffix.lower()
    of_ending = next((kind for kind in KINDS if ending in kind.endings), None)
    if of_ending is not None and not os.path.isfile(path):
        return of_ending  # its reader raises the error
    first = beginning(path, _LOOKED_AT)
    if first.startswith(_COMPRESSED):
        if first.startswith(b"PK") and any(word in first for word in _SHEETS):
            raise RecordingError(f"{path.name} is a file of a spreadsheet program; save it as CSV")
        raise RecordingError(f"{path.name} is compressed; unpack it first")
    if found := _marked(first):
        return found
    if of_ending is MOTIVE or (of_ending is None and _is_table(first)):
        return TABLE
    if of_ending is not None:
        return of_ending
    own = [f".{name}" for name in registered("reader")]
    endings = dict.fromkeys([*(each for kind in KINDS for each in kind.endings), *own])
    raise RecordingError(
        f"{path.name}: got the ending {path.suffix!r} and the content of no known format,"
        f" allowed {', '.join(endings)}"
    )


def _marked(first: bytes) -> Kind | None:
    """Return the format whose mark is at the start of a file; None if there is none."""
    if first.startswith(tuple(BAG_MARKS)):
        return RECORD if profile_of(first) == "ergoqp" else BAG
    if first[1:2] == b"P" and _function("c3d.is_c3d")(first):
        return C3D
    text = first.decode("utf-8-sig", "replace").lstrip()
    if text.startswith("HIERARCHY"):
        return BVH
    if text.startswith("PathFileType"):
        return TRC
    if text.startswith("<") and re.search(r"<(\w+:)?mvnx\b", text):
        return MVNX
    if text.startswith(("Format Version", '"Format Version')):
        return MOTIVE
    if _function("nexus.section_of")(text.partition("\n")[0]):
        return NEXUS
    # Line by line, because one pattern over all lines could take very long.
    if any(re.fullmatch(r"\W*endheader\W*", row, re.IGNORECASE) for row in text.split("\n")):
        return STORAGE
    return None


def _is_table(first: bytes) -> bool:
    """Return whether one of the first lines of a text is a row of numbers."""
    if b"\0" in first:
        return False
    lines = first.decode("utf-8-sig", "replace").splitlines()[:20]
    rows = ([word for word in re.split(r"[\s,;]+", line) if word] for line in lines)
    return any(len(row) >= _ROW and all(map(is_number, row)) for row in rows)


_SLACK: Final = 0.1
"""Tolerance for the length of quaternions and axes, which should be one."""
_SLACK_TIME: Final = 0.999
"""Factor on the limits of the time between frames, as a tolerance for rounding."""
_LARGEST: Final = 1e9
"""Largest number in any unit; the square of a much larger one would be infinite."""


def lacking(motion: Any) -> str:
    """Return in words what of a motion violates `JointMotion`, or an empty text."""
    # What follows a violation is not looked at: it would fail, or say the same again.
    return next(_violations(motion), "") if isinstance(motion, JointMotion) else shown(motion)


def _violations(motion: JointMotion) -> Iterator[str]:
    """Yield in words what of a motion violates `JointMotion`."""
    names = motion.names
    listed = isinstance(names, tuple | list) and all(isinstance(n, str) and n for n in names)
    if not listed or not names:
        yield f"the names {_line(names)}"
    if len(set(names)) < len(names):
        yield "a name twice"
    if broken := [name for name in names if name.splitlines() != [name]]:
        yield f"the name {shown(broken[0])}"
    times = _numbers(motion.time)
    if times is None or times.ndim != 1 or not len(times):
        yield f"the times {_line(motion.time)}"
        return
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
            yield f"the {what} {_line(each)}"
        shapes += [(f"{what} of {name}", values, shape) for name, values in each.items()]
    for what, values, shape in shapes:
        if wrong := _no_numbers(values, shape):
            yield f"{what} {wrong}"
    yield from _no_times(_floats(times))
    yield from _no_turns(motion)
    for what, values, _ in shapes[1:]:  # not for positions
        if np.fmax.reduce(np.abs(_floats(values)), axis=None, initial=0.0) > _LARGEST:
            yield f"{what} with a number beyond {_LARGEST:g}"
    yield from _no_words(motion)


def normalised(motion: JointMotion) -> JointMotion:
    """Return a motion that passed `lacking` as arrays of floats, with times from zero.

    Masked elements become NaN, and so does a point with a missing coordinate.
    """
    time, motion = _floats(motion.time).astype(float), motion.mapped(_floats)
    seen = np.isfinite(motion.positions)
    lost = np.asarray(~seen.all(axis=2))
    if (lost & seen.any(axis=2)).any():
        nan = motion.positions.dtype.type(np.nan)
        motion = replace(motion, positions=np.where(lost[:, :, None], nan, motion.positions))
    return replace(
        motion,
        names=tuple(motion.names),
        time=time - time[0],
        rest=None if motion.rest is None else _floats(motion.rest),
        notes=tuple(motion.notes),
        measures=dict(motion.measures),
    )


def _numbers(values: Any) -> np.ndarray | None:
    """Return an array of real numbers, NaN where they are masked; None if it is no such array."""
    try:
        array = unmasked(values)
    except Exception:  # rows of different lengths, or any error of a user's object
        return None
    return array if array.dtype.kind in "iuf" else None


def _floats(values: Any) -> np.ndarray:
    """Return numbers as floats of 64 bits; floats of 32 bits stay as they are."""
    array = unmasked(values)
    kind = np.float32 if (array.dtype.kind, array.dtype.itemsize) == ("f", 4) else np.float64
    with np.errstate(over="ignore"):  # numbers of more than 64 bits may overflow
        return array.astype(kind, copy=False)


def _no_numbers(values: Any, shape: tuple[int, ...]) -> str:
    """Return in words what is wrong with an array that needs a shape, or an empty text."""
    array = _numbers(values)
    if array is None:
        try:
            return f"of shape {np.shape(values)} and not numbers"
        except ValueError:
            return "whose rows differ in length"
    if array.shape != shape:
        return f"of shape {array.shape} and not {shape}"
    return "with infinite numbers" if np.isinf(_floats(array)).any() else ""


def _no_times(times: np.ndarray) -> Iterator[str]:
    """Yield in words what is wrong with times in seconds."""
    if not np.isfinite(times).all() or not (np.diff(times) > 0).all():
        yield "times that do not increase"
    if len(times) > 1:
        step = float(np.median(np.diff(times)))
        if not _SLACK_TIME / FASTEST <= step <= 1 / (_SLACK_TIME * SLOWEST):
            yield f"times that are {step:.3g} s apart and not {1 / FASTEST:g} to {1 / SLOWEST:g} s"
        if times[-1] - times[0] > LONGEST:
            yield f"times over {times[-1] - times[0]:.3g} s and not at most {LONGEST:g} s"


def _no_turns(motion: JointMotion) -> Iterator[str]:
    """Yield in words which orientations or poses of a motion are invalid."""
    for name, turns in motion.turns.items():
        seen = _seen(turns)
        # Large numbers are refused first, because their squares could be infinite.
        if (np.abs(seen) > _SLACK + 1).any() or (
            np.abs(np.linalg.norm(seen, axis=1) - 1) > _SLACK
        ).any():
            yield f"turns of {name} that are not unit quaternions"
    for name, poses in motion.objects.items():
        whole = _seen(poses)
        axes = whole[:, :3, :3]
        if (
            (np.abs(axes) > _SLACK + 1).any()
            or (np.abs(np.einsum("nij,nik->njk", axes, axes) - np.eye(3)) > _SLACK).any()
            or (np.linalg.det(axes) < 0).any()
            or (np.abs(whole[:, 3] - [0, 0, 0, 1]) > _SLACK).any()
        ):
            yield f"objects of {name} that are not poses"


def _seen(values: Any) -> np.ndarray:
    """Return the frames of an array (n, ...) that are complete."""
    array = _floats(values)
    return array[np.isfinite(array).reshape(len(array), -1).all(axis=1)]


def _no_words(motion: JointMotion) -> Iterator[str]:
    """Yield in words which of the other attributes of a motion is invalid."""
    if motion.unit is not None and not (_is_number(motion.unit) and motion.unit > 0):
        yield f"the unit {shown(motion.unit)}"
    if motion.up is not None and not (isinstance(motion.up, str) and motion.up in UPS):
        yield f"the vertical axis {_line(motion.up)}"
    notes, measures = motion.notes, motion.measures
    if not isinstance(notes, tuple | list) or not all(isinstance(note, str) for note in notes):
        yield f"the notes {_line(notes)}"
    if not isinstance(motion.markers, bool | np.bool_):
        yield f"the markers {_line(motion.markers)}"
    if not isinstance(measures, Mapping) or not all(map(_is_number, measures.values())):
        yield f"the measures {_line(measures)}"


def _is_number(value: Any) -> bool:
    number: Any = value
    real = isinstance(value, Real) and not isinstance(value, bool)
    return real and bool(-_LARGEST <= number <= _LARGEST)


def _line(value: Any) -> str:
    """Return a value in one line, for a message."""
    return " ".join(shown(value).split())


READERS: Final = tuple(
    ending[1:] for kind in KINDS if kind is not TABLE for ending in kind.endings if ending != ".csv"
)
"""Endings that a user's own reader cannot have; those of tables are free.

Example:
    >>> from ergoqp.mocap import READERS
    >>> "bvh" in READERS, "c3d" in READERS
    (True, True)
"""


def read_motion(
    path: Path, progress: Progress = unseen, asked: TableOptions | None = None
) -> JointMotion:
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
        return replace(own, notes=(*_unused(asked), *own.notes))
    kind, notes = kind_of(path), []
    # A bag may be a folder, and then has no ending.
    if ending not in kind.endings and not os.path.isdir(path):
        notes.append(
            f"The file is read as {kind.title} because of its content, although its ending is"
            f" {ending or 'none'}."
        )
    if kind is not TABLE:
        notes += _unused(asked)
    motion = kind.read(path, progress, asked or TableOptions())
    return replace(motion, notes=(*notes, *motion.notes))


def _unused(asked: TableOptions | None) -> Iterator[str]:
    """Yield sentences about stated options that all formats but a table ignore."""
    if asked and asked.columns:
        yield "The stated names (columns) are not used: only a table can lack names."
    if asked and asked.rate is not None:
        yield "The stated frames per second (rate) are not used: the file has its own times."


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
        " ergoqp.mocap.recording"
    )
