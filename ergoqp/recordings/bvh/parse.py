"""The text of a BVH file as skeleton and numbers, in one pass that trusts nothing.

The rows are read in blocks: an hour is more than fits. No frame count is believed, no line that may
never come is waited for, no NaN let through; what is wrong is told with its line.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final, NoReturn

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.progress import Progress, unseen
from ergoqp.recordings.formats.opening import binary, short

CHANNELS = ("Xposition", "Yposition", "Zposition", "Xrotation", "Yrotation", "Zrotation")
"""The channel names of the format."""

_LARGEST = 1e8  # in any unit of length, and in degrees; no person is there
_SHORTEST_FRAME = 1e-5  # seconds; nobody measures so often
_LONGEST_FRAME = 10.0  # seconds; a longer frame time is a frame rate written in its place
_BLOCK: Final = 4096  # rows that are numbers at once
_MOST_JOINTS: Final = 500  # a person with every finger and face bone has about 200
_DEEPEST = 100  # joints, one inside the other; a person with all fingers has about ten


@dataclass(frozen=True)
class Joint:
    """One joint of a skeleton.

    Attributes:
        name: the file's name of it.
        offset: its place in its parent at rest, shape (3,) [file unit].
        channels: which of `CHANNELS` its columns of the rows are, in their order.
        depth: how many joints it hangs below the root; its parent is the last one before it that
            hangs one less.
    """

    name: str
    offset: np.ndarray
    channels: tuple[str, ...]
    depth: int


@dataclass(frozen=True)
class BvhText:
    """A BVH file that is being read.

    Attributes:
        joints: the skeleton in the order of the file, which is that of the columns.
        frame_time: period between two rows [s].
        most: more rows than that there are not.
        blocks: channel values, some rows (k, channels) after the other; finite [file unit, deg].
            What is wrong with a row is raised when its turn comes.
    """

    joints: tuple[Joint, ...]
    frame_time: float
    most: int
    blocks: Iterator[np.ndarray]


@dataclass
class _Cursor:
    """The lines of one file and the place reached, so that every complaint names its line."""

    path: Path
    lines: Iterator[str]
    line: int = 0
    """Number of the line last returned, counted from 1; 0 before the first."""
    empty: bool = True
    """Whether all of them were blank so far."""

    def words(self) -> list[str] | None:
        """Return the words of the next line that is not blank; None at the end."""
        for text in self.lines:
            self.line += 1
            if words := text.split():
                self.empty = False
                return words
        return None

    def next(self, wanted: str) -> list[str]:
        """Return the words of the next line that is not blank."""
        if (words := self.words()) is not None:
            return words
        if self.empty:
            raise RecordingError(f"{self.path.name}: got an empty file, allowed a BVH file")
        raise RecordingError(
            f"{self.path.name}: the file ends in line {self.line}, required is {wanted}"
        )

    def part(self, keyword: str) -> list[str]:
        """Return what the next line says behind the keyword that must begin it."""
        words = self.next("the skeleton's last closing brace")
        alone = keyword in "{}"
        if words[0] != keyword or (alone and len(words) > 1):
            allowed = f"{keyword} alone on its line" if alone else f"a line {keyword}"
            self.fail(f"got {short(' '.join(words))}, allowed here is {allowed}")
        return words[1:]

    def fail(self, problem: str) -> NoReturn:
        raise RecordingError(f"{self.path.name}, line {self.line}: {problem}")

    def number(self, word: str, what: str) -> float:
        try:
            value = float(word if _plain(word) else "")
        except ValueError:
            self.fail(f"{what}: got {short(word)}, allowed a number")
        if not abs(value) <= _LARGEST:  # also false for NaN
            self.fail(
                f"{what} is {short(word)}; only finite numbers up to {_LARGEST:g} can be used"
            )
        return value


@contextmanager
def opened(path: Path, progress: Progress = unseen) -> Iterator[BvhText]:
    """Read and check a BVH file without trusting any number it states.

    Args:
        path: the file.
        progress: told how much of the file is read.

    Yields:
        The skeleton, the frame time, and the rows as numbers, block by block.

    Raises:
        RecordingError: the file is missing, a folder, not text, or not a complete and finite BVH
            file; says which line, what was found and what is allowed.
    """
    with binary(path) as file:
        cursor = _Cursor(path, iter(()))
        cursor.lines = _lines(file, cursor)
        words = cursor.next("the line HIERARCHY")
        if words != ["HIERARCHY"]:
            cursor.fail(f"a BVH file starts with the line HIERARCHY, got {short(' '.join(words))}")
        joints = _read_skeleton(cursor)
        channels = sum(len(joint.channels) for joint in joints)
        stated, stated_line, frame_time = _read_motion(cursor)
        # A number and what parts it from the next are two bytes at least.
        size = path.stat().st_size
        most = min(stated, size // (2 * channels) + 1)
        rows = _rows(cursor, channels, stated, stated_line)
        yield BvhText(joints, frame_time, most, _told(rows, lambda: progress(file.tell() / size)))


def _lines(file: BinaryIO, cursor: _Cursor) -> Iterator[str]:
    """Return the lines of a file, ended in any of the usual ways."""
    for number, raw in enumerate(file):
        try:
            text = raw.decode("utf-8" if number else "utf-8-sig")
        except UnicodeDecodeError:
            raise RecordingError(
                f"{cursor.path.name}, line {cursor.line + 1}: got a byte that is not UTF-8, allowed"
                " plain text"
            ) from None
        yield from text.removesuffix("\n").removesuffix("\r").split("\r")


def _read_skeleton(cursor: _Cursor) -> tuple[Joint, ...]:
    """Walk over the skeleton until the root's brace closes."""
    lines: dict[str, int] = {}
    joints = [_read_joint(cursor, cursor.part("ROOT"), 0, lines)]
    inside = [joints[0]]
    while inside:
        words = cursor.next("the skeleton's last closing brace")
        if words == ["}"]:
            inside.pop()
        elif words[0] == "JOINT":
            joints.append(_read_joint(cursor, words[1:], len(inside), lines))
            inside.append(joints[-1])
        elif words[0] == "End":
            cursor.part("{")
            _read_offset(cursor)
            cursor.part("}")
        else:
            cursor.fail(
                f"got {short(' '.join(words))}, allowed inside joint {short(inside[-1].name)} are"
                " JOINT, End Site and its closing brace alone on a line"
            )
    if len(joints) > _MOST_JOINTS:
        cursor.fail(f"got {len(joints)} joints, allowed {_MOST_JOINTS}")
    if not any(joint.channels for joint in joints):
        cursor.fail("got a skeleton without channels, allowed at least one joint with some")
    return tuple(joints)


def _read_joint(cursor: _Cursor, words: list[str], depth: int, lines: dict[str, int]) -> Joint:
    """Read a joint down to its channels; `lines` tells where each name was used first."""
    if len(words) != 1:
        cursor.fail(f"a joint: got {short(' '.join(words))}, allowed one name without spaces")
    name = words[0]
    if name in lines:
        cursor.fail(
            f"joint {short(name)} is already defined in line {lines[name]}; names must differ"
        )
    if depth >= _DEEPEST:
        cursor.fail(
            f"joint {short(name)} is nested too deeply; allowed are {_DEEPEST} joints, one inside"
            " the other"
        )
    lines[name] = cursor.line
    cursor.part("{")
    return Joint(name, _read_offset(cursor), _read_channels(cursor), depth)


def _read_offset(cursor: _Cursor) -> np.ndarray:
    words = cursor.part("OFFSET")
    if len(words) != 3:
        cursor.fail(f"OFFSET: got {len(words)} numbers, allowed 3")
    # Single precision is finer than any skeleton is measured, and postures that were fitted before
    # stay the same to the last bit.
    return np.array([cursor.number(word, "OFFSET") for word in words], np.float32).astype(float)


def _read_channels(cursor: _Cursor) -> tuple[str, ...]:
    count, *names = cursor.part("CHANNELS") or ["no count"]
    if count != str(len(names)):
        cursor.fail(
            f"CHANNELS: got {len(names)} channels, allowed as many as it states, {short(count)}"
        )
    for name in names:
        if name not in CHANNELS:
            cursor.fail(
                f"channel {short(name)} is not supported; allowed are {', '.join(CHANNELS)}"
            )
    if len(set(names)) != len(names):
        cursor.fail("got a channel twice in one joint, allowed once")
    return tuple(names)


def _read_motion(cursor: _Cursor) -> tuple[int, int, float]:
    """Return how many rows are stated, in which line, and the frame time [s]."""
    words = cursor.next("the line MOTION: it holds a skeleton but no movement")
    if words != ["MOTION"]:
        cursor.fail(f"the line MOTION must follow the skeleton, got {short(' '.join(words))}")
    words = cursor.next("the line 'Frames:'")
    if words[0] != "Frames:" or len(words) != 2 or not re.fullmatch(r"[0-9]{1,18}", words[1]):
        cursor.fail(f"expected 'Frames: <whole number>', got {short(' '.join(words))}")
    stated, stated_line = int(words[1]), cursor.line
    words = cursor.next("the line 'Frame Time:'")
    if words[:2] != ["Frame", "Time:"] or len(words) != 3:
        cursor.fail(f"expected 'Frame Time: <seconds>', got {short(' '.join(words))}")
    frame_time = cursor.number(words[2], "the frame time")
    if not _SHORTEST_FRAME <= frame_time <= _LONGEST_FRAME:
        cursor.fail(
            f"the frame time is {frame_time:g} s; allowed is at least {_SHORTEST_FRAME:g} and at"
            f" most {_LONGEST_FRAME:g} s"
        )
    return stated, stated_line, frame_time


def _rows(cursor: _Cursor, channels: int, stated: int, stated_line: int) -> Iterator[np.ndarray]:
    """Return the rows, block by block; say at the end if there are not as many as is stated."""
    found, block = 0, []
    while (words := cursor.words()) is not None:
        found += 1
        if found > stated:
            continue
        block.append(_row(cursor, words, channels))
        if len(block) == _BLOCK:
            yield np.array(block)
            block = []
    if stated != found or not found:
        what = (
            "the recording is cut or was joined with another"
            if found
            else "there is no movement in it"
        )
        raise RecordingError(
            f"{cursor.path.name}, line {stated_line}: got {found} rows, allowed {stated}, as"
            f" is stated; {what}"
        )
    if block:
        yield np.array(block)


def _told(blocks: Iterator[np.ndarray], after: Callable[[], None]) -> Iterator[np.ndarray]:
    for block in blocks:
        yield block
        after()


def _row(cursor: _Cursor, words: list[str], channels: int) -> list[float]:
    if len(words) != channels:
        cursor.fail(f"got a row of {len(words)} numbers, allowed {channels}, one for each channel")
    try:
        values = [float(word) for word in words] if _plain("".join(words)) else [math.nan]
    except ValueError:
        values = [math.nan]
    if not all(abs(value) <= _LARGEST for value in values):
        for column, word in enumerate(words, start=1):
            cursor.number(word, f"number {column} of the row")
    return values


def _plain(text: str) -> bool:
    """Return whether no number in it is one to Python alone, as 1_0 is."""
    return text.isascii() and "_" not in text
