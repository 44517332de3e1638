"""Numbered lines of text files, in the encodings of several programs."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, Final, NoReturn

from ergoqp.errors import RecordingError
from ergoqp.progress import Progress

EMPTY: Final = " \t,;"
"""Characters of an empty line."""
_EMPTY_LINES: Final = 1000
"""Largest number of empty lines above the numbers."""
_LONGEST: Final = 1 << 20
"""Largest number of bytes in a line; a file with a longer line is not text."""
_MOST: Final = 16 << 20
"""Bytes that are read at once, about."""
_LOOKED_AT: Final = 64
"""Bytes from which UTF-16 without a byte-order mark is recognised."""


@dataclass
class TextLines:
    """The lines of a text file, with their numbers.

    Attributes:
        path: the file.
        file: the opened file.
        size: its size [bytes].
        progress: is called with the share of the file that is read.
        line: number of the last line that was read.
    """

    path: Path
    file: BinaryIO
    size: int
    progress: Progress
    line: int = 0
    _ended: bool = True
    _again: list[str] = field(default_factory=list)

    @property
    def ends(self) -> bool:
        """Whether the last line has an end; the last line of a file that is cut has none."""
        return self._ended or bool(self._again)

    def put_back(self, *rows: str) -> None:
        """Put the last lines back, so that they are read again."""
        self._again.extend(reversed(rows))
        self.line -= len(rows)

    def peek(self) -> str:
        """Return the next line that is not empty and put it back; "" if there is none."""
        for _ in range(_EMPTY_LINES):
            rows = self.take(1)
            if rows and rows[0].strip(EMPTY):
                self.put_back(rows[0])
                return rows[0]
        return ""

    def next(self, wanted: str) -> str:
        """Return the next line, without its end.

        Args:
            wanted: its expected content in words, for the message.
        """
        lines = self.take(1)
        if not lines:
            raise RecordingError(
                f"{self.path.name}: the file ends in line {self.line}, required is {wanted}"
            )
        return lines[0]

    @property
    def share(self) -> float:
        """Share of the file that is read, from 0 to 1."""
        return min(self.file.tell() / self.size, 1.0) if self.size else 1.0

    def take(self, count: int) -> list[str]:
        """Return the next lines, at most `count`."""
        if self._again:
            rows = self._again[: -count - 1 : -1]
            del self._again[-count:]
            self.line += len(rows)
            return rows
        raw: list[bytes] = []
        size = 0
        while len(raw) < count and size < _MOST and (row := self.file.readline(_LONGEST)):
            raw.append(row)
            size += len(row)
            if len(row) >= _LONGEST:
                break
        if not raw:
            return []
        first = not self.line
        self.line += len(raw)
        self._ended = raw[-1].endswith(b"\n")
        self._check(raw[0], raw[-1], first)
        try:
            text = b"".join(raw).decode("utf-8-sig" if first else "utf-8")
        except UnicodeDecodeError:
            # Some Windows programs write this encoding, in which every byte is a letter.
            text = b"".join(raw).decode("latin-1")
        self.progress(self.share)
        # Not splitlines, which knows further line ends: the numbers of the lines would be wrong.
        return text.replace("\r\n", "\n").removesuffix("\n").split("\n")

    def _check(self, begin: bytes, end: bytes, first: bool) -> None:
        marked = begin.startswith((b"\xff\xfe", b"\xfe\xff"))
        if first and (marked or _is_wide(begin[:_LOOKED_AT])):
            self.fail("got text in UTF-16, allowed UTF-8: save the file in UTF-8", 1)
        if first and b"\n" not in begin and begin.count(b"\r") > 1:
            self.fail("got lines that end in a carriage return alone, allowed line feeds", 1)
        if len(end) >= _LONGEST and not self._ended:
            self.fail(f"got a line of more than {_LONGEST >> 20} MB, allowed a text with rows")

    def fail(self, problem: str, line: int | None = None) -> NoReturn:
        """Raise a RecordingError about a line; None: the last one that was read."""
        at = self.line if line is None else line
        raise RecordingError(f"{self.path.name}, line {at}: {problem}")


def _is_wide(text: bytes) -> bool:
    """Return whether every second byte of a text is zero, as in Latin letters of UTF-16."""
    return len(text) > 3 and any(not any(text[i::2]) and all(text[1 - i :: 2]) for i in (0, 1))
