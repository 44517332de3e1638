"""A reader: a folder ``NAME.poses`` with a table per bone, x, y, z and a unit quaternion in a row.

``take.toml`` in the folder says what such tables do not: ``rate`` [Hz], and in ``order`` the order
of the quaternion's columns, which are called q0, q1, q2 and q3.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.files.read import read_toml
from ergoqp.mocap.recording import JointMotion

_COLUMNS = ("x", "y", "z", "q0", "q1", "q2", "q3")


def read_poses(path: Path) -> JointMotion:
    """Read such a folder; lengths are in the unit of its tables.

    Raises:
        RecordingError: if it is not such a folder.
    """
    told = read_toml(path / "take.toml", "take")
    order, rate = str(told.get("order", "")), told.get("rate", 0)
    if sorted(order) != sorted("xyzw") or not isinstance(rate, int | float) or not rate > 0:
        raise RecordingError(
            f"{path.name}/take.toml: got order {order!r} and rate {rate!r}, allowed an order such"
            ' as "xyzw" and a rate above 0'
        )
    tables = {table.stem: _numbers(path.name, table) for table in sorted(path.glob("*.csv"))}
    if not tables or len({len(each) for each in tables.values()}) != 1:
        raise RecordingError(
            f"{path.name}: got {len(tables)} tables, allowed one per bone, all with as many rows"
        )
    turns = [order.index(letter) + 3 for letter in "xyzw"]
    count = len(next(iter(tables.values())))
    return JointMotion(
        tuple(tables),
        np.stack([each[:, :3] for each in tables.values()], axis=1),
        np.arange(count) / rate,
        turns={name: each[:, turns] for name, each in tables.items()},
    )


def _numbers(folder: str, table: Path) -> np.ndarray:
    """Return the columns of a table in the order of `_COLUMNS` (n, 7)."""
    try:
        head, *lines = table.read_text(encoding="utf-8").splitlines()
        names = head.replace(" ", "").split(",")
        # Single precision is finer than any measurement.
        rows = np.array([[float(word) for word in line.split(",")] for line in lines], np.float32)
        return rows[:, [names.index(name) for name in _COLUMNS]]
    except (OSError, ValueError, IndexError) as error:
        raise RecordingError(
            f"{folder}/{table.name}: got {error}, allowed numbers below the names"
            f" {', '.join(_COLUMNS)}"
        ) from None
