"""Data sets in the user's cache: made once, and found again by the arguments that made them."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from typing import Any

from ergoqp.datasets.data import DataSet
from ergoqp.errors import ErgoqpError
from ergoqp.files.cache import CacheEntry, digest_of


def cached_data(kind: str, asked: Mapping[str, Any], make: Callable[[], DataSet]) -> DataSet:
    """Return a data set from the user's cache, or make it and keep it there.

    A file that cannot be read is ignored and replaced.

    Args:
        kind: kind of data, see `CacheEntry`.
        asked: everything that the data depend on, including a version of the code that makes
            them; see `digest_of`.
        make: makes the data.
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
