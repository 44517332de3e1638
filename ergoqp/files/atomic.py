"""Files that are written completely or not at all.

A reader never finds a part of a file, even if the writing is interrupted.
"""

from __future__ import annotations

import errno
import itertools
import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

_COUNT = itertools.count()


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Yield a temporary file in the same folder as `path`, to write to.

    Afterwards it replaces `path` in one move.

    If the writing fails, the temporary file is deleted and the old file stays.

    Args:
        path: path of the final file. A link is followed: its target is replaced, not the link.

    Raises:
        OSError: if it cannot be written; the message names `path`.
    """
    target = path.resolve()
    # Keep the ending, because some writers append their own to a name without it.
    scratch = target.with_name(f"{_own_name()}{target.suffix[-20:]}")
    try:
        yield scratch
        scratch.replace(target)
    except BaseException as error:
        with suppress(OSError):
            scratch.unlink()
        if isinstance(error, OSError):
            error.filename, error.filename2 = str(path), None
        raise


@contextmanager
def atomic_directory(folder: Path) -> Iterator[Path]:
    """Yield a temporary folder near `folder`, to fill.

    Afterwards its contents are moved to `folder`, where they replace files of the same names.

    A folder that exists already keeps its other contents. If the filling fails, or an existing
    file or folder is in the way, nothing changes.

    Args:
        folder: path of the final folder.

    Raises:
        OSError: if it cannot be written; the message names `folder`.
    """
    target = folder.resolve()
    # Inside the folder if it exists: it may be on another disk than its parent, or the only
    # place that can be written to.
    scratch = (target if target.exists() else target.parent) / _own_name()
    try:
        scratch.mkdir(parents=True)
        yield scratch
        if not target.exists():
            scratch.replace(target)
            return
        made = [(each, target / each.relative_to(scratch)) for each in sorted(scratch.rglob("*"))]
        for each, place in made:
            if place.exists() and place.is_dir() != each.is_dir():
                raise OSError(
                    errno.EEXIST, os.strerror(errno.EEXIST), str(folder / place.relative_to(target))
                )
        for each, place in made:
            if each.is_dir():
                place.mkdir(exist_ok=True)
            else:
                each.replace(place)
    except OSError as error:
        if error.errno != errno.EEXIST:
            error.filename, error.filename2 = str(folder), None
        raise
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def _own_name() -> str:
    """Return a name that no other process and no other call uses."""
    return f".ergoqp-{os.getpid()}-{next(_COUNT)}"


def write_json(path: Path, values: Any, indent: int = 2) -> None:
    """Write numbers, texts, lists and dicts as JSON, see `atomic_write`.

    Raises:
        OSError: if the file cannot be written.
        ValueError: if a number is not finite.
    """
    write_text_atomic(
        path, json.dumps(values, indent=indent, ensure_ascii=False, allow_nan=False) + "\n"
    )


def write_text_atomic(path: Path, text: str) -> None:
    """Write a text file, see `atomic_write`.

    Characters that UTF-8 cannot encode, for example in a file name, become question marks.

    Raises:
        OSError: if the file cannot be written.
    """
    with atomic_write(path) as scratch:
        scratch.write_text(text, encoding="utf-8", errors="replace")
