"""Labelled postures from a user's table: a CSV file with joint names as columns, and the score."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Final

import numpy as np

from ergoqp.coordinates import FOREARM
from ergoqp.datasets.data import DataSet
from ergoqp.errors import ModelError
from ergoqp.joints import INDEX, JOINTS

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
        >>> from ergoqp.datasets.table import read_data
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
        raise ModelError(
            f"{path.name}: cannot be read: {error.strerror}, allowed a CSV file"
        ) from None
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
    numbers = np.array(
        [_numbers(path, i, row, len(header)) for i, row in enumerate(rows[1:], start=2)]
    )
    at = header.index(SCORE)
    points = np.delete(numbers, at, axis=1) * np.array([scale for _, scale in columns])
    beyond = (
        np.flatnonzero((np.abs(points) > np.pi).any(axis=1))
        if columns[0][0] in INDEX
        else np.array([])
    )
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
    try:
        return [float(entry) for entry in row]
    except ValueError:
        wrong = next(entry for entry in row if not _is_number(entry))
        raise ModelError(f"{path.name}: line {line} holds {wrong!r}, allowed numbers") from None


def _is_number(entry: str) -> bool:
    try:
        float(entry)
    except ValueError:
        return False
    return True
