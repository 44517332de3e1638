"""The guard in front of the BVH reader: a file is checked line by line before any reader sees it.

BVH readers trust the file: they wait for lines that never come, believe any frame count and let NaN
through. Everything that could mislead them is found here, in one pass over the text, and told with
its line.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn

import numpy as np

from ergoqp.errors import RecordingError

CHANNELS = ("Xposition", "Yposition", "Zposition", "Xrotation", "Yrotation", "Zrotation")
"""The channel names of the format."""

_LARGEST = 1e8  # in any unit of length, and in degrees; no person is there
_LONGEST_FRAME = 10.0  # seconds; a longer frame time is a frame rate written in its place


@dataclass(frozen=True)
class BvhText:
    """A checked BVH file.

    Attributes:
        header: the lines from ``HIERARCHY`` to the closing brace of the root.
        rows: channel values, shape (n, channels); finite [file unit, deg].
        frame_time: period between two rows [s].
    """

    header: tuple[str, ...]
    rows: np.ndarray
    frame_time: float


@dataclass
class _Cursor:
    """The lines of one file and the place reached, so that every complaint names its line."""

    path: Path
    lines: list[str]
    line: int = 0
    """Number of the line last returned, counted from 1; 0 before the first."""

    def next(self, wanted: str) -> list[str]:
        """Return the words of the next line that is not blank."""
        while self.line < len(self.lines):
            self.line += 1
            if words := self.lines[self.line - 1].split():
                return words
        if not any(line.strip() for line in self.lines):
            raise RecordingError(f"{self.path.name}: got an empty file, allowed a BVH file")
        raise RecordingError(
            f"{self.path.name}: the file ends in line {self.line}, required is {wanted}"
        )

    def fail(self, problem: str) -> NoReturn:
        raise RecordingError(f"{self.path.name}, line {self.line}: {problem}")

    def number(self, word: str, what: str) -> float:
        try:
            value = float(word)
        except ValueError:
            self.fail(f"{what}: got {_short(word)}, allowed a number")
        if not abs(value) <= _LARGEST:  # also false for NaN
            self.fail(
                f"{what} is {_short(word)}; only finite numbers up to {_LARGEST:g} can be used"
            )
        return value


@dataclass
class _Header:
    """What the pass over the hierarchy collects."""

    channels: int = 0
    names: dict[str, int] = field(default_factory=dict)
    """Joint name -> line of its first use."""


def read_text(path: Path) -> BvhText:
    """Read and check a BVH file without trusting any number it states.

    Args:
        path: the file.

    Returns:
        The header's lines, the rows as numbers and the frame time.

    Raises:
        RecordingError: the file is missing, a folder, not text, or not a complete and finite BVH
            file; says which line, what was found and what is allowed.
    """
    cursor = _Cursor(path, re.split(r"\r\n|\r|\n", _decoded(path)))
    header = _Header()
    words = cursor.next("the line HIERARCHY")
    if words != ["HIERARCHY"]:
        cursor.fail(f"a BVH file starts with the line HIERARCHY, got {_short(' '.join(words))}")
    first = cursor.line
    _check_hierarchy(cursor, header)
    last = cursor.line
    rows, frame_time = _read_motion(cursor, header.channels)
    return BvhText(tuple(cursor.lines[first - 1 : last]), rows, frame_time)


def _decoded(path: Path) -> str:
    try:
        # Opening a pipe or a device would wait for someone to write.
        if path.exists() and not path.is_file():
            raise RecordingError(f"{str(path)!r} is not a file, allowed the recording file itself")
        content = path.read_bytes()
    except FileNotFoundError:
        raise RecordingError(
            f"{path.name}: got no file {str(path)!r}, allowed a recording"
        ) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise RecordingError(
            f"{_short(str(path))} cannot be read: {reason}, allowed a recording"
        ) from None
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise RecordingError(
            f"{path.name}, line {line}: got a byte that is not UTF-8, allowed plain text"
        ) from None


def _check_hierarchy(cursor: _Cursor, header: _Header) -> None:
    """Walk over the skeleton until the root's brace closes."""
    depth = 0
    while True:
        words = cursor.next("the skeleton's last closing brace")
        match words[0]:
            case "{" | "}":
                if len(words) != 1:
                    cursor.fail(f"a brace stands alone on its line, got {_short(' '.join(words))}")
                depth += 1 if words[0] == "{" else -1
                if depth <= 0:
                    break
            case "ROOT" | "JOINT":
                _check_name(cursor, header, words, inside=depth > 0)
            case "OFFSET":
                if len(words) != 4:
                    cursor.fail(f"OFFSET: got {len(words) - 1} numbers, allowed 3")
                for word in words[1:]:
                    cursor.number(word, "OFFSET")
            case "CHANNELS":
                _check_channels(cursor, words[1:])
                header.channels += len(words) - 2
            case "End":
                pass
            case "MOTION":
                cursor.fail(
                    f"got MOTION with {depth} braces open, allowed after the skeleton is closed"
                )
            case other:
                cursor.fail(
                    f"got {_short(other)}, allowed in a skeleton are ROOT, JOINT, OFFSET, CHANNELS,"
                    " End Site and braces"
                )
    if depth < 0 or not header.channels:
        cursor.fail("got a skeleton without channels, allowed at least one joint with some")


def _check_name(cursor: _Cursor, header: _Header, words: list[str], *, inside: bool) -> None:
    if len(words) != 2:
        cursor.fail(
            f"{words[0]}: got {_short(' '.join(words[1:]))}, allowed one name without spaces"
        )
    if (words[0] == "JOINT") != inside:
        cursor.fail(
            f"{words[0]} {_short(words[1])} is out of place; a skeleton is one ROOT with all JOINTs"
            " inside it"
        )
    if words[1] in header.names:
        cursor.fail(
            f"joint {_short(words[1])} is already defined in line {header.names[words[1]]}; names"
            " must differ"
        )
    header.names[words[1]] = cursor.line


def _check_channels(cursor: _Cursor, words: list[str]) -> None:
    if not words or words[0] != str(len(words) - 1):
        stated = _short(words[0]) if words else "no count"
        cursor.fail(
            f"CHANNELS: got {max(len(words) - 1, 0)} channels, allowed as many as it states,"
            f" {stated}"
        )
    for name in words[1:]:
        if name not in CHANNELS:
            cursor.fail(
                f"channel {_short(name)} is not supported; allowed are {', '.join(CHANNELS)}"
            )
    if len(set(words[1:])) != len(words) - 1:
        cursor.fail("got a channel twice in one joint, allowed once")


def _read_motion(cursor: _Cursor, channels: int) -> tuple[np.ndarray, float]:
    words = cursor.next("the line MOTION: it holds a skeleton but no movement")
    if words != ["MOTION"]:
        cursor.fail(f"the line MOTION must follow the skeleton, got {_short(' '.join(words))}")
    words = cursor.next("the line 'Frames:'")
    if words[0] != "Frames:" or len(words) != 2 or not re.fullmatch(r"[0-9]{1,18}", words[1]):
        cursor.fail(f"expected 'Frames: <whole number>', got {_short(' '.join(words))}")
    stated, stated_line = int(words[1]), cursor.line
    words = cursor.next("the line 'Frame Time:'")
    if words[:2] != ["Frame", "Time:"] or len(words) != 3:
        cursor.fail(f"expected 'Frame Time: <seconds>', got {_short(' '.join(words))}")
    frame_time = cursor.number(words[2], "the frame time")
    if not 0 < frame_time <= _LONGEST_FRAME:
        cursor.fail(
            f"the frame time is {frame_time:g} s; allowed is above 0 and at most"
            f" {_LONGEST_FRAME:g} s"
        )

    found = [i for i in range(cursor.line, len(cursor.lines)) if cursor.lines[i].strip()]
    if stated != len(found) or not found:
        what = (
            "the recording is cut or was joined with another"
            if found
            else "there is no movement in it"
        )
        raise RecordingError(
            f"{cursor.path.name}, line {stated_line}: got {len(found)} rows, allowed {stated}, as"
            f" is stated; {what}"
        )
    rows = np.empty((len(found), channels))
    for frame, i in enumerate(found):
        cursor.line = i + 1
        rows[frame] = _row(cursor, cursor.lines[i].split(), channels)
    return rows, frame_time


def _row(cursor: _Cursor, words: list[str], channels: int) -> list[float]:
    if len(words) != channels:
        cursor.fail(f"got a row of {len(words)} numbers, allowed {channels}, one for each channel")
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = [math.nan]
    if not all(abs(value) <= _LARGEST for value in values):
        for column, word in enumerate(words, start=1):
            cursor.number(word, f"number {column} of the row")
    return values


def _short(text: str) -> str:
    """Quote what was found, cut so that a message stays one readable sentence."""
    return repr(text if len(text) <= 40 else text[:37] + "...")
