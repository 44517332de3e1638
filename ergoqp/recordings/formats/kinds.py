"""Format of a recording, from its content, because endings are often wrong."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from ergoqp.errors import RecordingError
from ergoqp.progress import Progress
from ergoqp.recordings.bvh.read import read_bvh
from ergoqp.recordings.formats.bag import read_bag
from ergoqp.recordings.formats.bag_files import MARKS, is_bag
from ergoqp.recordings.formats.bodies import is_folder_of_bodies, read_bodies
from ergoqp.recordings.formats.c3d import read_c3d
from ergoqp.recordings.formats.c3d_head import is_c3d
from ergoqp.recordings.formats.motive import read_motive
from ergoqp.recordings.formats.mvnx import read_mvnx
from ergoqp.recordings.formats.nexus import read_nexus, section_of
from ergoqp.recordings.formats.opening import beginning
from ergoqp.recordings.formats.rows import Asked, is_number
from ergoqp.recordings.formats.storage import read_storage
from ergoqp.recordings.formats.table import read_table
from ergoqp.recordings.formats.trc import read_trc
from ergoqp.recordings.motion import JointMotion
from ergoqp.registry import registered

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
        read: its reader.
    """

    title: str
    endings: tuple[str, ...]
    read: Callable[[Path, Progress, Asked], JointMotion]


BVH: Final = Kind("BVH", (".bvh",), lambda path, progress, asked: read_bvh(path, progress))
C3D: Final = Kind("C3D", (".c3d",), read_c3d)
TRC: Final = Kind("TRC", (".trc",), read_trc)
STORAGE: Final = Kind("OpenSim motion", (".mot", ".sto"), read_storage)
MVNX: Final = Kind("MVNX", (".mvnx",), read_mvnx)
MOTIVE: Final = Kind("Motive CSV", (".csv",), read_motive)
NEXUS: Final = Kind("Nexus CSV", (".csv",), read_nexus)
TABLE: Final = Kind("table", (".csv", ".tsv", ".txt"), read_table)
BAG: Final = Kind("ROS bag", (".bag", ".db3", ".mcap"), read_bag)
BODIES: Final = Kind("folder of poses", (), read_bodies)
KINDS: Final = (BVH, C3D, TRC, STORAGE, MVNX, MOTIVE, NEXUS, TABLE, BAG, BODIES)
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
        if is_bag(path):
            return BAG
        if is_folder_of_bodies(path):
            return BODIES
        raise RecordingError(
            f"{str(path)!r} is a folder, allowed the recording file itself, a bag's folder or one"
            " with a table of poses (x, y, z, q0, q1, q2, q3) for each body"
        )
    ending = path.suffix.lower()
    of_ending = next((kind for kind in KINDS if ending in kind.endings), None)
    if of_ending is not None and not os.path.isfile(path):
        return of_ending  # its reader raises the error
    first = beginning(path, _LOOKED_AT)
    if first.startswith(_COMPRESSED):
        if first.startswith(b"PK") and any(word in first for word in _SHEETS):
            raise RecordingError(
                f"{path.name} is a file of a spreadsheet program, allowed the recording as text:"
                " save it as CSV"
            )
        raise RecordingError(
            f"{path.name} is compressed, allowed the recording itself: unpack it first"
        )
    found = _marked(first)
    if found is None and of_ending is MOTIVE:
        return TABLE
    if found is None and of_ending is None and _is_table(first):
        return TABLE
    if found is None and of_ending is None:
        own = [f".{name}" for name in registered("reader")]
        endings = dict.fromkeys([*(each for kind in KINDS for each in kind.endings), *own])
        raise RecordingError(
            f"{path.name}: got the ending {path.suffix!r} and the content of no known format,"
            f" allowed {', '.join(endings)}"
        )
    kind = found or of_ending
    assert kind is not None
    return kind


def _marked(first: bytes) -> Kind | None:
    """Return the format whose mark is at the start of a file; None if there is none."""
    if first.startswith(tuple(MARKS)):
        return BAG
    if is_c3d(first):
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
    if section_of(text.partition("\n")[0]):
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
