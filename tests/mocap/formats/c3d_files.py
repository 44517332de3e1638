"""C3D files made byte by byte, of every processor, as the format's user guide has them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

BLOCK = 512
CODES = {"Intel": 84, "DEC": 85, "MIPS": 86}
POINTS = np.array(
    [[[1, 2, 3], [4, 5, 6]], [[1.5, 2.5, 3.5], [4.5, 5.5, 6.5]], [[-8, 2, 3], [4, 5, 6.25]]]
)
POINT: dict[str, Any] = {"LABELS": ["LASI", "RASI"], "UNITS": "mm", "USED": 2}


def words(values: Any, processor: str) -> bytes:
    """Return 16-bit integers."""
    order = ">" if processor == "MIPS" else "<"
    return (np.atleast_1d(np.asarray(values, np.int64)) % 65536).astype(f"{order}u2").tobytes()


def floats(values: Any, processor: str) -> bytes:
    """Return 32-bit floats."""
    if processor == "MIPS":
        return np.asarray(values, ">f4").tobytes()
    if processor == "Intel":
        return np.asarray(values, "<f4").tobytes()
    halves = np.frombuffer((4 * np.asarray(values)).astype("<f4").tobytes(), "<u2").reshape(-1, 2)
    return halves[:, ::-1].tobytes()


def parameter(group: int, name: str, value: Any, processor: str) -> bytes:
    """Return one parameter: text, texts, whole numbers, numbers, or (type, shape, bytes)."""
    if isinstance(value, tuple):
        kind, shape, data = value
    elif isinstance(value, str):
        kind, shape, data = -1, (len(value.encode()),), value.encode()
    elif isinstance(value, list) and all(isinstance(each, str) for each in value):
        letters = max([len(each.encode()) for each in value], default=0)
        kind, shape = -1, (letters, len(value))
        data = b"".join(each.encode().ljust(letters) for each in value)
    else:
        shape = np.shape(value)
        whole = np.asarray(value).dtype.kind == "i"
        kind, data = (2, words(value, processor)) if whole else (4, floats(value, processor))
    body = bytes([kind % 256, len(shape), *shape]) + data + b"\0"
    return bytes([len(name), group]) + name.encode() + words(len(body) + 2, processor) + body


def section(groups: Mapping[str, Mapping[str, Any]], processor: str) -> bytes:
    """Return the parameters, in whole blocks."""
    raw = b""
    for number, (name, values) in enumerate(groups.items(), 1):
        raw += bytes([len(name), 256 - number]) + name.encode() + words(3, processor) + b"\0"
        raw += b"".join(parameter(number, key, each, processor) for key, each in values.items())
    blocks = -(-(len(raw) + 6) // BLOCK)
    return (b"\0\0" + bytes([blocks % 256, CODES[processor]]) + raw).ljust(BLOCK * blocks, b"\0")


def made(
    points: np.ndarray = POINTS,
    point: Mapping[str, Any] = POINT,
    groups: Mapping[str, Mapping[str, Any]] | None = None,
    *,
    processor: str = "Intel",
    scale: float = -0.1,
    rate: float = 100.0,
    fourth: Any = 0,
    analog: int = 0,
    first: int = 1,
    last: int | None = None,
    block: int = 2,
    pad: bool = True,
) -> bytes:
    """Return a file.

    Args:
        points: (n, m, 3), in its unit.
        point: the parameters of the group POINT.
        groups: further groups.
        processor: Intel, DEC or MIPS.
        scale: negative for frames of floats, else what an integer stands for.
        rate: frames per second.
        fourth: number beside each point (n, m): -1 where it is not seen.
        analog: numbers behind the points of each frame.
        first: number of the first frame.
        last: of the last one, as the header states it.
        block: where the parameters begin.
        pad: whether the file ends with a whole block.
    """
    frames, count = points.shape[:2]
    parameters = section({"POINT": point, **(groups or {})}, processor)
    start = block + len(parameters) // BLOCK
    last = first + frames - 1 if last is None else last
    begin = bytes([block, 0x50]) + words([count, analog, first, last, 10], processor)
    begin += floats(scale, processor) + words([start, 1 if analog else 0], processor)
    begin += floats(rate, processor)
    four = np.zeros((frames, count, 4))
    four[:, :, :3] = points if scale < 0 else np.rint(points / scale)
    four[:, :, 3] = fourth
    rows = np.hstack([four.reshape(frames, 4 * count), np.full((frames, analog), 7777)])
    data = floats(rows, processor) if scale < 0 else words(rows, processor)
    whole = begin.ljust(BLOCK * (block - 1), b"\0") + parameters + data
    return whole.ljust(-(-len(whole) // BLOCK) * BLOCK, b"\0") if pad else whole
