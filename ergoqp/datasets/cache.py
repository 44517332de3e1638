"""Data sets on disk: what takes long is made once, and found again by what was asked for."""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ergoqp.datasets.data import DataSet
from ergoqp.errors import ErgoqpError
from ergoqp.files.npz import read_npz
from ergoqp.files.whole import whole
from ergoqp.paths import cache_folder


def cached_data(kind: str, asked: Mapping[str, Any], make: Callable[[], DataSet]) -> DataSet:
    """Return a data set from the user's cache, or make it and keep it there.

    A file that cannot be read is ignored and written anew; a folder that cannot be written to only
    means no cache.

    Args:
        kind: of data, names the folder below :func:`ergoqp.paths.cache_folder`.
        asked: all that the data depend on, a version of the code that makes them included; what
            JSON and numpy can hold.
        make: makes them.
    """
    text = json.dumps(asked, sort_keys=True, default=lambda value: np.asarray(value).tolist())
    path = cache_folder() / kind / f"{hashlib.sha256(text.encode()).hexdigest()[:32]}.npz"
    try:
        kept = read_npz(path, ("points", "labels", "coordinates", "source"))
        return DataSet(
            kept["points"], kept["labels"], tuple(kept["coordinates"].tolist()), str(kept["source"])
        )
    except (ErgoqpError, ValueError, TypeError):
        data = make()
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole(path) as scratch:
            np.savez(
                scratch,
                points=data.points,
                labels=data.labels,
                coordinates=data.coordinates,
                source=data.source,
            )
    return data
