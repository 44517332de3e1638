"""Arrays from npz files of unknown origin.

The sizes that a file declares are checked before anything is allocated.
"""

from __future__ import annotations

import stat
import zipfile
import zlib
from collections.abc import Collection
from math import prod
from pathlib import Path
from typing import Final

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from ergoqp.errors import ModelError

LARGEST: Final = 300_000_000
"""Largest total size of all arrays of a file, unpacked [bytes]."""

_UNREADABLE: Final = (
    ValueError,
    KeyError,
    EOFError,
    AttributeError,
    TypeError,
    NotImplementedError,
    zipfile.BadZipFile,
    zlib.error,
    MemoryError,
    OverflowError,
    SyntaxError,
    RecursionError,  # from a header that is not valid
    RuntimeError,  # an encrypted zip, or a compression that Python does not know
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
            raise ModelError(f"{path.name}: got no file, allowed a .npz file")
        with path.open("rb") as raw, zipfile.ZipFile(raw) as packed:
            claimed = sum(entry.file_size for entry in packed.infolist())
            if claimed > LARGEST:
                raise ModelError(f"{path.name}: got {claimed} bytes of arrays, allowed {LARGEST}")
            arrays = {
                entry.filename.removesuffix(".npy"): _read(packed, entry)
                for entry in packed.infolist()
            }
    except FileNotFoundError:
        raise ModelError(f"{path.name}: is not there, allowed a .npz file") from None
    except OSError as error:
        raise ModelError(
            f"{path.name}: cannot be read: {error.strerror or error}, allowed a .npz file"
        ) from None
    except _UNREADABLE as error:
        why = type(error).__name__
        raise ModelError(
            f"{path.name}: got no .npz file of numbers, or a part of one ({why}), allowed a"
            " whole one"
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
