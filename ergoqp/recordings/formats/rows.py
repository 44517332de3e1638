"""Tables of numbers in text files, block by block: an hour of markers is much.

A blank is a place that was not seen. A word where a number belongs is a mistake, with its line.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import BinaryIO, Final, NoReturn

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.progress import Progress
from ergoqp.recordings.formats.opening import short

_BLOCK: Final = 4000
"""Lines that are read at once."""
_NOTHING: Final = frozenset({"", "nan", "na", "null", "none", "-nan", "1.#qnan", "-1.#ind"})
"""Words for a place that was not seen."""
_LARGEST: Final = 1e30
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
        comma: whether numbers have a decimal comma.
    """

    path: Path
    file: BinaryIO
    size: int
    progress: Progress
    line: int = 0
    comma: bool = False
    _again: list[str] = field(default_factory=list)

    def put_back(self, row: str) -> None:
        """Let the last line be read once more."""
        self._again.append(row)
        self.line -= 1

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

    def take(self, count: int) -> list[str]:
        """Return the next lines, at most so many."""
        if self._again:
            self.line += 1
            return [self._again.pop()]
        raw = list(islice(self.file, count))
        first = not self.line
        try:
            text = b"".join(raw).decode("utf-8-sig" if first else "utf-8")
        except UnicodeDecodeError:
            # What Windows programs write where names have accents; every byte is a letter of it.
            text = b"".join(raw).decode("latin-1")
        self.line += len(raw)
        if self.comma:
            text = text.replace(",", ".")
        if self.size:
            self.progress(min(self.file.tell() / self.size, 1.0))
        return text.splitlines() if "\x0b" not in text else text.split("\n")

    def fail(self, problem: str, line: int | None = None) -> NoReturn:
        """Say what is wrong with a line, the last one if no other is given."""
        at = self.line if line is None else line
        raise RecordingError(f"{self.path.name}, line {at}: {problem}")


def blocks(
    lines: TextLines, separator: str | None, width: int, ended: Callable[[str], bool] | None = None
) -> Iterator[np.ndarray]:
    """Return the rest of a file as numbers (n, width), NaN for blanks, block by block.

    Blanks at the end of a row may be left out. Empty lines are skipped.

    Args:
        lines: what is not read yet.
        separator: what parts numbers; None for any white space.
        width: numbers in a row.
        ended: whether a line is no row any more; None: all are.
    """
    while text := lines.take(_BLOCK):
        first = lines.line - len(text) + 1
        rows = [(i, row) for i, row in enumerate(text, first) if row.strip(" \t,;")]
        if ended is not None and (cut := [k for k, (_, row) in enumerate(rows) if ended(row)]):
            rows = rows[: cut[0]]
        if not rows:
            continue
        values = _quickly([row for _, row in rows], separator, width)
        if values is None:
            values = np.array([_slowly(lines, i, row, separator, width) for i, row in rows])
        if (large := np.flatnonzero((np.abs(values) > _LARGEST).any(axis=1))).size:
            lines.fail("got a number that is not finite, allowed finite ones", rows[large[0]][0])
        yield values


def gathered(parts: Sequence[np.ndarray]) -> np.ndarray:
    """Return blocks as one array; they are let go of meanwhile."""
    parts = list(parts)
    whole = np.empty((sum(map(len, parts)), *parts[0].shape[1:]), dtype=parts[0].dtype)
    at = 0
    for i, part in enumerate(parts):
        whole[at : at + len(part)] = part
        at += len(part)
        parts[i] = part[:0]
    return whole


def _quickly(rows: list[str], separator: str | None, width: int) -> np.ndarray | None:
    """Return rows of plain numbers and blanks; None if they are not that plain."""
    text = "\n".join(rows)
    if "_" in text or not text.isascii():
        return None
    if separator is not None:
        mark = re.escape(separator)
        blank = rf"(?:(?<={mark})|^)[ ]*(?={mark}|$)"
        if re.search(blank, text, re.MULTILINE):
            text = re.sub(blank, "nan", text, flags=re.MULTILINE)
    try:
        values = np.loadtxt(
            text.split("\n"), delimiter=separator, ndmin=2, comments=None, dtype=float
        )
    except ValueError:
        return None
    return values if values.shape[1] == width and not np.isinf(values).any() else None


def _slowly(
    lines: TextLines, line: int, row: str, separator: str | None, width: int
) -> list[float]:
    words = [word.strip().strip('"') for word in row.split(separator)]
    while len(words) > width and not words[-1]:
        words.pop()
    if len(words) > width:
        lines.fail(f"got a row of {len(words)} numbers, allowed {width}", line)
    if separator is None and len(words) < width:
        lines.fail(f"got a row of {len(words)} numbers, allowed {width}", line)
    values = [_number(lines, line, word) for word in words]
    return values + [np.nan] * (width - len(words))


def _number(lines: TextLines, line: int, word: str) -> float:
    if word.lower() in _NOTHING:
        return float("nan")
    try:
        if "_" in word or not word.isascii():
            raise ValueError
        value = float(word)
    except ValueError:
        lines.fail(f"got {short(word)}, allowed a number", line)
    if not abs(value) <= _LARGEST:
        lines.fail(f"got {short(word)}, allowed a finite number", line)
    return value
