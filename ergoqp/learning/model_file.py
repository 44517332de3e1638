"""Files of learned models: arrays and a JSON header in one npz file, with a checksum.

They contain no pickle, so a file cannot run code.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ergoqp.arguments import path_of
from ergoqp.errors import ModelError
from ergoqp.files.atomic import atomic_write
from ergoqp.files.read import read_npz

Settings = Mapping[str, Any]
"""Settings of a model, for JSON."""

Arrays = Mapping[str, NDArray[Any]]
"""Arrays of a model, by name."""

FORMAT: Final = "ergoqp-model-1"
"""Name of the format, in the header of every file."""

_HEADER: Final = "header"


def save_model(path: Path | str, header: Settings, arrays: Arrays) -> None:
    """Write a model. An existing file is replaced in one move, so no reader sees half of it.

    Args:
        path: path of the file; the folder must exist.
        header: values for JSON; ``kind`` names the kind of model.
        arrays: arrays by name.

    Raises:
        ModelError: if the file cannot be written.
    """
    path = path_of("model", path, ModelError)
    numbers = {name: np.ascontiguousarray(values) for name, values in arrays.items()}
    full = {"format": FORMAT, **header, "checksum": _checksum(header, numbers)}
    text = np.frombuffer(json.dumps(full, sort_keys=True).encode(), dtype=np.uint8)
    try:
        with atomic_write(path) as scratch, scratch.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **{_HEADER: text}, **numbers)
    except OSError as error:
        raise ModelError(f"{path.name}: cannot be written: {error.strerror}") from None


def load_model(path: Path | str) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Read a model and return its header and its arrays.

    Raises:
        ModelError: if the file does not exist, is not a model, is truncated or changed, or
            holds a value that is not a number.
    """
    path = path_of("model", path, ModelError)
    arrays = read_npz(path, [_HEADER])
    try:
        header = json.loads(arrays.pop(_HEADER).tobytes())
        claimed = header.pop("checksum")
        if header.pop("format") != FORMAT:
            raise ModelError(f"{path.name}: is a model of another format; {FORMAT} is read")
    except (ValueError, KeyError, AttributeError, TypeError, RecursionError) as error:
        raise ModelError(
            f"{path.name}: is not a model file of {FORMAT} ({type(error).__name__})"
        ) from None
    if claimed != _checksum(header, arrays):
        raise ModelError(f"{path.name}: was changed after it was saved: the checksum does not fit")
    for name, values in arrays.items():
        if values.dtype.kind == "f" and np.isnan(values).any():
            raise ModelError(f"{path.name}: got NaN in {name!r}, allowed numbers")
    return header, arrays


def _checksum(header: Settings, arrays: Arrays) -> str:
    digest = hashlib.sha256(json.dumps(dict(header), sort_keys=True).encode())
    for name in sorted(arrays):
        values = arrays[name]
        digest.update(f"{name} {values.dtype.str} {values.shape}".encode())
        digest.update(values.tobytes())
    return digest.hexdigest()
