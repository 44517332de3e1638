"""Tables of numbers in text files, block by block: an hour of markers is much.

A blank is a place that was not seen. A word where a number belongs is a mistake, with its line.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, Final, NoReturn

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.progress import Progress
from ergoqp.recordings.formats.opening import short

_BLOCK: Final = 4000
"""Lines that are read at once."""
_LONGEST: Final = 1 << 20
"""Bytes in a line, at most: what has longer ones is no text."""
_MOST: Final = 16 << 20
"""Bytes that are read at once, about."""
_TOGETHER: Final = 4_000_000
"""Numbers that are made at once, about."""
_LEFT_OUT: Final = 20
"""Numbers that a byte of a file stands for, at most: blanks at the end of rows may be left out."""
_BEARABLE: Final = 100_000_000
"""Numbers that a file may have whatever its size is."""
_EXPECTED: Final = 1 << 31
"""Bytes that are asked for in advance, at most."""
_MARKS: Final = "\t;,"
"""What parts columns, the surest first: a decimal comma is no mark of columns."""
_EMPTY: Final = " \t,;"
_EMPTY_LINES: Final = 1000
"""Empty lines above the numbers, at most."""
_NOTHING: Final = frozenset(
    {"", "nan", "na", "n/a", "#n/a", "null", "none", "-nan", "nan(ind)", "-nan(ind)"}
    | {"1.#qnan", "-1.#ind"}
)
"""Words for a place that was not seen."""
LARGEST: Final = 1e30
"""Nothing that anybody measures is larger."""


@dataclass(frozen=True)
class Asked:
    """What a file may not say and its user can.

    Attributes:
        columns: names of the points of a table without names, three numbers each.
        rate: frames per second where there are no times [Hz].
    """

    columns: tuple[str, ...] = ()
    rate: float | None = None


@dataclass
class TextLines:
    """The lines of a text file, counted.

    Attributes:
        path: the file.
        file: it, opened.
        size: its size [bytes].
        progress: told how much of it is read.
        line: number of the last line that was read.
        ends: whether that line has an end; the last one of a file that is cut has none.
    """

    path: Path
    file: BinaryIO
    size: int
    progress: Progress
    line: int = 0
    ends: bool = True
    _again: list[str] = field(default_factory=list)

    def put_back(self, row: str) -> None:
        """Let the last line be read once more."""
        self._again.append(row)
        self.line -= 1

    def peek(self) -> str:
        """Return the next line that is not empty, which stays to be read; "" if there is none."""
        for _ in range(_EMPTY_LINES):
            rows = self.take(1)
            if rows and rows[0].strip(_EMPTY):
                self.put_back(rows[0])
                return rows[0]
        return ""

    def next(self, wanted: str) -> str:
        """Return the next line, without what ends it.

        Args:
            wanted: what it should be, for the message.
        """
        lines = self.take(1)
        if not lines:
            raise RecordingError(
                f"{self.path.name}: the file ends in line {self.line}, required is {wanted}"
            )
        return lines[0]

    @property
    def share(self) -> float:
        """How much of the file is read, from 0 to 1."""
        return min(self.file.tell() / self.size, 1.0) if self.size else 1.0

    def take(self, count: int) -> list[str]:
        """Return the next lines, at most so many."""
        if self._again:
            self.line += 1
            return [self._again.pop()]
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
        self.ends = raw[-1].endswith(b"\n")
        self._check(raw[0], raw[-1], first)
        try:
            text = b"".join(raw).decode("utf-8-sig" if first else "utf-8")
        except UnicodeDecodeError:
            # What Windows programs write where names have accents; every byte is a letter of it.
            text = b"".join(raw).decode("latin-1")
        self.progress(self.share)
        # Not splitlines: for it more than these end a line, and lines would be counted wrongly.
        return text.replace("\r\n", "\n").removesuffix("\n").split("\n")

    def _check(self, begin: bytes, end: bytes, first: bool) -> None:
        if first and begin.startswith((b"\xff\xfe", b"\xfe\xff")):
            self.fail("got text in UTF-16, allowed UTF-8: save the file as such", 1)
        if first and b"\n" not in begin and begin.count(b"\r") > 1:
            self.fail("got lines that end in a carriage return alone, allowed line feeds", 1)
        if len(end) >= _LONGEST and not self.ends:
            self.fail(f"got a line of more than {_LONGEST >> 20} MB, allowed a text with rows")

    def fail(self, problem: str, line: int | None = None) -> NoReturn:
        """Say what is wrong with a line, the last one if no other is given."""
        at = self.line if line is None else line
        raise RecordingError(f"{self.path.name}, line {at}: {problem}")


@dataclass
class Gathered:
    """Blocks that become one array, begun as large as it will be: they are there only once."""

    _all: np.ndarray | None = None
    _count: int = 0

    def add(self, block: np.ndarray, share: float) -> None:
        """Add a block (n, ...).

        Args:
            block: rows.
            share: of the file that is read with them, from 0 to 1.
        """
        count = self._count + len(block)
        if self._all is None or count > len(self._all):
            before = self._all
            # What is not filled takes no memory.
            expected = min(1.2 * count / max(share, 1e-9), _EXPECTED / max(block[:1].nbytes, 1))
            least = count if before is None else count + count // 4
            self._all = np.empty((max(least, int(expected)), *block.shape[1:]), dtype=block.dtype)
            if before is not None:
                self._all[: self._count] = before[: self._count]
        self._all[self._count : count] = block
        self._count = count

    def __len__(self) -> int:
        """Return the number of rows."""
        return self._count

    @property
    def whole(self) -> np.ndarray:
        """All rows."""
        assert self._all is not None
        return self._all[: self._count]


def blocks(
    lines: TextLines, separator: str | None, width: int, blanks: bool = False
) -> Iterator[np.ndarray]:
    """Return the rest of a file as numbers (n, width), NaN for blanks, block by block.

    Blanks at the end of a row may be left out. Empty lines are skipped. Where columns are parted
    by tabs or semicolons, a comma is a decimal one.

    Args:
        lines: what is not read yet.
        separator: what parts numbers; None for any white space.
        width: numbers in a row.
        blanks: whether a row of nothing but separators is a frame, in which nothing was seen.
    """
    decimal = separator in {"\t", ";"}
    count = 0
    while text := lines.take(min(_BLOCK, _TOGETHER // width + 1)):
        first = lines.line - len(text) + 1
        rows = [
            (i, row.replace(",", ".") if decimal else row)
            for i, row in enumerate(text, first)
            if row.strip(_EMPTY) or (blanks and separator is not None and separator in row)
        ]
        if not rows:
            continue
        count += len(rows) * width
        if count > max(_BEARABLE, _LEFT_OUT * lines.file.tell()):
            lines.fail(f"got rows with hardly any number, allowed {width} in each")
        values = np.array([_values(lines, i, row, separator, width) for i, row in rows])
        if (large := np.flatnonzero((np.abs(values) > LARGEST).any(axis=1))).size:
            lines.fail("got a number that is not finite, allowed finite ones", rows[large[0]][0])
        yield values


def separator_of(*rows: str) -> str | None:
    """Return what parts the columns of the first row that has such a mark; None: white space."""
    return next((mark for row in rows for mark in _MARKS if mark in row), None)


def cells(row: str, separator: str | None) -> list[str]:
    """Return the words of a row above the numbers, without quotes and the space around them."""
    words = row.split(separator)
    if separator is not None and '"' in row:
        with suppress(csv.Error):  # of a stray carriage return, or a cell beyond all reason
            words = next(csv.reader([row], delimiter=separator, skipinitialspace=True), words)
    return [word.strip().strip('"').strip() for word in words]


def count_of(text: str) -> int | None:
    """Return the whole number that a file states; None if it states none."""
    return int(text[:18]) if text.isascii() and text.isdigit() else None


def is_number(word: str) -> bool:
    """Return whether a word is a number, with a decimal comma or point."""
    try:
        float(word.replace(",", "."))
    except ValueError:
        return False
    return "_" not in word and word.isascii()


def is_nothing(word: str) -> bool:
    """Return whether a word stands for a place that was not seen."""
    return word.lower() in _NOTHING


def _values(
    lines: TextLines, line: int, row: str, separator: str | None, width: int
) -> list[float]:
    """Return the numbers of a row."""
    words = row.split(separator)
    while len(words) > width and not words[-1].strip():
        words.pop()
    # `float` takes more for numbers than anybody writes into files: 1_0, and digits of all scripts.
    if len(words) == width and "_" not in row and row.isascii():
        try:
            return list(map(float, [word or "nan" for word in words] if "" in words else words))
        except ValueError:
            pass  # words for blanks, quotes, or a mistake that is to be named
    if len(words) > width or (separator is None and len(words) < width):
        lines.fail(f"got a row of {len(words)} numbers, allowed {width}", line)
    if len(words) < width and line == lines.line and not lines.ends:
        lines.fail(f"got a row of {len(words)} numbers, allowed {width}: the file is cut", line)
    values = [_number(lines, line, word.strip().strip('"').strip()) for word in words]
    return values + [np.nan] * (width - len(words))


def _number(lines: TextLines, line: int, word: str) -> float:
    if is_nothing(word):
        return float("nan")
    if not is_number(word) or "," in word:
        lines.fail(f"got {short(word)}, allowed a number", line)
    value = float(word)
    if not abs(value) <= LARGEST:
        lines.fail(f"got {short(word)}, allowed a finite number", line)
    return value
