"""Recognition and opening of ROS bags, and the errors for broken ones.

rosbags recognises a bag by its ending. Here the content decides.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from ergoqp.errors import ErgoqpError, RecordingError
from ergoqp.recordings.formats.opening import beginning, short

MARKS: Final = {b"#ROSBAG V": ".bag", b"SQLite format 3\0": ".db3", b"\x89MCAP0\r\n": ".mcap"}
"""First bytes of a bag's file -> the ending that rosbags expects."""
_STORAGES: Final = (".db3", ".mcap")
_METADATA: Final = "metadata.yaml"
_SPECIAL: Final = "?#%"
"""Characters with a meaning in the URI by which rosbags passes a name to SQLite."""


def is_bag(path: Path) -> bool:
    """Return whether a file or folder is a ROS bag, by its ending or its metadata.

    A folder without metadata is a bag if it contains files of a bag and nothing else.
    """
    if not os.path.isdir(path):  # `Path.is_dir` raises if a name is too long
        return path.suffix.lower() in MARKS.values()
    metadata = path / _METADATA
    if metadata.is_file() and b"rosbag2_bagfile_information" in beginning(metadata):
        return True
    others = [
        each
        for each in _entries(path)
        # SQLite writes further files beside its own: take.db3-wal, take.db3-shm.
        if not each.suffix.startswith(_STORAGES) and each.name != _METADATA
    ]
    return bool(_storages(path)) and not others


def sources_of(path: Path, stack: ExitStack) -> list[Path]:
    """Return the paths that rosbags has to open: a file, a folder, or the files of a folder.

    Args:
        path: the bag.
        stack: removes, when it closes, the link that gives a file the name that rosbags expects.

    Raises:
        RecordingError: if there is no bag, or a file of that name cannot be opened.
    """
    if not os.path.isdir(path):
        return [_known_file(path, stack)]
    files = _storages(path)
    # rosbags takes every path with the ending .bag for a file of ROS 1.
    whole = (path / _METADATA).is_file() and path.suffix != ".bag"
    sources = [path] if whole else files
    if not sources:
        raise RecordingError(
            f"{path.name}: got a folder without metadata.yaml, .db3 or .mcap, allowed a ROS bag"
        )
    marks = [mark for mark in _SPECIAL if mark in str(path)]
    if marks and any(file.suffix == ".db3" for file in files):
        raise RecordingError(
            f"{short(str(path))}: got {marks[0]} in the path of a .db3 file, allowed a path without"
            " it"
        )
    return sources


@contextmanager
def faults(path: Path) -> Iterator[None]:
    """Turn any exception of a reader into one sentence that says what is wrong with a bag."""
    try:
        yield
    except ErgoqpError:
        raise
    except Exception as error:  # of rosbags, SQLite or YAML, or any other that broken bytes cause
        raise RecordingError(f"{path.name}: {_fault(error)}, allowed a whole ROS bag") from None


def _fault(error: Exception) -> str:
    """Return in words what an exception means for a bag."""
    # Only an OSError of the system has a number; archive readers raise others, without one.
    if isinstance(error, OSError) and error.errno and error.strerror:
        return f"got a bag that cannot be read ({error.strerror})"
    said = " ".join(str(error).split())
    if "not indexed" in said:
        return "got a bag without an index, because its recording was cut off"
    if "missing: [" in said:
        return "got a metadata.yaml that names missing files"
    if "support" in said.lower():
        return f"got a bag of a kind that rosbags does not read ({said.partition(';')[0][:80]})"
    return "got a bag that is damaged or cut off"


def _known_file(path: Path, stack: ExitStack) -> Path:
    """Return a bag's file under a name that rosbags accepts."""
    first = beginning(path, max(map(len, MARKS)))
    ending = next((ending for mark, ending in MARKS.items() if first.startswith(mark)), None)
    if ending is None:
        raise RecordingError(
            f"{path.name}: got a file that does not begin like a bag, allowed a whole ROS bag"
        )
    if path.suffix == ending and not any(mark in str(path) for mark in _SPECIAL):
        return path
    folder = Path(stack.enter_context(TemporaryDirectory(prefix="ergoqp-bag-")))
    named = folder / f"bag{ending}"
    try:
        named.symlink_to(path.resolve())
    except OSError as error:  # not every system allows links to everybody
        raise RecordingError(
            f"{path.name}: got a name that rosbags does not accept and that cannot be linked"
            f" ({error.strerror}), allowed a name that ends in {ending} and has none of {_SPECIAL}"
        ) from None
    return named


def _storages(folder: Path) -> list[Path]:
    return sorted(path for path in _entries(folder) if path.suffix in _STORAGES)


def _entries(folder: Path) -> list[Path]:
    """Return the entries of a folder that are not hidden."""
    try:
        return [path for path in folder.iterdir() if not path.name.startswith(".")]
    except OSError as error:
        raise RecordingError(
            f"{folder.name} cannot be read: {error.strerror}, allowed a folder"
        ) from None
