"""The small TOML files a user writes beside a recording: a person, a naming of joints."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from ergoqp.errors import InputError


def read_toml(path: Path, what: str) -> dict[str, Any]:
    """Read a TOML file.

    Args:
        path: the file.
        what: what it is, for messages.

    Raises:
        InputError: it is missing, not a file, or not TOML.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{what} {str(path)!r} cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"{what} {path.name} is not UTF-8 text; a TOML file is needed") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{what} {path.name} is not TOML: {error}") from None
