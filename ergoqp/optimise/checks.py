"""The judgement of plain numbers that users give to searches."""

from __future__ import annotations

from collections.abc import Iterable
from numbers import Integral, Real
from typing import Any, Final

from ergoqp.errors import InputError

MOST_WHOLE: Final = 2**63 - 1
"""Largest whole number that arrays and seeds take."""


def check_whole(name: str, value: Any, least: int, most: int = MOST_WHOLE) -> None:
    """Check a whole number.

    Raises:
        InputError: if it is none, or is not from `least` to `most`.
    """
    if isinstance(value, bool) or not (isinstance(value, Integral) and least <= int(value) <= most):
        allowed = f"of at least {least}" if most == MOST_WHOLE else f"from {least} to {most}"
        raise InputError(f"{name}: got {value!r}, allowed a whole number {allowed}")


def check_number(name: str, value: Any, unit: str) -> None:
    """Check that something is a real number; its range is judged where its meaning is known.

    Raises:
        InputError: if it is none.
    """
    if isinstance(value, bool) or not isinstance(value, Real):
        raise InputError(f"{name}: got {value!r}, allowed a number of {unit}")


def as_tuple(name: str, values: Iterable[Any]) -> tuple[Any, ...]:
    """Return the entries of anything that can be gone through.

    Raises:
        InputError: if it cannot.
    """
    try:
        return tuple(values)
    except TypeError:
        raise InputError(f"{name}: got a {type(values).__name__}, allowed a list") from None
