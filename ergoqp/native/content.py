"""A hash of what the package makes a function from, without making it.

Equal hashes mean equal functions. So there is a hash only of what is known to the last bit:
numbers, texts, arrays and the package's own objects, as the package's own files compute with them.
Anything else, such as a term of the user's, has none.
"""

from __future__ import annotations

import hashlib
import os
import platform
import sys
from collections.abc import Iterable, Iterator
from enum import Enum
from functools import cached_property, partial
from pathlib import Path
from types import FunctionType, MappingProxyType
from typing import Any, Final

import casadi as ca
import mujoco
import numpy as np
import scipy

from ergoqp._version import LOADED
from ergoqp.registry import data_folder

_CLOCK: Final = 0.05
"""How far the time of a file may be behind the clock [s]."""

_PACKAGE: Final = Path(__file__).resolve().parents[1]


class _UnknownError(Exception):
    """Something whose content is not known."""


def content_key(*values: Any) -> str | None:
    """Return a hash of values and of all that the package computes with them; None if unknown.

    It holds as long as nobody replaces functions of the package or of a library at run time.
    """
    known = hashlib.sha256()
    try:
        libraries = [ca.CasadiMeta.version(), np.__version__, scipy.__version__, mujoco.__version__]
        for value in (*values, *libraries, platform.python_version(), *_files()):
            for part in _parts(value):
                known.update(part)
    except (_UnknownError, RecursionError, OSError):
        return None
    return known.hexdigest()[:32]


def value_key(*values: Any) -> str | None:
    """Return a hash of values alone, which is that of any installation; None if unknown."""
    known = hashlib.sha256()
    try:
        for part in _parts(values):
            known.update(part)
    except (_UnknownError, RecursionError):
        return None
    return known.hexdigest()[:32]


def _files() -> Iterator[str]:
    """Give the state of every file of the package, as this process has loaded it."""
    for folder in (_PACKAGE, data_folder("models")):
        for place, folders, names in os.walk(folder):
            folders[:] = sorted(each for each in folders if each != "__pycache__")
            for name in sorted(names):
                path = os.path.join(place, name)
                found = os.stat(path)
                # What was changed since may not be what this process runs.
                if found.st_ctime > LOADED - _CLOCK:
                    raise _UnknownError
                yield f"{path} {found.st_size} {found.st_mtime_ns} {found.st_ctime_ns}"


def _parts(value: Any) -> Iterator[bytes]:
    """Give a value as bytes, from which it could be read again: of equal bytes it is the same."""
    kind = type(value)
    if value is None or kind in (bool, int, float, complex, str, bytes):
        yield from _sized(kind.__name__, repr(value).encode())
    elif kind in (list, tuple):
        yield from _many(kind.__name__, value)
    elif kind in (dict, MappingProxyType):
        yield from _many("dict", [each for pair in value.items() for each in pair])
    elif kind in (set, frozenset):
        yield from _many("set", sorted(b"".join(_parts(each)) for each in value))
    elif isinstance(value, partial) and kind is partial:
        yield from _many("partial", [value.func, value.args, value.keywords])
    elif isinstance(value, (np.ndarray, np.generic)) and kind.__module__ == "numpy":
        array = np.ascontiguousarray(value)
        if array.dtype.hasobject:
            raise _UnknownError
        yield from _sized(f"{kind.__name__} {array.dtype.str} {np.shape(value)}", array.tobytes())
    elif isinstance(value, (type, FunctionType)):
        yield from _sized("name", _name(value).encode())
    elif isinstance(value, Enum):
        yield from _many(_name(kind), [value.name])
    else:
        yield from _many(_name(kind), [_state(value)])


def _state(value: Any) -> Any:
    """Return what an object of the package is made from."""
    kind = type(value)
    if isinstance(value, tuple):
        return tuple(value)
    own = None
    if kind.__reduce__ is not object.__reduce__:
        own = value.__reduce__()
    elif kind.__getstate__ is not object.__getstate__:
        own = value.__getstate__()
    elif not hasattr(value, "__dict__"):
        raise _UnknownError
    # What an object computes from the rest: what is kept once it was asked for, and expressions
    # without which another process gets the object.
    rest = {
        name: part
        for name, part in getattr(value, "__dict__", {}).items()
        if not isinstance(getattr(kind, name, None), cached_property)
        and not (own is not None and type(part).__module__ == ca.SX.__module__)
    }
    return own, rest


def _name(value: type | FunctionType) -> str:
    """Return the name of a class or function of the package."""
    found: Any = sys.modules.get(value.__module__)
    own = Path(getattr(found, "__file__", None) or "").is_relative_to(_PACKAGE)
    for part in value.__qualname__.split("."):
        found = getattr(found, part, None)
    if found is not value or not own:
        raise _UnknownError
    return f"{value.__module__}:{value.__qualname__}"


def _many(kind: str, values: Iterable[Any]) -> Iterator[bytes]:
    values = list(values)
    yield f"{kind} {len(values)};".encode()
    for value in values:
        yield from _parts(value)


def _sized(kind: str, content: bytes) -> Iterator[bytes]:
    yield f"{kind} {len(content)};".encode()
    yield content
