"""Files of unknown origin: TOML, JSON and npz.

Every fault of a file gives an error of one sentence.

Arrays from npz files of unknown origin. The sizes that a file declares are checked before anything
is allocated.
"""

from __future__ import annotations

import json
import re
import stat
import tomllib
import zipfile
import zlib
from collections.abc import Collection
from math import prod
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from ergoqp.errors import InputError, ModelError

LARGEST_TOML: Final = 1_000_000
"""Largest size of a file that a user writes [bytes]."""

_HINTS: Final = {
    r"Illegal character '\n'": "is a text in that line not closed by a quotation mark?",
    "Unterminated string": "is a text not closed by a quotation mark?",
    "Expected \"'": "is a text not closed by a quotation mark?",
    "Unclosed array": "is a list not closed by ]?",
    "Unescaped '\\'": "a text with backslashes stands in single quotation marks",
    "Invalid value": "a text stands in quotation marks, and true and false are lower case",
    "after a statement": "is there a decimal comma, or more after the value?",
}
"""What a message of the parser often means."""

LARGEST_JSON: Final = 100_000_000
"""Largest size of a file that the package writes [bytes]."""


LONGEST_KEY: Final = 32
"""Largest number of parts of a dotted key. The parser's time grows with its square."""

_PART: Final = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+"""
_LONG_KEY: Final = re.compile(rf"""(?<![\w"'-]){_PART}(?:\.[ \t]*+{_PART}){{{LONGEST_KEY}}}""")
"""A longer key; no part of it is read twice."""


def read_toml(path: Path, what: str) -> dict[str, Any]:
    """Return the tables of a TOML file.

    Args:
        path: path of the file.
        what: what the file is, for the message.

    Raises:
        InputError: if it does not exist, is not a file, is too large, has a key of too many parts,
            or is not TOML.
    """
    return toml_of(toml_text(path, what), f"{what}: {path.name}")


def toml_text(path: Path, what: str) -> str:
    """Return the text of a TOML file.

    Args:
        path: path of the file.
        what: what the file is, for the message.

    Raises:
        InputError: if it does not exist, is not a file, is too large, or is not text.
    """
    return _text(path, what, LARGEST_TOML)


def toml_of(text: str, what: str) -> dict[str, Any]:
    """Return the tables of a TOML text.

    Args:
        text: the text.
        what: what it is, for the message.

    Raises:
        InputError: if it is too large, has a key of too many parts, or is not TOML.
    """
    if len(text) > LARGEST_TOML:
        raise InputError(f"{what}: got {len(text)} characters, allowed {LARGEST_TOML}")
    if long := _LONG_KEY.search(text):
        line = text.count("\n", 0, long.start()) + 1
        raise InputError(
            f"{what}: got a key of more than {LONGEST_KEY} parts in line {line}, allowed a shorter"
            " one"
        )
    try:
        return tomllib.loads(text)
    except RecursionError:
        why = "tables within tables without end"
    except ValueError as error:  # invalid TOML, and numbers with thousands of digits
        why = str(error)
    hint = next((f" ({hint})" for words, hint in _HINTS.items() if words in why), "")
    raise InputError(f"{what}: not a TOML file: {why}{hint}")


def read_json(path: Path, what: str) -> Any:
    """Return the contents of a JSON file, without NaN.

    Args:
        path: path of the file.
        what: what the file is, for the message.

    Raises:
        InputError: if it does not exist, is not a file, is too large, or is not JSON.
    """
    return json_of(_text(path, what, LARGEST_JSON), f"{what}: {path.name}")


def json_of(text: str, what: str) -> Any:
    """Return the contents of a JSON text, without NaN.

    Raises:
        InputError: if it is not JSON.
    """
    try:
        return json.loads(text, parse_constant=_constant)
    except RecursionError:
        why = "lists within lists without end"
    except ValueError as error:
        why = str(error)
    raise InputError(f"{what}: not JSON: {why}")


def _constant(name: str) -> float:
    if name == "NaN":
        raise ValueError("NaN is no number")
    return float(name)


def _text(path: Path, what: str, largest: int) -> str:
    try:
        found = path.stat()
        # Opening a pipe or a device could block.
        if not stat.S_ISREG(found.st_mode):
            raise InputError(
                f"{what}: {path.name}: is {'a directory' if path.is_dir() else 'no file'}"
            )
        if found.st_size > largest:
            raise InputError(f"{what}: {path.name}: got {found.st_size} bytes, allowed {largest}")
        return path.read_bytes().decode("utf-8-sig")
    except FileNotFoundError:
        raise InputError(f"{what}: {path.name}: no such file") from None
    except UnicodeDecodeError as error:
        raise InputError(
            f"{what}: {path.name}: not text: byte {error.start} is not UTF-8; save it as UTF-8"
        ) from None
    except (OSError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(
            f"{what}: {path.name}: cannot be read: {getattr(error, 'strerror', None) or error}"
        ) from None


LARGEST: Final = 300_000_000
"""Largest total size of all arrays of a file, unpacked [bytes]."""

_UNREADABLE: Final = (
    ValueError,
    KeyError,
    EOFError,
    AttributeError,
    TypeError,
    zipfile.BadZipFile,
    zlib.error,
    MemoryError,
    OverflowError,
    SyntaxError,
    # an encrypted zip, a compression that Python does not know, or a header that is not valid
    RuntimeError,
)


def read_npz(path: Path, names: Collection[str] | None = None) -> dict[str, NDArray]:
    """Return the arrays of a file, by name, without pickle and objects.

    Args:
        path: path of the file.
        names: arrays that must be there; None: no requirement.

    Raises:
        ModelError: if the file does not exist, is not an npz file, is truncated, or declares
            more than `LARGEST`.
    """
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise ModelError(f"{path.name}: is no file")
        with path.open("rb") as raw, zipfile.ZipFile(raw) as packed:
            claimed = sum(entry.file_size for entry in packed.infolist())
            if claimed > LARGEST:
                raise ModelError(f"{path.name}: got {claimed} bytes of arrays, allowed {LARGEST}")
            arrays = {
                entry.filename.removesuffix(".npy"): _read(packed, entry)
                for entry in packed.infolist()
            }
    except FileNotFoundError:
        raise ModelError(f"{path.name}: no such file") from None
    except OSError as error:
        raise ModelError(f"{path.name}: cannot be read: {error.strerror or error}") from None
    except _UNREADABLE as error:
        why = type(error).__name__
        raise ModelError(
            f"{path.name}: is no .npz file of numbers, or only a part of one ({why})"
        ) from None
    if missing := sorted(set(names or ()) - set(arrays)):
        raise ModelError(
            f"{path.name}: got {', '.join(sorted(arrays))}, allowed only with {', '.join(missing)}"
        )
    return arrays


def _read(packed: zipfile.ZipFile, entry: zipfile.ZipInfo) -> NDArray:
    """Return one array, if its header fits its size."""
    with packed.open(entry) as file:
        version = npy.read_magic(file)
        read_header = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}[
            version
        ]
        shape, fortran, kind = read_header(file, max_header_size=10_000)
        if kind.hasobject or kind.kind not in "biufU" or min(shape, default=0) < 0:
            raise ValueError("an array of something else than numbers and words")
        count = prod(shape)
        if count * kind.itemsize > entry.file_size:
            raise ValueError("an array that is larger than its file")
        data = file.read(count * kind.itemsize)
        if file.read(1):
            raise ValueError("an array that is smaller than its file")
    return (
        np.frombuffer(data, dtype=kind, count=count)
        .reshape(shape, order="F" if fortran else "C")
        .copy()
    )
