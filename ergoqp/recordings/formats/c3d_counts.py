"""Number of frames of a C3D file.

The header counts to 65 535 only, and often counts the frames of the longer recording from which the
file was cut. Programs state longer counts in three other places (c3d.org, "The C3D frame count").
Of the stated counts, the one that agrees with the file's length is used. No frames are dropped
without a message.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

import numpy as np

from ergoqp.recordings.formats.c3d_head import BLOCK, Head, fail

_LONGEST: Final = 65_535
"""Largest count of a 16-bit word; a file with more frames states this many, or wraps around."""
_LARGEST: Final = 1 << 53


@dataclass(frozen=True)
class _Count:
    """A stated number of frames.

    Attributes:
        frames: the number.
        ended: whether it is the largest that can be stated there.
    """

    frames: int
    ended: bool = False


def frames_of(path: Path, file: BinaryIO, head: Head, size: int) -> tuple[int, tuple[str, ...]]:
    """Return the number of frames of a file, and sentences.

    Args:
        path: the file.
        file: the opened file.
        head: its header.
        size: its size [bytes].

    Raises:
        RecordingError: if the file is cut, or holds more frames than it can count and states no
            long count.
    """
    there = max(size - head.start, 0) // head.frame_bytes
    counts, header = _stated(head), (head.last - head.first + 1) % (_LONGEST + 1)
    if head.last < head.first and header and _fills(header, head, size):
        counts.append(_Count(header))
    fitting = [count for count in counts if _fills(count.frames, head, size)]
    chosen = next(iter(fitting or counts), _Count(0))
    count = chosen.frames
    anew = [header, *(each.frames for each in counts)]
    more = there - count
    if count <= _LONGEST and (
        (fitting and chosen.ended and more and _tail(file, head, count))
        or (not fitting and any(each.ended and there > each.frames for each in counts))
        or (not fitting and any(_begun_anew(each, head, size) for each in anew))
    ):
        fail(
            path,
            f"got {there} frames of which {count} are stated, allowed a long count"
            " (TRIAL:ACTUAL_END_FIELD or POINT:LONG_FRAMES) beyond 65535; export the take with it,"
            " or in parts",
        )
    if not count:
        fail(path, f"got the frames {head.first} to {head.last}, allowed 1 and more")
    if more < 0:
        fail(path, f"got {there} frames, allowed {count} as stated; the file is cut")
    # The rotations of segments are stored after the points.
    if more < 2 + BLOCK // head.frame_bytes or "ROTATION" in head.parameters:
        return count, ()
    return count, (
        f"The file states {count} frames and is long enough for {there}: the data after the stated"
        " frames is left out.",
    )


def _stated(head: Head) -> list[_Count]:
    """Return the counts that a file states, the surest first."""
    short = _whole(head.of("POINT", "FRAMES"))
    trial = [head.of("TRIAL", f"ACTUAL_{which}_FIELD") for which in ("START", "END")]
    counts = [
        _Count(short if short != _LONGEST else 0),
        _Count(_whole(head.of("POINT", "LONG_FRAMES"))),
        _Count(_between(*trial)),
        _Count(short if short == _LONGEST else 0, ended=True),
        _Count(head.last - head.first + 1, ended=head.last == _LONGEST),
    ]
    return [count for count in counts if count.frames > 0]


def _whole(value: object) -> int:
    """Return a count of frames; 0 if there is none."""
    if not isinstance(value, np.ndarray) or not value.size:
        return 0
    if value.dtype.kind != "f":
        return int(value[0]) % (_LONGEST + 1)  # as unsigned
    return int(value[0]) if 1 <= value[0] < _LARGEST else 0


def _between(first: object, last: object) -> int:
    """Return the count from a first to a last frame, each stated in two words; 0 if not so."""
    numbers = []
    for value in (first, last):
        if not isinstance(value, np.ndarray) or value.size != 2 or value.dtype.kind != "i":
            return 0
        low, high = (int(word) % (_LONGEST + 1) for word in value)
        numbers.append(low + (_LONGEST + 1) * high)
    return numbers[1] - numbers[0] + 1


def _left(count: int, head: Head, size: int) -> int:
    """Return the number of bytes after some number of frames."""
    return size - head.start - count * head.frame_bytes


def _fills(count: int, head: Head, size: int) -> bool:
    """Return whether some number of frames fills a file, up to a rest of less than a block."""
    return 0 <= _left(count, head, size) < BLOCK


def _begun_anew(count: int, head: Head, size: int) -> bool:
    """Return whether a file holds a multiple of 65 536 frames more than a count."""
    left = _left(count, head, size)
    round_ = (_LONGEST + 1) * head.frame_bytes
    return count <= _LONGEST and left >= round_ and left % round_ < BLOCK


def _tail(file: BinaryIO, head: Head, count: int) -> bool:
    """Return whether there is other data than zeros after some number of frames."""
    file.seek(head.start + count * head.frame_bytes)
    return any(file.read(BLOCK))
