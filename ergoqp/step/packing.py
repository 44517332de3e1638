"""Several arrays as one vector and back: an interpreter copies a block only once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

Sizes = Mapping[str, tuple[int, int]]
"""Shape of each part, in order."""


def count(sizes: Sizes) -> int:
    """Return the number of entries of all parts."""
    return sum(rows * columns for rows, columns in sizes.values())


def place_in(sizes: Sizes, name: str) -> int:
    """Return where a part begins in the vector of all parts."""
    before = list(sizes)[: list(sizes).index(name)]
    return count({part: sizes[part] for part in before})


def split(sizes: Sizes, vector: Any) -> dict[str, Any]:
    """Return the parts of a vector by name, each in its shape."""
    parts, start = {}, 0
    for name, (rows, columns) in sizes.items():
        part = vector[start : start + rows * columns]
        parts[name] = part if columns == 1 else ca.reshape(part, rows, columns)
        start += rows * columns
    return parts


def joined(sizes: Sizes, parts: Mapping[str, Any]) -> Any:
    """Return the vector of the parts."""
    return ca.vertcat(*(ca.vec(ca.densify(parts[name])) for name in sizes))
