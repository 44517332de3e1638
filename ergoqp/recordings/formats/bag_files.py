"""Which files are ROS bags, how rosbags is to open them, and what is said of broken ones.

rosbags knows a bag by its ending; here what is in it decides.
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
"""What a file of a bag begins with -> the ending by which rosbags knows it."""
_STORAGES: Final = (".db3", ".mcap")
_METADATA: Final = "metadata.yaml"
_SPECIAL: Final = "?#%"
"""rosbags hands SQLite the name as an address, in which these have a meaning."""


def is_bag(path: Path) -> bool:
    """Return whether a file or folder is a ROS bag, by its ending or its metadata.

    A folder without metadata is one if it has files of a bag and nothing else.
    """
    if not os.path.isdir(path):  # where a name is too long `Path.is_dir` raises
        return path.suffix.lower() in MARKS.values()
    metadata = path / _METADATA
    if metadata.is_file() and b"rosbag2_bagfile_information" in beginning(metadata):
        return True
    others = [
        each
        for each in _entries(path)
        # SQLite keeps files beside its own: take.db3-wal, take.db3-shm.
        if not each.suffix.startswith(_STORAGES) and each.name != _METADATA
    ]
    return bool(_storages(path)) and not others


def sources_of(path: Path, stack: ExitStack) -> list[Path]:
    """Return what rosbags is to open: a file, a folder, or the files of a folder.

    Args:
        path: the bag.
        stack: takes away, when it closes, the names by which rosbags knows a file of another name.

    Raises:
        RecordingError: there is no bag, or its name cannot be opened.
    """
    if not os.path.isdir(path):
        return [_known_file(path, stack)]
    files = _storages(path)
    # rosbags takes whatever is called so for a file of ROS 1.
    whole = (path / _METADATA).is_file() and path.suffix != ".bag"
    sources = [path] if whole else files
    if not sources:
        raise RecordingError(
            f"{path.name}: got a folder without metadata.yaml, .db3 or .mcap, allowed a ROS bag"
        )
    marks = [mark for mark in _SPECIAL if mark in str(path)]
    if marks and any(file.suffix == ".db3" for file in files):
        raise RecordingError(
            f"{short(str(path))}: got {marks[0]} in the name of a .db3, allowed are names without"
        )
    return sources


@contextmanager
def faults(path: Path) -> Iterator[None]:
    """Say in one sentence that a bag is broken, whatever a reader of others says about it."""
    try:
        yield
    except ErgoqpError:
        raise
    except Exception as error:  # of rosbags, SQLite or YAML, or what broken bytes lead them to
        raise RecordingError(f"{path.name}: {_fault(error)}, allowed a whole ROS bag") from None


def _fault(error: Exception) -> str:
    """Return what an exception says of a bag."""
    # Only of the system are the words its own: readers of archives have OSError without a number.
    if isinstance(error, OSError) and error.errno and error.strerror:
        return f"got a bag that cannot be read ({error.strerror})"
    said = " ".join(str(error).split())
    if "not indexed" in said:
        return "got a bag without an index: it was cut off while it was recorded"
    if "missing: [" in said:
        return "got a metadata.yaml that names files which are not there"
    if "support" in said.lower():
        return f"got a bag of a kind that rosbags does not read ({said.partition(';')[0][:80]})"
    return "got a bag that is damaged or cut off"


def _known_file(path: Path, stack: ExitStack) -> Path:
    """Return a bag's file under a name that rosbags knows it by."""
    first = beginning(path, max(map(len, MARKS)))
    ending = next((ending for mark, ending in MARKS.items() if first.startswith(mark)), None)
    if ending is None:
        raise RecordingError(
            f"{path.name}: got a file that does not begin as a bag does, allowed a whole ROS bag"
        )
    if path.suffix == ending and not any(mark in str(path) for mark in _SPECIAL):
        return path
    folder = Path(stack.enter_context(TemporaryDirectory(prefix="ergoqp-bag-")))
    named = folder / f"bag{ending}"
    try:
        named.symlink_to(path.resolve())
    except OSError as error:  # not every system lets everybody
        raise RecordingError(
            f"{path.name}: got another name than a bag has, which cannot be linked"
            f" ({error.strerror}), allowed a name that ends in {ending} and has none of {_SPECIAL}"
        ) from None
    return named


def _storages(folder: Path) -> list[Path]:
    return sorted(path for path in _entries(folder) if path.suffix in _STORAGES)


def _entries(folder: Path) -> list[Path]:
    """Return what is in a folder, without what is hidden."""
    try:
        return [path for path in folder.iterdir() if not path.name.startswith(".")]
    except OSError as error:
        raise RecordingError(
            f"{folder.name} cannot be read: {error.strerror}, allowed a folder"
        ) from None
