"""Text of unknown origin: encodings, numbered lines, tables of numbers, times and poses.

Tables are read block by block, because an hour of markers is large. A blank is a value that was not
seen. A word in place of a number is an error that names its line.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, Final, NoReturn

import numpy as np
from scipy.spatial.transform import Rotation

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
    """

    columns: tuple[str, ...] = ()
    rate: float | None = None
    trust: frozenset[str] = frozenset()


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
        values = np.array([_values(lines, i, row, separator, width, chosen) for i, row in rows])
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
) -> list[float]:
    """Return the numbers of a row."""
    words = row.split(separator)
    while len(words) > width and not words[-1].strip():
        words.pop()
    count = len(words)
    if count > width or (separator is None and count < width):
        lines.fail(f"got a row of {count} numbers, allowed {width}", line)
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


def poses_of(positions: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Return poses (n, 4, 4) from positions (n, 3) and quaternions x, y, z, w (n, 4).

    NaN where one of them is not seen. The data type is that of the positions.
    """
    poses = np.full((len(positions), 4, 4), np.nan, dtype=positions.dtype)
    poses[:, 3] = [0, 0, 0, 1]
    poses[:, :3, 3] = positions
    seen = np.isfinite(turns).all(axis=1) & (np.linalg.norm(turns, axis=1) > 0.5)
    if seen.any():
        poses[seen, :3, :3] = Rotation.from_quat(turns[seen]).as_matrix()
    return poses


def unit_turns(turns: np.ndarray) -> np.ndarray:
    """Return quaternions (..., 4) of length 1, NaN where their length is not 1 to within 0.1."""
    # Large numbers are excluded first, because their squares could be infinite.
    sane = (np.abs(turns) < 2).all(axis=-1, keepdims=True)
    size = np.linalg.norm(np.where(sane, turns, 0), axis=-1, keepdims=True)
    return np.where(np.abs(size - 1) < 0.1, turns / np.where(size > 0, size, 1), np.nan)


_UNITS: Final = {1.0: "seconds", 1e-3: "milliseconds", 1e-6: "microseconds", 1e-9: "nanoseconds"}
_SHORTEST, _STAMPS_LONGEST = 0.9e-3, 0.7
"""Limits of the median step between frames [s]: at most one unit gives a step between them."""
SLOWEST, FASTEST = 0.01, 10_000.0
"""Limits of a stated rate [Hz]."""
RATES: Final = f"frames per second from {SLOWEST:g} to {FASTEST:g}"
LONGEST: Final = 1e7
"""Longest duration of a recording: four months [s]."""
_ALIKE: Final = 0.1
"""Relative difference that times and a stated rate may have."""
_OTHERS: Final = 0.02
"""Share of frames that may have the time of the frame before and other content, by mistake."""
_UNIT: Final = r"s|sec|seconds|ms|msec|milliseconds|us|µs|usec|microseconds|ns|nsec|nanoseconds"
_TIMES: Final = re.compile(
    r"[%#]?\s*(?:time[\s_]?stamps?|time|ts?|sec|seconds)"
    rf"(?:\s*[\[(]\s*(?P<unit>{_UNIT})\s*[\])]|[\s_.]+(?P<tail>{_UNIT}))?",
    re.IGNORECASE,
)
_SECONDS: Final = {"s": 1.0, "m": 1e-3, "u": 1e-6, "μ": 1e-6, "n": 1e-9}
"""First letter of a unit of time -> the unit [s]; the mu is the Greek one that `casefold` gives."""


def to_seconds(
    where: str,
    stamps: np.ndarray,
    unit: float | None = None,
    shown: Sequence[np.ndarray] = (),
    remedy: str = "",
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Return times from zero [s], the frames that are kept (n,) bool, and sentences.

    A frame with the time of the frame before it is left out.

    Args:
        where: the file's name, for messages.
        stamps: the time column (n,).
        unit: its unit [s]; None finds it.
        shown: content of the frames, arrays (n, ...): frames of equal time should be equal.
        remedy: what the user can do if they differ, for the message.

    Raises:
        RecordingError: if a time is missing, time runs backwards, no unit fits, or many frames of
            equal time differ.
    """
    if not len(stamps):
        raise RecordingError(f"{where}: got no frame, allowed a recording with movement in it")
    if len(lost := np.flatnonzero(~np.isfinite(stamps))):
        raise RecordingError(f"{where}: frame {lost[0] + 1} has no time")
    time = stamps - stamps[0]
    steps = np.diff(time)
    if len(back := np.flatnonzero(steps < 0)):
        at = int(back[0])
        raise RecordingError(
            f"{where}: time runs backwards from frame {at + 1} to {at + 2}, from"
            f" {stamps[at]:.10g} to {stamps[at + 1]:.10g}"
        )
    notes = []
    if unit is None:
        usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.01
        fitting = [each for each in _UNITS if _SHORTEST <= each * usual < _STAMPS_LONGEST]
        if not fitting:
            raise RecordingError(
                f"{where}: the frames are {usual:g} apart in time, allowed a thousandth to 0.7 of a"
                " second in seconds, milliseconds, microseconds or nanoseconds"
            )
        unit = fitting[0]
        if unit != 1.0:
            notes.append(f"Times are taken as {_UNITS[unit]}.")
    time = unit * time
    kept, said = drop_duplicate_times(where, time, shown, remedy)
    return time[kept], kept, [*said, *notes, _spacing(time[kept])]


def drop_duplicate_times(
    where: str, time: np.ndarray, shown: Sequence[np.ndarray], remedy: str = ""
) -> tuple[np.ndarray, list[str]]:
    """Return the frames with another time than the frame before, (n,) bool, and sentences.

    Args:
        where: the file's name, for messages.
        time: times that do not run backwards (n,).
        shown: content of the frames, arrays (n, ...).
        remedy: what the user can do if frames of equal time differ, for the message.

    Raises:
        RecordingError: if many frames of equal time differ.
    """
    kept = np.concatenate([[True], np.diff(time) > 0])
    again = np.flatnonzero(~kept)
    if not len(again):
        return kept, []
    others = 0
    for begin in range(0, len(again), _BLOCK):
        at = again[begin : begin + _BLOCK]
        same = np.ones(len(at), dtype=bool)
        for values in shown:
            same &= are_alike(values[at], values[at - 1])
        others += int((~same).sum())
    if others > _OTHERS * len(kept):
        raise RecordingError(
            f"{where}: {others} of {len(kept)} frames have the time of the frame before and show"
            " something else, so the times are too coarse or there are several people, allowed"
            f" times that increase{remedy}"
        )
    differing = f" ({others} of them differ from it)" if others else ""
    return kept, [
        f"{len(again)} of {len(kept)} frames have the time of the frame before{differing} and are"
        " left out."
    ]


def time_head(word: str) -> tuple[bool, float | None]:
    """Return whether a column's head is that of times, and the unit that it states [s]."""
    match = _TIMES.fullmatch(word)
    stated = match and (match["unit"] or match["tail"])
    return match is not None, tick_of(stated) if stated else None


def tick_of(word: str) -> float | None:
    """Return the unit of time that a word denotes [s]; None if it denotes none."""
    return _SECONDS[word.casefold()[0]] if re.fullmatch(_UNIT, word, re.IGNORECASE) else None


def unit_by_rate(stamps: np.ndarray, rate: float) -> tuple[float, list[str]]:
    """Return the unit of times [s] with which their step agrees with a stated rate, and sentences.

    If no unit agrees, the times are taken as seconds, and a sentence says so: a rate in a header is
    often copied.

    Args:
        stamps: the time column (n,).
        rate: frames per second that the file states [Hz].
    """
    steps = np.diff(stamps)
    steps = steps[steps > 0]
    if not len(steps):
        return 1.0, []
    usual = float(np.median(steps))
    for unit, name in _UNITS.items():
        if abs(unit * usual * rate - 1) <= _ALIKE:
            said = f"Times are taken as {name}: the file states {rate:g} frames per second."
            return unit, [] if unit == 1.0 else [said]
    return 1.0, [
        f"The file states {rate:g} frames per second, but its times give {1 / usual:.4g}: the times"
        " are used."
    ]


def uniform_times(where: str, count: int, rate: float) -> tuple[np.ndarray, list[str]]:
    """Return times from zero [s] of frames whose rate was stated [Hz], and sentences.

    Raises:
        RecordingError: if the rate is out of range.
    """
    if not SLOWEST <= rate <= FASTEST:
        raise RecordingError(f"{where}: rate: got {rate:g}, allowed {RATES}")
    return np.arange(count) / rate, [f"There are {rate:g} frames per second, as stated."]


def count_repeated_frames(positions: np.ndarray) -> list[str]:
    """Return a sentence with the number of frames that repeat the frame before, if many do."""
    count = 0
    for at in range(1, len(positions), _BLOCK):
        now = positions[at : at + _BLOCK]
        before = positions[at - 1 : at - 1 + len(now)]
        count += int(are_alike(now, before).sum())
    if count < 0.01 * len(positions):
        return []
    return [f"{count} of {len(positions)} frames repeat the frame before."]


def are_alike(now: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Return which frames (n, ...) equal others (n, ...), with NaN equal to NaN, (n,) bool."""
    same = (now == before) | (np.isnan(now) & np.isnan(before))
    return same.all(axis=tuple(range(1, same.ndim)))


def _spacing(time: np.ndarray) -> str:
    """Return a sentence about the time between frames."""
    steps = np.diff(time)
    if not len(steps):
        return "There is one frame."
    usual = float(np.median(steps))
    if np.abs(steps - usual).max() < 0.1 * usual:
        return f"The frames are uniform in time, {usual:.4g} s apart."
    return (
        f"The frames are not uniform in time: {usual:.4g} s apart in the median,"
        f" {steps.max():.4g} s at most."
    )
