"""Opening of untrusted files, and parts of messages about them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from ergoqp.errors import RecordingError


@contextmanager
def binary(path: Path) -> Iterator[BinaryIO]:
    """Open a file; raise a RecordingError if that fails."""
    try:
        # Opening a pipe or a device would wait for someone to write.
        if path.exists() and not path.is_file():
            raise RecordingError(f"{str(path)!r} is not a file, allowed the recording file itself")
        file = path.open("rb")
    except FileNotFoundError:
        raise RecordingError(
            f"{path.name}: got no file {str(path)!r}, allowed a recording"
        ) from None
    except (OSError, ValueError) as error:
        raise _unreadable(path, error) from None
    with file:
        try:
            yield file
        except OSError as error:
            raise _unreadable(path, error) from None


def beginning(path: Path, size: int = 4096) -> bytes:
    """Return the first bytes of a file; raise a RecordingError if it cannot be read."""
    with binary(path) as file:
        return file.read(size)


def short(text: str) -> str:
    """Return a quoted text, cut so that a message stays readable."""
    return repr(text if len(text) <= 40 else text[:37] + "...")


def some(names: tuple[str, ...] | list[str], most: int = 12) -> str:
    """Return a list of names in words, cut so that a sentence stays readable."""
    shown = ", ".join(name if len(name) <= 40 else name[:37] + "..." for name in names[:most])
    return shown if len(names) <= most else f"{shown} and {len(names) - most} more"


def _unreadable(path: Path, error: Exception) -> RecordingError:
    reason = getattr(error, "strerror", None) or error
    return RecordingError(
        f"{short(path.name or str(path))} cannot be read: {reason}, allowed a recording"
    )
