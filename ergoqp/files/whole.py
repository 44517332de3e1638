"""Files that are there whole or not at all.

Whoever reads one never finds half of it, whatever ended the writing.
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
def whole(path: Path) -> Iterator[Path]:
    """Give a file to write to instead of `path`, in the same folder.

    It takes the place of `path` in one move.

    If the writing fails the new file is gone, and what was there before is still there.

    Args:
        path: of the file that is to be there afterwards; what a link leads to is written, not the
            link.

    Raises:
        OSError: naming `path`, if it cannot be written.
    """
    target = path.resolve()
    # The ending stays: some writers add their own to a name without it.
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
def whole_folder(folder: Path) -> Iterator[Path]:
    """Give a folder to fill instead of `folder`, beside it.

    What is in it takes its place when all of it is there.

    A folder that is there already keeps what else it holds. If the filling fails, or what is there
    stands in the way, nothing has changed.

    Args:
        folder: that is to hold the files afterwards.

    Raises:
        OSError: naming `folder`, if they cannot be written.
    """
    target = folder.resolve()
    # Within what is there already: it may be another disk than the folder around it, or the only
    # one that can be written.
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
    """Return a name that nobody else writes to, in this process or another."""
    return f".ergoqp-{os.getpid()}-{next(_COUNT)}"


def write_json(path: Path, values: Any, indent: int = 2) -> None:
    """Write numbers, texts, lists and dicts as JSON, see `whole`.

    Raises:
        OSError: if it cannot be written.
        ValueError: for a number that is not finite.
    """
    write_whole(path, json.dumps(values, indent=indent, ensure_ascii=False, allow_nan=False) + "\n")


def write_whole(path: Path, text: str) -> None:
    """Write a text file, see `whole`.

    A file name that is part of the text may hold what no encoding can write: a question mark stands
    for it.

    Raises:
        OSError: if it cannot be written.
    """
    with whole(path) as scratch:
        scratch.write_text(text, encoding="utf-8", errors="replace")
