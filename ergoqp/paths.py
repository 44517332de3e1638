"""Paths of folders: the data that come with the package, and the user's cache."""

from __future__ import annotations

import os
from pathlib import Path

from ergoqp.errors import ErgoqpError

_PACKAGE = Path(__file__).resolve().parent


def data_folder(name: str) -> Path:
    """Return the folder ``models`` or ``problems`` of this installation.

    It is inside the package (a wheel), or else beside it (a checkout or an editable install).

    Args:
        name: ``"models"`` or ``"problems"``.

    Raises:
        ErgoqpError: if it is in neither place. The installation is then broken.
    """
    for parent in (_PACKAGE, _PACKAGE.parent):
        folder = parent / name
        if folder.is_dir():
            return folder
    raise ErgoqpError(
        f"the data folder {name!r} is missing from this installation of ergoqp; reinstall the"
        " package"
    )


def cache_folder() -> Path:
    """Return the user's cache folder for ergoqp: below ``XDG_CACHE_HOME``, else ``~/.cache``."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ergoqp"
