"""Files in the format MCAP: their records, as far as they are whole."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Final

from ergoqp.errors import MissingExtraError

MAGIC: Final = b"\x89MCAP0\r\n"
"""First bytes of such a file."""

_LARGEST: Final = 1 << 28
"""Largest record [bytes]; a larger one is no record."""

_HEADER: Final = 1
"""Number of the record that comes first."""


@dataclass(frozen=True)
class Unreadable:
    """Stands for records that are damaged, or for the end of a file that was cut off.

    Attributes:
        cut_off: whether nothing follows.
    """

    cut_off: bool


def profile_of(first: bytes) -> str | None:
    """Return the profile of an MCAP file by its first bytes; None if it is no such file."""
    start = len(MAGIC) + 9
    if not first.startswith(MAGIC) or first[len(MAGIC) : len(MAGIC) + 1] != bytes([_HEADER]):
        return None
    length = int.from_bytes(first[start : start + 4], "little")
    return first[start + 4 : start + 4 + length].decode("utf-8", "replace")


def check_installed(what: str) -> None:
    """Raise an error if the package for MCAP files is not installed.

    Args:
        what: what needs it, for the message.

    Raises:
        MissingExtraError: if so.
    """
    try:
        import mcap.writer as _  # noqa: F401
    except ImportError as error:
        raise MissingExtraError(what, "service", (error.name or "mcap").partition(".")[0]) from None


def mcap_records(file: BinaryIO) -> Iterator[Any]:
    """Yield the records of an MCAP file in order, those within chunks too.

    The file is read from its start, so it needs no index. A damaged chunk is left out, and a file
    that was cut off ends where it was: in both cases an `Unreadable` is yielded instead.

    Args:
        file: the file; the package for MCAP files has to be installed.
    """
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader, breakup_chunk

    reader = StreamReader(file, emit_chunks=True, record_size_limit=_LARGEST)
    try:
        for record in reader.records:
            if not isinstance(record, Chunk):
                yield record
                continue
            try:
                parts = breakup_chunk(record, validate_crc=True)
            except Exception:  # whatever broken bytes cause
                yield Unreadable(cut_off=False)
                continue
            yield from parts
    except GeneratorExit:
        raise
    except Exception:  # the same, or the end of the file where a record should be
        yield Unreadable(cut_off=True)


def open_mcap(path: Path, what: str) -> BinaryIO:
    """Return an open MCAP file.

    Args:
        path: the file.
        what: what needs the package for such files, for the message.

    Raises:
        MissingExtraError: if that package is not installed.
        OSError: if the file cannot be opened.
    """
    check_installed(what)
    return open(path, "rb")


__all__ = ["MAGIC", "Unreadable", "check_installed", "mcap_records", "open_mcap", "profile_of"]
