"""Where the data folders are: inside the package (a wheel), else beside it (a checkout or an editable install)."""

from __future__ import annotations

from pathlib import Path

from ergoqp.errors import ErgoqpError

_PACKAGE = Path(__file__).resolve().parent


def data_folder(name: str) -> Path:
    """Return the folder ``models`` or ``problems`` that came with this installation.

    Args:
        name: ``"models"`` or ``"problems"``.

    Raises:
        ErgoqpError: if neither place holds it, which means a broken installation.
    """
    for parent in (_PACKAGE, _PACKAGE.parent):
        folder = parent / name
        if folder.is_dir():
            return folder
    raise ErgoqpError(f"the data folder {name!r} is missing from this installation of ergoqp; reinstall the package")
