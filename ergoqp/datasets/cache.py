"""Data sets on disk: what takes long is made once, and found again by what was asked for."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from typing import Any

from ergoqp.datasets.data import DataSet
from ergoqp.errors import ErgoqpError
from ergoqp.files.cache import CacheEntry, digest_of


def cached_data(kind: str, asked: Mapping[str, Any], make: Callable[[], DataSet]) -> DataSet:
    """Return a data set from the user's cache, or make it and keep it there.

    A file that cannot be read is ignored and written anew.

    Args:
        kind: of data, see `CacheEntry`.
        asked: all that the data depend on, a version of the code that makes them included; see
            `digest_of`.
        make: makes them.
    """
    entry = CacheEntry(kind, digest_of(asked))
    kept = entry.read(("points", "labels", "coordinates", "source"))
    if kept is not None:
        with contextlib.suppress(ErgoqpError, ValueError, TypeError):
            return DataSet(
                kept["points"],
                kept["labels"],
                tuple(kept["coordinates"].tolist()),
                str(kept["source"]),
            )
    data = make()
    entry.write(
        points=data.points,
        labels=data.labels,
        coordinates=data.coordinates,
        source=data.source,
    )
    return data
