"""Data that learned costs are fitted to: points and labels, from tables or from the cache."""

from __future__ import annotations

import contextlib
import csv
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ergoqp.arguments import names_of, table_of_numbers
from ergoqp.coordinates import FOREARM, Coordinates
from ergoqp.errors import ErgoqpError, ModelError
from ergoqp.files.cache import CacheEntry, digest_of
from ergoqp.joints import INDEX, JOINTS


@dataclass(frozen=True, eq=False)
class DataSet:
    """Labelled points.

    Attributes:
        points: inputs of the model (n, d) [rad or m].
        labels: score of each (n,) [points].
        coordinates: names of the columns, see `ergoqp.coordinates.Coordinates`.
        source: a short description of the data.

    Raises:
        ModelError: if shapes do not fit together, or a value is not finite.

    Example:
        >>> import numpy as np
        >>> from ergoqp.datasets.data import DataSet
        >>> data = DataSet(np.zeros((10, 1)), np.arange(10.0), ("trunk_flexion",), "by hand")
        >>> train, test = data.split(0.8)
        >>> train.points.shape, test.labels.shape
        ((8, 1), (2,))
    """

    points: NDArray[np.float64]
    labels: NDArray[np.float64]
    coordinates: tuple[str, ...]
    source: str = "given"

    def __post_init__(self) -> None:
        """Check that the shapes fit together and that all values are finite.

        Raises:
            ModelError: if not; the message names the row or the shape.
        """
        points = table_of_numbers("points", self.points, ModelError)
        labels = table_of_numbers("labels", self.labels, ModelError)
        names = names_of("coordinates", self.coordinates, "a list of names", ModelError)
        object.__setattr__(self, "coordinates", names)
        width = len(Coordinates(names))
        if points.ndim != 2 or points.shape[1] != width:
            raise ModelError(
                f"data: got points of shape {points.shape}, allowed (n, {width}):"
                f" {', '.join(self.coordinates)}"
            )
        if labels.shape != (len(points),):
            raise ModelError(
                f"data: got labels of shape {labels.shape}, allowed ({len(points)},), one per point"
            )
        bad = np.flatnonzero(~(np.isfinite(points).all(axis=1) & np.isfinite(labels)))
        if bad.size:
            raise ModelError(
                f"data: row {bad[0]} is not finite ({bad.size} such rows), allowed numbers only"
            )
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "labels", labels)

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.labels)

    def part(self, rows: NDArray) -> DataSet:
        """Return the data set of some rows, given as numbers (k,) or as a mask (n,)."""
        return DataSet(self.points[rows], self.labels[rows], self.coordinates, self.source)

    def split(self, share: float = 0.8, seed: int = 0) -> tuple[DataSet, DataSet]:
        """Return two disjoint data sets, drawn at random; the first has this share of the rows."""
        order = np.random.default_rng(seed).permutation(len(self))
        cut = round(share * len(self))
        return self.part(order[:cut]), self.part(order[cut:])

    def require(self, least: int, what: str) -> None:
        """Check that there are enough data to fit a model.

        Args:
            least: least number of points.
            what: what is fitted, for the message.

        Raises:
            ModelError: if there are too few points, or all labels are the same.
        """
        if len(self) < least:
            raise ModelError(f"{what}: got {len(self)} points, allowed at least {least}")
        if np.ptp(self.labels) == 0:
            raise ModelError(
                f"{what}: got the label {self.labels[0]:g} everywhere, allowed at least two"
                " different labels"
            )


SCORE: Final = "score"
"""Name of the column with the labels."""

MOST_POINTS: Final = 15
"""Highest score of the sheet. Other scales must be converted to it before.

All thresholds of a loop are in points.
"""

_DEGREES: Final = "_deg"


def read_data(path: Path | str) -> DataSet:
    """Read a data set from a CSV file: a header, one row per posture, one column ``score``.

    The other columns are joints with their names in `ergoqp.JOINTS` (radians), the same names
    with ``_deg`` at the end (degrees), or the six coordinates of the forearm (metres). Their
    order and number are free.

    Raises:
        ModelError: if a column or line cannot be read; the message names it.

    Example:
        >>> import tempfile
        >>> from pathlib import Path
        >>> from ergoqp.datasets.data import read_data
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = Path(folder) / "own.csv"
        ...     _ = path.write_text(chr(10).join(["trunk_flexion_deg,score", "0,1", "90,4"]))
        ...     data = read_data(path)
        >>> data.points.round(3).tolist(), data.labels.tolist()
        ([[0.0], [1.571]], [1.0, 4.0])
    """
    path = Path(path)
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = [row for row in csv.reader(file) if row]
    except OSError as error:
        raise ModelError(f"{path.name}: cannot be read: {error.strerror}") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise ModelError(f"{path.name}: is not a CSV file ({error})") from None
    if len(rows) < 2:
        found = "a header and no posture" if rows else "nothing"
        raise ModelError(f"{path.name}: got {found}, allowed a header and at least one posture")
    header = [name.strip() for name in rows[0]]
    columns = [_joint(path, name) for name in header if name != SCORE]
    if header.count(SCORE) != 1:
        raise ModelError(
            f"{path.name}: got {header.count(SCORE)} columns named {SCORE!r}, allowed exactly one"
        )
    lines = enumerate(rows[1:], start=2)
    numbers = np.array([_numbers(path, line, row, len(header)) for line, row in lines])
    at = header.index(SCORE)
    points = np.delete(numbers, at, axis=1) * np.array([scale for _, scale in columns])
    of_joints = columns[0][0] in INDEX
    beyond = np.flatnonzero((np.abs(points) > np.pi).any(axis=1) & of_joints)
    if beyond.size:
        line = beyond[0] + 2
        raise ModelError(
            f"{path.name}: line {line} has an angle beyond ±π rad, allowed radians,"
            " or columns that end in '_deg'"
        )
    if (wrong := np.flatnonzero((numbers[:, at] < 0) | (numbers[:, at] > MOST_POINTS))).size:
        line, got = wrong[0] + 2, numbers[wrong[0], at]
        raise ModelError(
            f"{path.name}: line {line} has the score {got:g}, allowed 0 to {MOST_POINTS}, points of"
            " the REBA sheet"
        )
    return DataSet(points, numbers[:, at], tuple(name for name, _ in columns), path.name)


def _joint(path: Path, column: str) -> tuple[str, float]:
    """Return the joint of a column and the factor to its unit."""
    name = column.removesuffix(_DEGREES)
    if name in INDEX:
        return name, np.pi / 180 if column.endswith(_DEGREES) else 1.0
    if column in FOREARM:
        return column, 1.0
    raise ModelError(
        f"{path.name}: got a column {column!r}, allowed joints such as {JOINTS[0]!r} or"
        f" '{JOINTS[0]}_deg', and 'score'"
    )


def _numbers(path: Path, line: int, row: list[str], width: int) -> list[float]:
    if len(row) != width:
        raise ModelError(
            f"{path.name}: line {line} has {len(row)} entries, allowed {width}, as in the header"
        )
    numbers = []
    for entry in row:
        try:
            numbers.append(float(entry))
        except ValueError:
            raise ModelError(f"{path.name}: line {line} holds {entry!r}, allowed numbers") from None
    return numbers


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
            names = tuple(kept["coordinates"].tolist())
            return DataSet(kept["points"], kept["labels"], names, str(kept["source"]))
    data = make()
    entry.write(
        points=data.points, labels=data.labels, coordinates=data.coordinates, source=data.source
    )
    return data
