"""Header and parameters of C3D files of every processor type; the files are not trusted.

A file consists of blocks of 512 bytes: a header, parameters in groups, frames (c3d.org, "The C3D
File Format: User Guide"). Integers and floats are those of the computer that wrote it: Intel, DEC
or MIPS.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isfinite, prod
from pathlib import Path
from typing import Any, BinaryIO, Final, NoReturn

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.recordings.formats.opening import short

BLOCK: Final = 512
_KEY: Final = 0x50
"""The second byte of each file."""
_PROCESSORS: Final = {84: "Intel", 85: "DEC", 86: "MIPS"}
_MOST: Final = 1 << 20
"""Largest number of bytes of parameters; the format allows 255 blocks."""
_DIMENSIONS: Final = 7
_WIDTHS: Final = {-1: 1, 1: 1, 2: 2, 4: 4}
_RATES: Final = (1.0, 100_000.0)
"""Smallest and largest number of frames per second [Hz]."""


@dataclass(frozen=True)
class Numbers:
    """Number format of the computer that wrote a file.

    Attributes:
        processor: one of Intel, DEC, MIPS.
    """

    processor: str

    @property
    def order(self) -> str:
        """NumPy's character for the order of bytes."""
        return ">" if self.processor == "MIPS" else "<"

    def integers(self, raw: bytes) -> np.ndarray:
        """Return 16-bit integers."""
        return np.frombuffer(raw, self.order + "i2")

    def floats(self, raw: bytes) -> np.ndarray:
        """Return 32-bit floats."""
        if self.processor != "DEC":
            return np.frombuffer(raw, self.order + "f4").astype(np.float32)
        # In DEC floats the halves are exchanged, and the exponent is larger by two.
        halves = np.frombuffer(raw, "<u2").reshape(-1, 2)[:, ::-1]
        with np.errstate(invalid="ignore"):  # some bits are not numbers
            return np.ascontiguousarray(halves).view("<f4").ravel() / np.float32(4)


@dataclass(frozen=True)
class Head:
    """Header and parameters of a file.

    Attributes:
        points: points in a frame.
        analog: analog samples in a frame, all channels.
        first: number of the first frame in the header.
        last: number of the last frame in the header, at most 65 535.
        scale: unit of the integers [file unit]; negative: the frames are floats.
        start: position of the first frame [bytes].
        rate: frames per second [Hz].
        numbers: number format.
        parameters: group -> name -> value: text, list of texts or array (n,) of numbers.
        notes: sentences about contradictions in the file.
    """

    points: int
    analog: int
    first: int
    last: int
    scale: float
    start: int
    rate: float
    numbers: Numbers
    parameters: dict[str, dict[str, Any]] = field(repr=False)
    notes: tuple[str, ...] = ()

    def of(self, group: str, name: str) -> Any:
        """Return a parameter; None if there is none."""
        return self.parameters.get(group, {}).get(name)

    def number(self, group: str, name: str) -> float | None:
        """Return the first number of a parameter; None if there is none."""
        return _first(self.of(group, name))

    def texts(self, group: str, name: str) -> list[str]:
        """Return the texts of a parameter and its continuations: LABELS, LABELS2 and so on."""
        found: list[str] = []
        number = 1
        while (value := self.of(group, name if number == 1 else f"{name}{number}")) is not None:
            found += [value] if isinstance(value, str) else list(value)
            number += 1
        return [text for text in found if isinstance(text, str)]

    def text(self, group: str, name: str) -> str:
        """Return the first text of a parameter in small letters; "" if there is none."""
        return next(iter(self.texts(group, name)), "").casefold()

    @property
    def frame_bytes(self) -> int:
        """Length of a frame [bytes]."""
        return (4 * self.points + self.analog) * (4 if self.scale < 0 else 2)


def is_c3d(first: bytes) -> bool:
    """Return whether a file is a C3D file, from its first bytes.

    Args:
        first: its first bytes, 255 blocks or all.
    """
    if len(first) < BLOCK or first[1] != _KEY or first[0] < 2:
        return False
    at = BLOCK * (first[0] - 1) + 3
    return at < len(first) and first[at] in _PROCESSORS


def read_head(path: Path, file: BinaryIO) -> Head:
    """Return the header and the parameters of a file.

    Args:
        path: the file.
        file: the opened file, at its start.

    Raises:
        RecordingError: if it is not a C3D file, is cut, or states an impossible value.
    """
    top = file.read(BLOCK)
    if len(top) < BLOCK or top[1] != _KEY:
        fail(path, "got no C3D header, allowed 512 bytes of which the second is 80")
    begin = BLOCK * (top[0] - 1)
    if begin <= 0:
        fail(path, f"parameters: got block {top[0]}, allowed a block after the header")
    file.seek(begin)
    leading = file.read(4)
    if len(leading) < 4:
        fail(path, f"parameters: got block {top[0]}, allowed a block in the file; the file is cut")
    if leading[3] not in _PROCESSORS:
        kinds = ", ".join(f"{code} ({name})" for code, name in _PROCESSORS.items())
        fail(path, f"processor: got {leading[3]}, allowed {kinds}")
    numbers = Numbers(_PROCESSORS[leading[3]])
    words = [int(word) % 65536 for word in numbers.integers(top[:26])]
    start = BLOCK * (words[8] - 1)
    # There may be more blocks than one byte can count.
    long = min(max(BLOCK * leading[2], start - begin), _MOST)
    parameters, end = _parameters(path, leading + file.read(long - 4), long, numbers)
    if not words[1]:
        fail(path, "got no point in a frame, allowed markers; analog data show no movement")
    if not (start > begin + end or BLOCK <= start < begin):
        fail(path, f"begin of the frames: got byte {start}, allowed a byte after the parameters")
    point = parameters.get("POINT", {})
    scale, rate = (float(numbers.floats(top[at : at + 4])[0]) for at in (12, 20))
    hertz, notes = _rate(path, rate, _first(point.get("RATE")))
    return Head(
        points=words[1],
        analog=words[2],
        first=words[3],
        last=words[4],
        scale=_scale(path, scale, _first(point.get("SCALE"))),
        start=start,
        rate=hertz,
        numbers=numbers,
        parameters=parameters,
        notes=notes,
    )


def _scale(path: Path, header: float, stated: float | None) -> float:
    """Return the scale of the points; the parameter is preferred to the header."""
    scale = stated if stated is not None and isfinite(stated) and stated else header
    if not (isfinite(scale) and scale):
        fail(path, f"scale of the points: got {scale:g}, allowed a number that is not 0")
    return scale


def _rate(path: Path, header: float, stated: float | None) -> tuple[float, tuple[str, ...]]:
    """Return frames per second, and sentences; the parameter is preferred to the header."""
    low, high = _RATES
    usable = [rate for rate in (stated, header) if rate is not None and low <= rate <= high]
    if not usable:
        fail(path, f"frames per second: got {header:g}, allowed {low:g} to {high:.0f}")
    if stated is not None and not low <= stated <= high:
        return usable[0], (
            f"POINT:RATE states {stated:g} frames per second, which no file has: the {header:g} of"
            " the header are used.",
        )
    if abs(usable[0] / usable[-1] - 1) < 1e-3:
        return usable[0], ()
    return usable[0], (
        f"The file states {header:g} frames per second in its header and {stated:g} in POINT:RATE:"
        " the latter are used.",
    )


def _first(value: Any) -> float | None:
    """Return the first number of a parameter's value; None if there is none."""
    return float(value[0]) if isinstance(value, np.ndarray) and value.size else None


def _parameters(
    path: Path, raw: bytes, long: int, numbers: Numbers
) -> tuple[dict[str, dict[str, Any]], int]:
    """Return group -> name -> value, and the start of the last parameter [bytes].

    Values that cannot be read are None.

    Args:
        path: the file.
        raw: its parameters.
        long: length that they should have [bytes].
        numbers: number format.
    """
    names: dict[int, str] = {}
    values: dict[int, dict[str, Any]] = {}
    at, next_at, name = 4, 4, ""
    while next_at + 2 <= len(raw):
        letters, number = np.frombuffer(raw[next_at : next_at + 2], "i1").tolist()
        if not letters or not number:
            break
        at = next_at
        step_at = at + 2 + abs(letters)
        name = _text(raw[at + 2 : step_at]).upper()
        next_at = step_at + 2
        if next_at > len(raw):
            break
        # Read as unsigned, because many long labels exceed a signed integer.
        step = int(numbers.integers(raw[step_at : step_at + 2])[0]) % 65536
        if number < 0:
            names[-number] = name
        else:
            values.setdefault(number, {})[name] = _value(raw, next_at, numbers)
        if not step:
            break
        next_at = step_at + step
    if next_at > len(raw) and len(raw) < long:
        fail(path, f"got parameters that end within {short(name)}, allowed a complete file")
    groups: dict[str, dict[str, Any]] = {}
    for number, group in values.items():
        groups.setdefault(names.get(number, str(number)), {}).update(group)
    return groups, at


def _value(raw: bytes, at: int, numbers: Numbers) -> Any:
    """Return a parameter's value: text, list of texts, or numbers (n,); None if it has none."""
    if at + 2 > len(raw):
        return None
    kind, dimensions = (raw[at] + 128) % 256 - 128, raw[at + 1]
    data_at = at + 2 + dimensions
    shape = list(raw[at + 2 : data_at])
    width = _WIDTHS.get(kind)
    if width is None or dimensions > _DIMENSIONS or len(shape) < dimensions:
        return None
    size = width * prod(shape)
    data = raw[data_at : data_at + size]
    if len(data) < size:
        return None
    if kind == -1:
        return _texts(data, shape)
    if kind == 1:
        return np.frombuffer(data, "u1")
    return numbers.integers(data) if kind == 2 else numbers.floats(data)


def _texts(data: bytes, shape: list[int]) -> str | list[str]:
    if len(shape) < 2:
        return _text(data)
    length = shape[0]
    return [_text(data[at : at + length]) for at in range(0, len(data), length or 1)]


def _text(raw: bytes) -> str:
    """Return a text without padding and without characters that cannot be printed."""
    try:
        text = raw.decode("utf-8")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    return "".join(letter if letter.isprintable() else " " for letter in text).strip()


def fail(path: Path, problem: str) -> NoReturn:
    """Raise a RecordingError about a file."""
    raise RecordingError(f"{path.name}: {problem}")
