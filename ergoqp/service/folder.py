"""Where the service's sockets are: a private folder of the user's runtime directory."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path
from typing import Final

from ergoqp.errors import InputError

LONGEST_PATH: Final = 107
"""Longest path of a Unix socket [bytes]."""


def default_folder() -> Path:
    """Return the folder of the sockets of this user, whether it exists or not."""
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    if runtime and Path(runtime).is_dir():
        return Path(runtime) / "ergoqp"
    if (usual := Path(f"/run/user/{os.getuid()}")).is_dir():
        return usual / "ergoqp"
    return Path(tempfile.gettempdir()) / f"ergoqp-{os.getuid()}"


def private_folder(path: Path | None = None) -> Path:
    """Return the folder of the sockets, made if needed, which nobody but the user can enter.

    Raises:
        InputError: if it cannot be made, belongs to somebody else, or others can enter it.
    """
    folder = default_folder() if path is None else path
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.lstat()
    except OSError as error:
        raise InputError(
            f"--dir: cannot make {str(folder)!r}: {error.strerror}; give a folder of yours"
        ) from None
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o077:
        raise InputError(
            f"--dir: got {str(folder)!r}, allowed a folder of this user that nobody else can enter"
            " (mode 0700)"
        )
    return folder


def socket_path(folder: Path, name: str, door: str = "sock") -> Path:
    """Return the path of a door of a loop.

    Raises:
        InputError: if it is too long for a socket.
    """
    path = folder / f"{name}.{door}"
    if len(os.fsencode(path)) > LONGEST_PATH:
        raise InputError(
            f"--dir: the path {str(path)!r} is longer than {LONGEST_PATH} bytes; give a shorter"
            " folder"
        )
    return path
