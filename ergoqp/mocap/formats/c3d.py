"""C3D files: markers of motion laboratories, with the joint angles that their programs compute.

Header and parameters of C3D files of every processor type; the files are not trusted.

A file consists of blocks of 512 bytes: a header, parameters in groups, frames (c3d.org, "The C3D
File Format: User Guide"). Integers and floats are those of the computer that wrote it: Intel, DEC
or MIPS.

Number of frames of a C3D file. The header counts to 65 535 only, and often counts the frames of the
longer recording from which the file was cut. Programs state longer counts in three other places
(c3d.org, "The C3D frame count"). Of the stated counts, the one that agrees with the file's length
is used. No frames are dropped without a message.

The frames are read block by block, because an hour is too large for memory. Points that are not
markers (joint centres, forces, moments, powers of the laboratory's own model) are not taken as
markers. The angles of that model are returned.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isfinite, prod
from pathlib import Path
from typing import Any, BinaryIO, Final, NoReturn

import numpy as np

from ergoqp.arguments import Progress
from ergoqp.errors import RecordingError
from ergoqp.mocap.formats.text import TableOptions, binary, short
from ergoqp.mocap.formats.times import count_repeated_frames, to_seconds
from ergoqp.mocap.formats.trc import UNITS
from ergoqp.mocap.naming import nameless
from ergoqp.mocap.recording import JointMotion

BLOCK: Final = 512
_KEY: Final = 0x50
"""Second byte of a file."""
_PROCESSORS: Final = {84: "Intel", 85: "DEC", 86: "MIPS"}
"""Fourth byte of the parameters -> the computer whose numbers the file has."""
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
class Header:
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


def read_header(path: Path, file: BinaryIO) -> Header:
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
    # The parameter is preferred to the header.
    stated = _first(point.get("SCALE"))
    scale = stated if stated is not None and isfinite(stated) and stated else scale
    if not (isfinite(scale) and scale):
        fail(path, f"scale of the points: got {scale:g}, allowed a number that is not 0")
    return Header(
        points=words[1],
        analog=words[2],
        first=words[3],
        last=words[4],
        scale=scale,
        start=start,
        rate=hertz,
        numbers=numbers,
        parameters=parameters,
        notes=notes,
    )


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
    if kind == -1 and dimensions < 2:
        return _text(data)
    if kind == -1:
        return [_text(data[at : at + shape[0]]) for at in range(0, size, shape[0] or 1)]
    if kind == 1:
        return np.frombuffer(data, "u1")
    return numbers.integers(data) if kind == 2 else numbers.floats(data)


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


_LONGEST: Final = 65_535
"""Largest count of a 16-bit word; a file with more frames states this many, or wraps around."""
_LARGEST: Final = 1 << 53


def frames_of(path: Path, file: BinaryIO, header: Header, size: int) -> tuple[int, tuple[str, ...]]:
    """Return the number of frames of a file, and sentences.

    Args:
        path: the file.
        file: the opened file.
        header: its header.
        size: its size [bytes].

    Raises:
        RecordingError: if the file is cut, or holds more frames than it can count and states no
            long count.
    """
    there = max(size - header.start, 0) // header.frame_bytes
    counts, counted = _stated(header), (header.last - header.first + 1) % (_LONGEST + 1)
    if header.last < header.first and counted and _fills(counted, header, size):
        counts.append((counted, False))
    fitting = [each for each in counts if _fills(each[0], header, size)]
    count, ended = next(iter(fitting or counts), (0, False))
    more = there - count
    if count <= _LONGEST and (
        (fitting and ended and more and _tail(file, header, count))
        or (not fitting and any(last and there > frames for frames, last in counts))
        or (not fitting and any(_begun_anew(n, header, size) for n, _ in [(counted, 0), *counts]))
    ):
        fail(
            path,
            f"got {there} frames of which {count} are stated, allowed a long count"
            " (TRIAL:ACTUAL_END_FIELD or POINT:LONG_FRAMES) beyond 65535; export the take with it,"
            " or in parts",
        )
    if not count:
        fail(path, f"got the frames {header.first} to {header.last}, allowed 1 and more")
    if more < 0:
        fail(path, f"got {there} frames, allowed {count} as stated; the file is cut")
    # The rotations of segments are stored after the points.
    if more < 2 + BLOCK // header.frame_bytes or "ROTATION" in header.parameters:
        return count, ()
    return count, (
        f"The file states {count} frames and is long enough for {there}: the data after the stated"
        " frames is left out.",
    )


def _stated(header: Header) -> list[tuple[int, bool]]:
    """Return the counts of frames that a file states, the surest first.

    Each has whether it is the largest that can be stated there.
    """
    short = _whole(header.of("POINT", "FRAMES"))
    trial = [header.of("TRIAL", f"ACTUAL_{which}_FIELD") for which in ("START", "END")]
    counts = [
        (short if short != _LONGEST else 0, False),
        (_whole(header.of("POINT", "LONG_FRAMES")), False),
        (_between(*trial), False),
        (short if short == _LONGEST else 0, True),
        (header.last - header.first + 1, header.last == _LONGEST),
    ]
    return [each for each in counts if each[0] > 0]


def _whole(value: object) -> int:
    """Return a count of frames; 0 if there is none."""
    if not isinstance(value, np.ndarray) or not value.size:
        return 0
    if value.dtype.kind != "f":
        return int(value[0]) % (_LONGEST + 1)  # as unsigned
    return int(value[0]) if 1 <= value[0] < _LARGEST else 0


def _between(first: object, last: object) -> int:
    """Return the count from a first to a last frame, each stated in two words; 0 if not so."""
    numbers = []
    for value in (first, last):
        if not isinstance(value, np.ndarray) or value.size != 2 or value.dtype.kind != "i":
            return 0
        low, high = (int(word) % (_LONGEST + 1) for word in value)
        numbers.append(low + (_LONGEST + 1) * high)
    return numbers[1] - numbers[0] + 1


def _left(count: int, header: Header, size: int) -> int:
    """Return the number of bytes after some number of frames."""
    return size - header.start - count * header.frame_bytes


def _fills(count: int, header: Header, size: int) -> bool:
    """Return whether some number of frames fills a file, up to a rest of less than a block."""
    return 0 <= _left(count, header, size) < BLOCK


def _begun_anew(count: int, header: Header, size: int) -> bool:
    """Return whether a file holds a multiple of 65 536 frames more than a count."""
    left = _left(count, header, size)
    round_ = (_LONGEST + 1) * header.frame_bytes
    return count <= _LONGEST and left >= round_ and left % round_ < BLOCK


def _tail(file: BinaryIO, header: Header, count: int) -> bool:
    """Return whether there is other data than zeros after some number of frames."""
    file.seek(header.start + count * header.frame_bytes)
    return any(file.read(BLOCK))


_BLOCK: Final = 4 << 20
"""Bytes that are read at once."""
_COMPUTED: Final = ("FORCES", "MOMENTS", "POWERS", "SCALARS", "REACTIONS", "MODELED_MARKERS")
"""Groups of points that are computed and are not markers."""
_FARTHEST: Final = 1e9
"""Largest number of a point or an angle; larger ones are bits with another meaning."""
_SUBJECT: Final = "PROCESSING"
"""Group in which Vicon's programs store the measures of the person."""


def read_c3d(path: Path, progress: Progress, asked: TableOptions) -> JointMotion:
    """Return the labelled markers of a file, and its joint angles.

    A point that no camera sees, or at the origin, is not seen.

    Args:
        path: the file.
        progress: is called with the share of the file that is read.
        asked: unused, because a file states its rate.

    Raises:
        RecordingError: if it is not a C3D file, is cut, or has no labelled marker.
    """
    with binary(path) as file:
        header = read_header(path, file)
        count, said = frames_of(path, file, header, path.stat().st_size)
        labels, again, notes = _labels(header)
        bent_ones, computed = _named(header, "ANGLES"), _named(header, *_COMPUTED)
        angles = {name: i for name, i in labels.items() if _is(name, bent_ones)}
        markers = {
            name: i for name, i in labels.items() if name not in angles and not _is(name, computed)
        }
        if not markers:
            fail(
                path,
                f"got no marker with a name among {header.points} points, allowed labelled markers;"
                " label them in the program that recorded them",
            )
        named = [*markers.items(), *((name, i) for name, i in again if name in markers)]
        positions, bent = _frames(
            file, header, count, [i for _, i in named], list(angles.values()), progress
        )
    time, _, uniform = to_seconds(path.name, np.arange(count) / header.rate, 1.0)
    if others := len(labels) - len(markers) - len(angles):
        notes.append(f"{others} points are computed (forces, moments, powers) and left out.")
    unit = UNITS.get(header.text("POINT", "UNITS"))
    if not header.text("POINT", "ANGLE_UNITS").startswith("rad"):
        bent *= np.float32(np.pi / 180)
    motion = JointMotion(
        tuple(name for name, _ in named),
        positions,
        time,
        None,
        (*header.notes, *said, *notes, *uniform, *count_repeated_frames(positions)),
        angles={
            f"{name} {axis}": bent[:, i, j]
            for i, name in enumerate(angles)
            for j, axis in enumerate("xyz")
        },
        markers=True,
        unit=unit,
        measures=_measures(header, unit),
    )
    return motion.once()


def _named(header: Header, *groups: str) -> frozenset[str]:
    """Return the names of the points in some groups."""
    return frozenset(name for group in groups for name in header.texts("POINT", group) if name)


def _is(name: str, named: frozenset[str]) -> bool:
    """Return whether a point is among those of a group, whose names may lack the prefix."""
    return name in named or name.rpartition(":")[2] in named


def _labels(header: Header) -> tuple[dict[str, int], list[tuple[str, int]], list[str]]:
    """Return name -> index of its point, the further points of equal names, and sentences."""
    stated = header.texts("POINT", "LABELS")
    notes: list[str] = []
    labels: dict[str, int] = {}
    again: list[tuple[str, int]] = []
    if len(stated) > header.points and any(stated[header.points :]):
        notes.append(
            f"The file names {len(stated)} points and has {header.points}: the first names are"
            " used."
        )
    lost = max(header.points - len(stated), 0)
    for i, name in enumerate(stated[: header.points]):
        if nameless(name):
            lost += 1
        elif name in labels:
            again.append((name, i))
        else:
            labels[name] = i
    if lost:
        notes.append(f"{lost} of {header.points} points have no label and are left out.")
    return labels, again, notes


def _frames(
    file: BinaryIO,
    header: Header,
    count: int,
    markers: list[int],
    angles: list[int],
    progress: Progress,
) -> tuple[np.ndarray, np.ndarray]:
    """Return positions (n, m, 3) of markers and values (n, a, 3) of angles."""
    length = header.frame_bytes
    positions = np.empty((count, len(markers), 3), dtype=np.float32)
    bent = np.empty((count, len(angles), 3), dtype=np.float32)
    file.seek(header.start)
    many = max(_BLOCK // length, 1)
    for at in range(0, count, many):
        now = min(many, count - at)
        with np.errstate(invalid="ignore", over="ignore"):  # some bits are not numbers
            points = _points(file.read(now * length), header, now)
            lost = ~(points[:, :, 3] >= 0) | ~(np.abs(points[:, :, :3]) <= _FARTHEST).all(axis=2)
            points[lost, :3] = np.nan
            bent[at : at + now] = points[:, angles, :3]
            places = points[:, markers, :3]
            places[(places == 0).all(axis=2)] = np.nan
        positions[at : at + now] = places
        progress((at + now) / count)
    return positions, bent


def _points(raw: bytes, header: Header, count: int) -> np.ndarray:
    """Return x, y, z [file unit] and a number that is negative if not seen (n, m, 4)."""
    of_points = 4 * header.points
    if header.scale < 0:
        values = header.numbers.floats(raw).reshape(count, -1)[:, :of_points]
        return values.reshape(count, header.points, 4)
    values = header.numbers.integers(raw).reshape(count, -1)[:, :of_points]
    points = values.reshape(count, header.points, 4).astype(np.float32)
    points[:, :, :3] *= header.scale
    return points


def _measures(header: Header, unit: float | None) -> dict[str, float]:
    """Return the measures of the person [m]; none if the unit is unknown."""
    found = {}
    for name, stated in header.parameters.get(_SUBJECT, {}).items():
        value = _first(stated)
        if unit is not None and value is not None and 0 < value <= _FARTHEST:
            found[name.casefold()] = value * unit
    return found
