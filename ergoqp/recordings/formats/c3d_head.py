"""Header and parameters of C3D files, of every processor type and without trust.

A file is in blocks of 512 bytes: a header, parameters in groups, frames (c3d.org, "The C3D File
Format: User Guide"). Integers and floats are those of the computer that wrote it: Intel, DEC or
MIPS.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import prod
from pathlib import Path
from typing import Any, BinaryIO, Final, NoReturn

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.recordings.formats.opening import short

BLOCK: Final = 512
KEY: Final = 0x50
"""The second byte of each file."""
_PROCESSORS: Final = {84: "Intel", 85: "DEC", 86: "MIPS"}
_MOST: Final = 256 * BLOCK
"""Parameters can be no longer: their count of blocks is one byte."""
_WIDTHS: Final = {-1: 1, 1: 1, 2: 2, 4: 4}
_LONGEST: Final = 65_535
"""Frames that the header can count."""


@dataclass(frozen=True)
class Numbers:
    """How the computer that wrote a file has its numbers.

    Attributes:
        processor: one of Intel, DEC, MIPS.
    """

    processor: str

    @property
    def order(self) -> str:
        """NumPy's mark for the order of bytes."""
        return ">" if self.processor == "MIPS" else "<"

    def integers(self, raw: bytes) -> np.ndarray:
        """Return 16-bit integers."""
        return np.frombuffer(raw, self.order + "i2")

    def floats(self, raw: bytes) -> np.ndarray:
        """Return 32-bit floats."""
        if self.processor != "DEC":
            return np.frombuffer(raw, self.order + "f4").astype(np.float32)
        # DEC's have their halves exchanged, and an exponent that is larger by two.
        halves = np.frombuffer(raw, "<u2").reshape(-1, 2)[:, ::-1]
        return np.ascontiguousarray(halves).view("<f4").ravel() / np.float32(4)


@dataclass(frozen=True)
class Head:
    """What stands before the frames.

    Attributes:
        points: points in a frame.
        analog: analog samples in a frame, all channels.
        frames: frames, by the longest count that the file has.
        long: whether that count can be larger than 65 535.
        scale: of integers [file unit]; negative: the frames are floats.
        start: where the frames begin [bytes].
        rate: frames per second [Hz].
        numbers: how they are written.
        parameters: group -> name -> value: text, list of texts or array of numbers.
    """

    points: int
    analog: int
    frames: int
    long: bool
    scale: float
    start: int
    rate: float
    numbers: Numbers
    parameters: dict[str, dict[str, Any]] = field(repr=False)

    def of(self, group: str, name: str) -> Any:
        """Return a parameter; None if there is none."""
        return self.parameters.get(group, {}).get(name)

    def number(self, group: str, name: str) -> float | None:
        """Return the first number of a parameter; None if there is none."""
        value = self.of(group, name)
        if not isinstance(value, np.ndarray) or not value.size:
            return None
        return float(value.flat[0])

    def texts(self, group: str, name: str) -> list[str]:
        """Return the texts of a parameter and of those that continue it: LABELS, LABELS2 and on."""
        found: list[str] = []
        number = 1
        while (value := self.of(group, name if number == 1 else f"{name}{number}")) is not None:
            found += [value] if isinstance(value, str) else list(value)
            number += 1
        return [text for text in found if isinstance(text, str)]

    @property
    def frame_bytes(self) -> int:
        """How long a frame is."""
        return (4 * self.points + self.analog) * (4 if self.scale < 0 else 2)


def read_head(path: Path, file: BinaryIO, size: int) -> Head:
    """Return the header and the parameters of a file.

    Args:
        path: the file.
        file: it, opened, at its begin.
        size: how long it is [bytes].

    Raises:
        RecordingError: it is no C3D file, cut, or states what cannot be.
    """
    first = file.read(BLOCK)
    if len(first) < BLOCK or first[1] != KEY:
        _fail(path, "got no C3D header, allowed 512 bytes of which the second is 80")
    begin = BLOCK * (first[0] - 1)
    file.seek(begin)
    leading = file.read(4)
    if begin <= 0 or len(leading) < 4 or leading[3] not in _PROCESSORS:
        kinds = ", ".join(f"{code} ({name})" for code, name in _PROCESSORS.items())
        got = leading[3] if len(leading) == 4 else "nothing"
        _fail(path, f"processor type: got {got}, allowed {kinds}")
    numbers = Numbers(_PROCESSORS[leading[3]])
    section = leading + file.read((leading[2] * BLOCK or _MOST) - 4)
    parameters = _parameters(path, section, numbers)
    words = numbers.integers(first[:26]).view(numbers.order + "u2").astype(int)
    scale, rate = (float(numbers.floats(first[at : at + 4])[0]) for at in (12, 20))
    head = Head(
        points=int(words[1]),
        analog=int(words[2]),
        frames=int(words[4] - words[3] + 1),
        long=False,
        scale=scale,
        start=BLOCK * (int(words[8]) - 1),
        rate=rate,
        numbers=numbers,
        parameters=parameters,
    )
    return _checked(path, _counted(head), size)


def _checked(path: Path, head: Head, size: int) -> Head:
    """Return a head whose frames are in the file."""
    if not head.points:
        _fail(path, "got no point in a frame, allowed markers; analog data alone are no movement")
    if not (np.isfinite(head.scale) and head.scale):
        _fail(path, f"scale of the points: got {head.scale:g}, allowed a number that is not 0")
    if not (np.isfinite(head.rate) and 1 <= head.rate <= 100_000):
        _fail(path, f"frames per second: got {head.rate:g}, allowed 1 to 100000")
    if head.start < BLOCK:
        _fail(path, f"begin of the frames: got byte {head.start}, allowed one behind the header")
    there = max(size - head.start, 0) // head.frame_bytes
    if head.frames < 1:
        _fail(path, f"got {head.frames} frames, allowed 1 and more")
    if there < head.frames:
        _fail(path, f"got {there} frames, allowed {head.frames}, as is stated; the file is cut")
    # A header that counts to 65 535 says less of more, or begins to count anew.
    if not head.long and there - head.frames >= 2 + BLOCK // head.frame_bytes:
        begun_anew = (there - head.frames) % (_LONGEST + 1) <= 2 + BLOCK // head.frame_bytes
        if head.frames >= _LONGEST or begun_anew:
            _fail(
                path,
                f"got {there} frames of which {head.frames} are stated, allowed a long count"
                " (TRIAL:ACTUAL_END_FIELD or POINT:LONG_FRAMES) with more than 65535; export the"
                " take with it, or in parts",
            )
    return head


def _counted(head: Head) -> Head:
    """Return the head with the longest count of frames that the file has."""
    ends = [head.of("TRIAL", f"ACTUAL_{which}_FIELD") for which in ("START", "END")]
    if all(isinstance(end, np.ndarray) and end.size == 2 for end in ends):
        first, last = (
            int(end.flat[0]) % 65536 + 65536 * (int(end.flat[1]) % 65536) for end in ends
        )
        if last >= first:
            return Head(**{**vars(head), "frames": last - first + 1, "long": True})
    if (long := head.number("POINT", "LONG_FRAMES")) is not None and long >= 1:
        return Head(**{**vars(head), "frames": int(long), "long": True})
    stated = head.number("POINT", "FRAMES")
    if stated is None:
        return head
    # A float can count further than 65 535, an integer is one without a sign.
    count = int(stated) if stated > 0 else int(stated) % 65536
    if count > _LONGEST:
        return Head(**{**vars(head), "frames": count, "long": True})
    return head if head.frames >= 1 else Head(**{**vars(head), "frames": count})


def _parameters(path: Path, raw: bytes, numbers: Numbers) -> dict[str, dict[str, Any]]:
    """Return group -> name -> value; what cannot be read is left out."""
    names: dict[int, str] = {}
    values: dict[int, dict[str, Any]] = {}
    at = 4
    while at + 2 <= len(raw):
        letters, number = np.frombuffer(raw[at : at + 2], "i1")
        name_at, count = at + 2, abs(int(letters))
        if not count or not number:
            break
        name = raw[name_at : name_at + count].decode("latin-1").strip().upper()
        step_at = name_at + count
        if step_at + 2 > len(raw):
            _fail(path, f"the parameters end within {short(name)}, allowed a whole file")
        step = int(numbers.integers(raw[step_at : step_at + 2])[0])
        if number < 0:
            names[-int(number)] = name
        else:
            values.setdefault(int(number), {})[name] = _value(raw[step_at + 2 :], numbers)
        if step <= 0:
            break
        at = step_at + step
    return {names.get(number, str(number)): group for number, group in values.items()}


def _value(raw: bytes, numbers: Numbers) -> Any:
    """Return a parameter's value: text, list of texts, or numbers, the last axis first."""
    if len(raw) < 2:
        return None
    kind, count = int(np.frombuffer(raw[:1], "i1")[0]), raw[1]
    shape = list(raw[2 : 2 + count])
    width = _WIDTHS.get(kind)
    if width is None or len(shape) < count:
        return None
    data = raw[2 + count : 2 + count + width * prod(shape)]
    if len(data) < width * prod(shape):
        return None
    if kind == -1:
        return _texts(data, shape)
    if kind == 1:
        flat = np.frombuffer(data, "u1")
    else:
        flat = numbers.integers(data) if kind == 2 else numbers.floats(data)
    return flat.reshape(shape[::-1] or (1,))


def _texts(data: bytes, shape: list[int]) -> str | list[str]:
    if len(shape) < 2:
        return data.decode("latin-1").strip(" \0")
    length, count = shape[0], prod(shape[1:])
    cut = [data[i * length : (i + 1) * length] for i in range(count)]
    return [text.decode("latin-1").strip(" \0") for text in cut]


def _fail(path: Path, problem: str) -> NoReturn:
    raise RecordingError(f"{path.name}: {problem}")
