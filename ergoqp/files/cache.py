"""Arrays in the user's cache: made once, and found again by everything that they depend on."""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ergoqp.errors import ErgoqpError
from ergoqp.files.atomic import atomic_write
from ergoqp.files.read import read_npz
from ergoqp.registry import cache_folder


def digest_of(content: Any) -> str:
    """Return a short hash of numbers, texts, arrays, and lists and dicts of them."""
    text = json.dumps(content, sort_keys=True, default=lambda value: np.asarray(value).tolist())
    return hashlib.sha256(text.encode()).hexdigest()[:32]


@dataclass(frozen=True)
class CacheEntry:
    """Arrays by name, in one file below :func:`ergoqp.registry.cache_folder`.

    Attributes:
        kind: kind of content; it is the name of the folder.
        key: from `digest_of`. It must include a version of the code that makes the content.
    """

    kind: str
    key: str

    @property
    def path(self) -> Path:
        """Path of the file."""
        return cache_folder() / self.kind / f"{self.key}.npz"

    def read(self, names: Collection[str]) -> dict[str, NDArray] | None:
        """Return the arrays with these names, or None if they are not there or cannot be read."""
        try:
            return read_npz(self.path, names)
        except ErgoqpError:
            return None

    def write(self, **arrays: Any) -> None:
        """Keep the arrays. If the folder cannot be written to, nothing is kept."""
        path = self.path
        with contextlib.suppress(OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
            with atomic_write(path) as scratch:
                np.savez_compressed(scratch, **arrays)
