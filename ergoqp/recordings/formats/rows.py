"""Tables of numbers in text files, read block by block because an hour of markers is large.

A blank is a value that was not seen. A word in place of a number is an error that names its line.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from ergoqp.recordings.formats.opening import short
from ergoqp.recordings.formats.text_lines import EMPTY, TextLines

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
class Asked:
    """Options that supply what a file may lack.

    Attributes:
        columns: names of the points of a table without names, three numbers each.
        rate: frames per second, used instead of times [Hz].
    """

    columns: tuple[str, ...] = ()
    rate: float | None = None


@dataclass(frozen=True)
class Chosen:
    """The columns of a table that are read.

    Attributes:
        columns: their indices, in the order in which they are returned.
        told: index among them -> function that converts a word to the text of a number; it raises a
            ValueError whose text continues the message after the word.
    """

    columns: Sequence[int]
    told: Mapping[int, Callable[[str], str]] = field(default_factory=dict)


@dataclass
class Gathered:
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
    def whole(self) -> np.ndarray:
        """All rows."""
        assert self._all is not None
        return self._all[: self._count]


def blocks(
    lines: TextLines,
    separator: str | None,
    width: int,
    blanks: bool = False,
    chosen: Chosen | None = None,
) -> Iterator[np.ndarray]:
    """Return the rest of a file as numbers (n, width), NaN for blanks, block by block.

    Blanks at the end of a row may be left out. Empty lines are skipped. If tabs or semicolons
    separate the columns, a comma is a decimal comma.

    Args:
        lines: the file from the next line on.
        separator: separator of the numbers; None for any white space.
        width: numbers in a row.
        blanks: whether a row of separators only is a frame in which nothing was seen.
        chosen: the columns that are read, if not all are.
    """
    decimal = separator in {"\t", ";"}
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
        values = np.array([_values(lines, i, row, separator, width, chosen) for i, row in rows])
        if (large := np.argwhere(np.abs(values) > LARGEST)).size:
            at, column = large[0]
            lines.fail(_too_large(float(values[at, column])), rows[at][0])
        yield values


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
    chosen: Chosen | None,
) -> list[float]:
    """Return the numbers of a row."""
    words = row.split(separator)
    while len(words) > width and not words[-1].strip():
        words.pop()
    count = len(words)
    if count > width or (separator is None and count < width):
        lines.fail(f"got a row of {count} numbers, allowed {width}", line)
    if count < width:
        if line == lines.line and not lines.ends:
            lines.fail(f"got a row of {count} numbers, allowed {width}: the file is cut", line)
        words += [""] * (width - count)
    if chosen is not None:
        words = [words[column] for column in chosen.columns]
        row = row if row.isascii() and "_" not in row else "".join(words)
        for i, number in chosen.told.items():
            words[i] = _told(lines, line, number, words[i])
    # `float` also accepts what no file has: 1_0, and digits of all scripts.
    if "_" not in row and row.isascii():
        try:
            return list(map(float, [word or "nan" for word in words] if "" in words else words))
        except ValueError:
            pass  # words for blanks, quotes, or an error that is named below
    return [_number(lines, line, word.strip().strip('"').strip()) for word in words]


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


def _too_large(value: float) -> str:
    if np.isinf(value):
        return f"got a number that is not finite, allowed numbers up to {LARGEST:g}"
    return f"got {value:g}, which is too large, allowed numbers up to {LARGEST:g}"
