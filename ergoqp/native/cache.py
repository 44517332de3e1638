"""Machine code in the user's cache: private, compiled by one process at a time, bounded.

What is loaded from here runs with the rights of the user. So nobody else may be able to write to
the cache, and every file says itself what it was made for.
"""

from __future__ import annotations

import errno
import fcntl
import grp
import hashlib
import json
import os
import platform
import pwd
import shutil
import stat
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from ergoqp._version import __version__
from ergoqp.registry import cache_folder

LARGEST: Final = 48
"""How many libraries and programs are kept; the least recently used ones are removed."""

_REST: Final = 3600.0
"""For how long nothing is removed that was used [s]."""

_NOTE: Final = ".key"
"""Ending of a file that holds a key."""

_MAPPED: Final = 65534
"""Who owns the system's folders in a container of a user without rights."""


@dataclass(frozen=True)
class Entry:
    """A library or a program in the cache.

    Its methods raise an OSError if the cache cannot be used: it cannot be written to, or others
    than the user can write to it.

    Attributes:
        key: hash of all that goes into it, a word.
        name: its name, a word.
        ending: of its file name, such as ``.so``.
    """

    key: str
    name: str
    ending: str

    def find(self) -> Path | None:
        """Return the file, or None if it is not there, is damaged, or was made for another use."""
        cache = private_folder(make=False)
        if cache is None:
            return None
        folder = cache / self.key
        for path in sorted(folder.glob(f"{self.name}-*{self.ending}")):
            with suppress(FileNotFoundError):  # another process removes it
                if self._usable(path):
                    with suppress(OSError):  # a cache that is only read
                        os.utime(folder)
                    return path
        return None

    def build(self, make: Callable[[Path], Path]) -> Path:
        """Return the file, made now if it is not there.

        If another process makes it, this one waits for it.

        Args:
            make: makes the file in an empty folder, and returns its path.
        """
        cache = private_folder(make=True)
        assert cache is not None
        with locked(cache / f"{self.key}.lock"):
            if (found := self.find()) is not None:
                return found
            _tidy(cache)
            folder = cache / self.key
            with tempfile.TemporaryDirectory(prefix="scratch-", dir=cache) as scratch:
                made = make(Path(scratch))
                made.chmod(0o700)
                path = folder / f"{self.name}-{_digest(made)}{self.ending}"
                record = Path(scratch) / "record"
                record.write_text(json.dumps(self._record(path)), encoding="utf-8")
                _remove(folder)
                folder.mkdir(mode=0o700)
                # Renaming is atomic: another process finds the whole file or none.
                record.replace(_record_of(path))
                made.replace(path)
            return path

    def _usable(self, path: Path) -> bool:
        """Return whether a file is the user's own, unchanged, and made for this use."""
        if not (_own(path.parent, stat.S_ISDIR) and _own(path, stat.S_ISREG)):
            return False
        try:
            told = json.loads(_record_of(path).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return False
        # Loading a truncated library would end the process.
        whole = path.stem == f"{self.name}-{_digest(path)}"
        return whole and told == self._record(path)

    def _record(self, path: Path) -> dict[str, str]:
        """Return what a file says of itself."""
        return {"file": path.name, "key": self.key, "version": __version__, "machine": _machine()}


def _machine() -> str:
    """Return processor and C library of this machine, as far as a key does not tell them."""
    name = "CS_GNU_LIBC_VERSION"
    return f"{platform.machine()} {os.confstr(name) if name in os.confstr_names else ''}".strip()


def remember(short: str, path: Path) -> None:
    """Keep by which other key a file of the cache is found too, if the cache can be written to."""
    with suppress(OSError):
        note = path.parents[1] / f"{short}{_NOTE}"
        scratch = note.with_suffix(f".{os.getpid()}")
        scratch.write_text(path.parent.name, encoding="ascii")
        scratch.replace(note)


def remembered(short: str) -> str | None:
    """Return the key of the file that another key was kept for, see `remember`.

    Raises:
        OSError: if others than the user can write to the cache.
    """
    cache = private_folder(make=False)
    if cache is None:
        return None
    note = cache / f"{short}{_NOTE}"
    try:
        key = note.read_text(encoding="ascii") if _own(note, stat.S_ISREG) else ""
    except (FileNotFoundError, ValueError):
        return None
    return key if key.isalnum() else None


def private_folder(make: bool) -> Path | None:
    """Return the folder of the cache, in which nobody but the user can write.

    Args:
        make: whether it is made if it is missing; else None is returned.

    Raises:
        OSError: if it cannot be made, or somebody else can write to it.
    """
    top = cache_folder()
    folder = top / "compiled"
    if make:
        top.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        for each in (top, folder):
            each.mkdir(mode=0o700, exist_ok=True)
    elif not folder.is_dir():
        return None
    real = folder.resolve()
    for each in sorted({*top.parents, *real.parent.parents}):
        found = each.stat()
        if found.st_uid not in (0, os.geteuid(), _MAPPED):
            raise PermissionError(errno.EPERM, f"{str(each)!r} belongs to another user")
        # In a sticky folder only the owner of an entry can replace it.
        if _open(found) and not found.st_mode & stat.S_ISVTX:
            raise PermissionError(errno.EPERM, f"other users can write to {str(each)!r}")
    for each in (real.parent, real):
        if each.stat().st_uid == os.geteuid() and each.stat().st_mode & 0o077:
            with suppress(OSError):  # a cache that is only read
                each.chmod(0o700)
        if not _own(each, stat.S_ISDIR):
            raise PermissionError(errno.EPERM, f"other users can write to {str(each)!r}")
    return real


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Wait until no other process has a lock, and have it. It ends with the process."""
    # Not handed on to the compiler, which may live longer than this process.
    lock = os.open(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600)
    try:
        with suppress(OSError):  # a file system without locks: at worst, two compile the same
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield
    finally:
        os.close(lock)


def _tidy(cache: Path) -> None:
    """Remove what compilers that were killed have left, and what was not used for the longest."""
    before, kept, notes = time.time() - _REST, list[tuple[float, Path]](), list[Path]()
    with suppress(FileNotFoundError):  # another process removes something too
        for path in cache.iterdir():
            used = path.lstat().st_mtime
            if path.suffix == _NOTE:
                notes.append(path)
            elif path.is_dir() and not path.name.startswith(("scratch-", "tmp")):
                kept.append((used, path))
            elif used < before:
                _remove(path)
        for used, path in sorted(kept)[: max(0, len(kept) + 1 - LARGEST)]:
            if used < before:
                _remove(path)
        for note in notes:
            if not (cache / note.read_text(encoding="ascii", errors="replace")).is_dir():
                note.unlink()


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def _own(path: Path, kind: Callable[[int], bool]) -> bool:
    """Return whether a path is of a kind, is no link, and only this user can write to it."""
    found = path.lstat()
    return kind(found.st_mode) and found.st_uid == os.geteuid() and not _open(found)


def _open(found: os.stat_result) -> bool:
    """Return whether somebody else than the owner can write to a file or folder."""
    if found.st_mode & stat.S_IWOTH:
        return True
    if not found.st_mode & stat.S_IWGRP:
        return False
    try:
        group, owner = grp.getgrgid(found.st_gid), pwd.getpwuid(os.geteuid()).pw_name
    except KeyError:
        return True
    # Many systems give every user a group of their own, and let it write.
    return group.gr_name != owner or bool(set(group.gr_mem) - {owner})


def _record_of(path: Path) -> Path:
    return path.with_suffix(".json")


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:32]
