"""Text of unknown origin: encodings, numbered lines and tables of numbers.

Tables are read block by block, because an hour of markers is large. A blank is a value that was not
seen. A word in place of a number is an error that names its line.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, Final, NoReturn

import numpy as np

from ergoqp.arguments import Progress
from ergoqp.errors import RecordingError

BAG_MARKS: Final = {b"#ROSBAG V": ".bag", b"SQLite format 3\0": ".db3", b"\x89MCAP0\r\n": ".mcap"}
"""First bytes of a ROS bag's file -> the ending that rosbags expects."""


@contextmanager
def binary(path: Path) -> Iterator[BinaryIO]:
    """Open a file; raise a RecordingError if that fails."""
    try:
        # Opening a pipe or a device would wait for someone to write.
        if path.exists() and not path.is_file():
            raise RecordingError(f"{str(path)!r} is not a file; give the recording file itself")
        file = path.open("rb")
    except FileNotFoundError:
        raise RecordingError(f"{path}: no such file") from None
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


def some(names: tuple[str, ...] | list[str], most: int = 12, longest: int = 40) -> str:
    """Return a list of names in words, cut so that a sentence stays readable."""
    cut = (name if len(name) <= longest else name[: longest - 3] + "..." for name in names[:most])
    shown = ", ".join(cut)
    return shown if len(names) <= most else f"{shown} and {len(names) - most} more"


def _unreadable(path: Path, error: Exception) -> RecordingError:
    reason = getattr(error, "strerror", None) or error
    return RecordingError(f"{short(path.name or str(path))}: cannot be read: {reason}")


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


@contextmanager
def text_lines(path: Path, progress: Progress) -> Iterator[TextLines]:
    """Open a text file; raise a RecordingError if that fails."""
    with binary(path) as file:
        yield TextLines(path, file, path.stat().st_size, progress)


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


_BLOCK: Final = 4000
"""Lines that are read at once."""
_TOGETHER: Final = 4_000_000
"""Numbers that are parsed at once, about."""
_LEFT_OUT: Final = 20
"""Largest number of values per byte of a file: blanks at the end of rows may be left out."""
_BEARABLE: Final = 100_000_000
"""Number of values that a file of any size may have."""
_EXPECTED: Final = 1 << 31
"""Largest number of bytes that are allocated in advance."""
_MARKS: Final = "\t;,"
"""Separators of columns, the surest first, because a comma may be a decimal comma."""
_NOTHING: Final = frozenset(
    {"", "nan", "na", "n/a", "#n/a", "null", "none", "-nan", "nan(ind)", "-nan(ind)"}
    | {"1.#qnan", "-1.#ind"}
)
"""Words for a value that was not seen."""
LARGEST: Final = 1e30
"""Largest number that is accepted as a measurement."""


@dataclass(frozen=True)
class TableOptions:
    """Options that supply what a file may lack.

    Attributes:
        columns: names of the points of a table without names, three numbers each.
        rate: frames per second, used instead of times [Hz].
        trust: what is right although it looks impossible (see `ergoqp.load_recording`).
        subject: the person who is read, for formats in which each person has own times.
    """

    columns: tuple[str, ...] = ()
    rate: float | None = None
    trust: frozenset[str] = frozenset()
    subject: str | None = None


ChosenColumn = tuple[int, Callable[[str], str] | None]
"""Index of a column that is read, and the function that converts its words to the text of a number,
if they are not numbers; it raises a ValueError whose text continues the message after the word."""


@dataclass
class GrowableArray:
    """Blocks that become one array, allocated at its expected size to hold each block only once."""

    _all: np.ndarray | None = None
    _count: int = 0

    def add(self, block: np.ndarray, share: float) -> None:
        """Add a block (n, ...).

        Args:
            block: the rows.
            share: share of the file that is read up to their end, from 0 to 1.
        """
        count = self._count + len(block)
        if self._all is None or count > len(self._all):
            before = self._all
            # The part that is not filled takes no memory.
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
    def view(self) -> np.ndarray:
        """All rows."""
        assert self._all is not None
        return self._all[: self._count]


def read_rows(
    lines: TextLines,
    separator: str | None,
    width: int,
    split: Callable[[np.ndarray], Sequence[np.ndarray]],
    blanks: bool = False,
    chosen: Sequence[ChosenColumn] | None = None,
    further: list[int] | None = None,
) -> list[np.ndarray]:
    """Return the rest of a file as arrays, into which `split` splits a block of rows (n, width).

    A blank is NaN. Blanks at the end of a row may be left out. Empty lines are skipped. If tabs or
    semicolons separate the columns, a comma is a decimal comma.

    Args:
        lines: the file from the next line on.
        separator: separator of the numbers; None for any white space.
        width: numbers in a row.
        split: function that returns the next rows of each array.
        blanks: whether a row of separators only is a frame in which nothing was seen.
        chosen: the columns that are read, in the order in which they are split, if not all are.
        further: gets for each row that is wider by whole points their number; they are left out.
            None: such a row is wrong, and so is it where white space separates the numbers, which
            does not show what is blank.

    Raises:
        RecordingError: if there is no row, or a row is wrong.
    """
    decimal = separator in {"\t", ";"}
    arrays: list[GrowableArray] = []
    count = 0
    while text := lines.take(min(_BLOCK, _TOGETHER // width + 1)):
        first = lines.line - len(text) + 1
        rows = [
            (i, row.replace(",", ".") if decimal else row)
            for i, row in enumerate(text, first)
            if row.strip(EMPTY) or (blanks and separator is not None and separator in row)
        ]
        if not rows:
            continue
        count += len(rows) * width
        if count > max(_BEARABLE, _LEFT_OUT * lines.file.tell()):
            lines.fail(f"got rows with hardly any numbers, allowed {width} in each")
        values = np.array(
            [_values(lines, i, row, separator, width, chosen, further) for i, row in rows]
        )
        if (large := np.argwhere(np.abs(values) > LARGEST)).size:
            at, column = large[0]
            value = values[at, column]
            got = f"{value:g}, which is too large"
            if np.isinf(value):
                got = "a number that is not finite"
            lines.fail(f"got {got}, allowed numbers up to {LARGEST:g}", rows[at][0])
        parts = split(values)
        arrays = arrays or [GrowableArray() for _ in parts]
        for array, part in zip(arrays, parts, strict=True):
            array.add(part, lines.share)
    if not arrays:
        raise RecordingError(
            f"{lines.path.name}: got no row of numbers, allowed a row for each frame"
        )
    return [array.view for array in arrays]


def points_of(values: np.ndarray) -> np.ndarray:
    """Return numbers (n, 3 m) as positions (n, m, 3) in 32 bits."""
    return values.astype(np.float32).reshape(len(values), -1, 3)


def separator_of(*rows: str) -> str | None:
    """Return the separator of the first row that has one of `_MARKS`; None: white space."""
    return next((mark for row in rows for mark in _MARKS if mark in row), None)


def cells(row: str, separator: str | None) -> list[str]:
    """Return the words of a row above the numbers, without quotes and the space around them."""
    words = row.split(separator)
    if separator is not None and '"' in row:
        with suppress(csv.Error):  # a stray carriage return, or a cell that is too long
            words = next(csv.reader([row], delimiter=separator, skipinitialspace=True), words)
    return [word.strip().strip('"').strip() for word in words]


def count_of(text: str) -> int | None:
    """Return the whole number in a text; None if it is not one."""
    return int(text[:18]) if text.isascii() and text.isdigit() else None


def is_number(word: str) -> bool:
    """Return whether a word is a number, with a decimal comma or point."""
    try:
        float(word.replace(",", "."))
    except ValueError:
        return False
    return "_" not in word and word.isascii()


def is_nothing(word: str) -> bool:
    """Return whether a word stands for a value that was not seen."""
    return word.lower() in _NOTHING


def _values(
    lines: TextLines,
    line: int,
    row: str,
    separator: str | None,
    width: int,
    chosen: Sequence[ChosenColumn] | None,
    further: list[int] | None,
) -> list[float]:
    """Return the numbers of a row."""
    words = row.split(separator)
    while len(words) > width and not words[-1].strip():
        words.pop()
    count, decimal = len(words), commas(separator, len(words), width)
    points, part = divmod(count - width, 3)
    if further is not None and separator is not None and points > 0 and not part and not decimal:
        further.append(points)
        words = words[:width]
        count, row = width, separator.join(words)
    if count > width or (separator is None and count < width):
        lines.fail(f"got a row of {count} numbers, allowed {width}{decimal}", line)
    if count < width and line == lines.line and not lines.ends:
        lines.fail(f"got a row of {count} numbers, allowed {width}: the file is cut", line)
    words += [""] * (width - count)
    if chosen is not None:
        words = [
            words[column] if number is None else _told(lines, line, number, words[column])
            for column, number in chosen
        ]
        row = "".join(words)
    # `float` also accepts what no file has: 1_0, and digits of all scripts.
    if "_" not in row and row.isascii():
        try:
            return list(map(float, [word or "nan" for word in words] if "" in words else words))
        except ValueError:
            pass  # words for blanks, quotes, or an error that is named below
    return [_number(lines, line, word.strip().strip('"').strip()) for word in words]


def commas(separator: str | None, count: int, width: int) -> str:
    """Return the end of a message if a row looks as if a comma were the decimal mark, too.

    Args:
        separator: separator of the columns.
        count: numbers in the row.
        width: columns that the head names.
    """
    if separator != "," or count < 2 * width - 2:
        return ""
    return (
        ": a comma seems to be the decimal mark, too; export the table with decimal points, or with"
        " semicolons between the columns"
    )


def _told(lines: TextLines, line: int, number: Callable[[str], str], word: str) -> str:
    """Return the number that a word stands for."""
    word = word.strip().strip('"').strip()
    if is_nothing(word):
        return "nan"
    try:
        return number(word)
    except ValueError as error:
        lines.fail(f"got {short(word)} {error}", line)


def _number(lines: TextLines, line: int, word: str) -> float:
    if is_nothing(word):
        return float("nan")
    if not is_number(word) or "," in word:
        lines.fail(f"got {short(word)}, allowed a number", line)
    return float(word)
