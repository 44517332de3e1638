"""Machine code that comes with the package, for problems of usual structures.

A wheel with libraries has them in its folder ``libraries``, each with a record of what it was made
for. A checkout has none. See `tools.libraries`.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import platform
import stat
import sys
from ctypes import CDLL
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

from ergoqp._version import __version__
from ergoqp.errors import last_line
from ergoqp.native.compiled import processor_flags

_LOG: Final = logging.getLogger(__name__)

FOLDER: Final = Path(__file__).resolve().parents[1] / "libraries"
"""Where the libraries of this installation are; missing if it has none."""

VARIANTS: Final = ("v3", "baseline")
"""For the third level of x86-64, and for every processor of the machine."""


def machine() -> str:
    """Return system and processor of this machine, as a record names them."""
    return f"{sys.platform} {platform.machine()}"


def digest(content: bytes) -> str:
    """Return the hash of a library, as a record holds it."""
    return hashlib.sha256(content).hexdigest()


def shipped(name: str, key: str, layout: Any) -> Path | None:
    """Return the library that comes with the package; None if there is none that fits.

    Why one is refused is a warning in the log, once.

    Args:
        name: name of its function, a word.
        key: hash of what it computes, a word.
        layout: what its record must say of its inputs and its state.
    """
    return _shipped(FOLDER, name, key, json.dumps(layout))


@lru_cache(maxsize=64)
def _shipped(folder: Path, name: str, key: str, layout: str) -> Path | None:
    for variant in VARIANTS if processor_flags() else VARIANTS[1:]:
        path = folder / f"{name}-{key}-{variant}.so"
        if path.is_file():
            if (why := _refused(path, key, layout)) is None:
                return path
            _LOG.warning("shipped library %s is not used: %s; reinstall ergoqp", path.name, why)
    return None


def _refused(path: Path, key: str, layout: str) -> str | None:
    """Return why a library is not loaded; None: nothing is against it."""
    record = path.with_suffix(".json")
    try:
        for each in (path.parent, path, record):
            if (why := _unsafe(each)) is not None:
                return why
        told = json.loads(record.read_text(encoding="utf-8"))
        content = path.read_bytes()
    except (OSError, ValueError):
        return "its record cannot be read"
    wanted = {"version": __version__, "machine": machine(), "key": key}
    for name, value in wanted.items():
        if told.get(name) != value:
            return f"got one for {name} {told.get(name)!r}, allowed {value!r}"
    if told.get("layout") != json.loads(layout):
        return "got one with other inputs or another state, allowed those of this problem"
    if told.get("sha256") != digest(content):
        return "it is damaged"
    try:
        CDLL(str(path))
    except OSError as error:
        return f"this machine cannot load it ({last_line(error)})"
    return None


def _unsafe(path: Path) -> str | None:
    """Return who else could have written a file or folder; None: who can change the package."""
    found, package = path.stat(), Path(__file__).stat()
    if found.st_uid not in (0, os.geteuid(), package.st_uid):
        return f"{path.name!r} belongs to another user"
    open_to = found.st_mode & (stat.S_IWOTH | stat.S_IWGRP & ~package.st_mode)
    return f"other users can write to {path.name!r}" if open_to else None
