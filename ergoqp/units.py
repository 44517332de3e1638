"""Units that a number out of range may be in."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

_OTHERS: Final[dict[str, tuple[tuple[str, float], ...]]] = {
    "m": (("millimetres", 1e-3), ("centimetres", 1e-2)),
    "m/s": (("mm/s", 1e-3), ("cm/s", 1e-2)),
    "m/s^2": (("mm/s^2", 1e-3), ("cm/s^2", 1e-2)),
    "s": (("milliseconds", 1e-3),),
    "kg": (("grams", 1e-3),),
    "deg": (("radians", math.degrees(1)),),
    "deg/s": (("rad/s", math.degrees(1)),),
    "rad": (("degrees", math.radians(1)),),
    "rad/s": (("deg/s", math.radians(1)),),
    "rad/s^2": (("deg/s^2", math.radians(1)),),
    "share": (("per cent", 1e-2),),
}
"""Unit -> units that are mistaken for it, each with its size in that unit."""


def perhaps(values: Iterable[float], low: float, high: float, unit: str) -> str:
    """Return the unit in which numbers would be in range, as " (millimetres?)"; empty if none is.

    Args:
        values: numbers, of which one or more are out of range.
        low: least number in range.
        high: greatest number in range.
        unit: unit of the range.

    Example:
        >>> from ergoqp.units import perhaps
        >>> perhaps([250, -300, 700], -3, 3, "m")
        ' (millimetres?)'
        >>> perhaps([168], 1.2, 2.3, "m")
        ' (centimetres?)'
    """
    numbers = list(values)
    for name, size in _OTHERS.get(unit, ()):
        # Zero is the same in every unit, and says nothing about it.
        if any(numbers) and all(low / size <= each <= high / size for each in numbers):
            return f" ({name}?)"
    return ""
