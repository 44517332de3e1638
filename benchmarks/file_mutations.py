"""Mutations of files: what mistyping, cutting, full disks and malice make of them."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.file_kinds import Kind

Rng = np.random.Generator

_NUMBERS = (
    b"nan",
    b"inf",
    b"-inf",
    b"1e308",
    b"-1e308",
    b"1e-320",
    b"0",
    b"-1",
    b"9" * 400,
    b"10000000000000",
    b"true",
    b'"x"',
)
_WORDS = (
    b"[" * 5000,
    b"{",
    b"}",
    b"[[",
    b"]]",
    b"\x00",
    b"\xff\xfe",
    b"\xef\xbb\xbf",
    b"= =",
    b"#",
    b"\r",
    b"'",
    b'"""',
    b"a.b.c = 1\n",
)


def mutated(kind: Kind, rng: Rng, folder: Path) -> Path:
    """Return a file of a kind with one to three mutations; a few are no files at all.

    Args:
        kind: of file.
        rng: of the mutations.
        folder: to write to.
    """
    path = folder / f"file{kind.suffix}"
    _remove(path)
    data = kind.made(rng)
    for _ in range(rng.integers(1, 4)):
        data = _choose(rng, kind.text)(data, rng)
    odd = rng.random()
    if odd < 0.01:
        os.mkfifo(path)
    elif odd < 0.02:
        path.mkdir()
    elif odd < 0.03:
        path.symlink_to(folder / "nowhere")
    elif odd < 0.99:
        path.write_bytes(data)
    return path


def _remove(path: Path) -> None:
    if path.is_symlink() or path.exists():
        path.rmdir() if path.is_dir() and not path.is_symlink() else path.unlink()


def _choose(rng: Rng, text: bool) -> Callable[[bytes, Rng], bytes]:
    of_text = (number, number, number, key, key, doubled, word, line_gone)
    of_all = (cut, cut, flipped, flipped, zeros, empty, swapped)
    some = of_text + of_all if text else of_all
    return some[rng.integers(len(some))]


def cut(data: bytes, rng: Rng) -> bytes:
    """Only the begin is there: the disk was full."""
    return data[: rng.integers(0, len(data) + 1)]


def empty(data: bytes, rng: Rng) -> bytes:
    """Nothing is there."""
    return b""


def flipped(data: bytes, rng: Rng) -> bytes:
    """A few bytes are others."""
    changed = bytearray(data)
    for _ in range(rng.integers(1, 6) if changed else 0):
        changed[rng.integers(len(changed))] = rng.integers(256)
    return bytes(changed)


def zeros(data: bytes, rng: Rng) -> bytes:
    """A block is zero, as after a crash."""
    start = rng.integers(0, len(data) + 1)
    length = int(rng.integers(1, 600))
    return data[:start] + b"\x00" * min(length, len(data) - start) + data[start + length :]


def swapped(data: bytes, rng: Rng) -> bytes:
    """A part is somewhere else."""
    if len(data) < 8:
        return data
    a, b, c = sorted(rng.integers(0, len(data), 3).tolist())
    return data[:a] + data[b:c] + data[a:b] + data[c:]


def number(data: bytes, rng: Rng) -> bytes:
    """A number is another one, or none."""
    places = list(re.finditer(rb"-?\d+\.?\d*(e-?\d+)?", data))
    if not places:
        return data
    place = places[rng.integers(len(places))]
    return data[: place.start()] + _NUMBERS[rng.integers(len(_NUMBERS))] + data[place.end() :]


def key(data: bytes, rng: Rng) -> bytes:
    """A word has a letter too many, or too few."""
    places = list(re.finditer(rb"[A-Za-z_]{3,}", data))
    if not places:
        return data
    place = places[rng.integers(len(places))]
    at = int(rng.integers(place.start(), place.end()))
    return data[:at] + (b"x" if rng.random() < 0.5 else b"") + data[at + 1 :]


def doubled(data: bytes, rng: Rng) -> bytes:
    """A line is there twice."""
    lines = data.split(b"\n")
    at = int(rng.integers(len(lines)))
    return b"\n".join([*lines[: at + 1], *lines[at:]])


def line_gone(data: bytes, rng: Rng) -> bytes:
    """A line is not there."""
    lines = data.split(b"\n")
    at = int(rng.integers(len(lines)))
    return b"\n".join(lines[:at] + lines[at + 1 :])


def word(data: bytes, rng: Rng) -> bytes:
    """Something is there that does not belong there."""
    at = int(rng.integers(0, len(data) + 1))
    return data[:at] + _WORDS[rng.integers(len(_WORDS))] + data[at:]
