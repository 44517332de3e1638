"""Task options that joint angles cannot tell: load, shock, coupling, activity, support, stance.

They are explicit inputs. They are checked and never guessed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, TypedDict

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ergoqp.arguments import shown
from ergoqp.errors import InputError
from ergoqp.joints import SIDES
from ergoqp.sheets.description import Sheet

Pair = tuple[NDArray[np.bool_], NDArray[np.bool_]]


class TaskOptions(TypedDict, total=False):
    """The options of a task as keywords, one value for all postures.

    The meanings are those of :func:`ergoqp.sheets.reba.assess`.

    Example:
        >>> from ergoqp.costs.smooth_reba import SmoothReba
        >>> from ergoqp.sheets.task import TaskOptions
        >>> SmoothReba(**TaskOptions(load_kg=12.0, coupling=1)).minimum
        3.0
    """

    load_kg: float
    shock: bool
    coupling: int
    activity: int
    seated: bool
    one_leg: bool
    arm_supported: tuple[bool, bool]
    shoulder_raised: tuple[bool, bool]


DEFAULTS: Final = TaskOptions(
    load_kg=0.0,
    shock=False,
    coupling=0,
    activity=0,
    seated=False,
    one_leg=False,
    arm_supported=(False, False),
    shoulder_raised=(False, False),
)
"""Values of the options that are not given."""


@dataclass(frozen=True, eq=False)
class Task:
    """Options of a task, each a 0-d array or one value per posture, shape (n,).

    Attributes:
        points: points of ``load`` (with shock), ``coupling`` and ``activity``; int8.
        flags: value of each option, or the (right, left) pair for options of one side; bool.
        load_kg: the mass [kg].
        shock: there is a shock or a rapid build-up of force.
    """

    points: dict[str, NDArray[np.int8]]
    flags: dict[str, NDArray[np.bool_] | Pair]
    load_kg: NDArray[np.float64]
    shock: NDArray[np.bool_]

    def flag(self, option: str, side: str = "") -> NDArray[np.bool_]:
        """Return the values of an option, on one side if it has two."""
        value = self.flags[option]
        return value[SIDES.index(side)] if isinstance(value, tuple) else value

    def rows(self, rows: slice | int) -> Task:
        """Return the options of some postures. A value for all postures stays a single value."""

        def cut(value: NDArray) -> NDArray:
            return value if value.ndim == 0 else np.asarray(value[rows])

        return Task(
            {name: cut(value) for name, value in self.points.items()},
            {
                name: (cut(value[0]), cut(value[1])) if isinstance(value, tuple) else cut(value)
                for name, value in self.flags.items()
            },
            cut(self.load_kg),
            cut(self.shock),
        )


def read_task(sheet: Sheet, count: int | None, options: Mapping[str, Any]) -> Task:
    """Check the options of a task.

    Args:
        sheet: gives the allowed points and the load bands.
        count: number of postures n; None if only single values are allowed.
        options: the given options of `TaskOptions`, each one value or one per posture.

    Raises:
        TypeError: if an option does not exist.
        InputError: if a value is not allowed. The message names the option, the value and what
            is allowed.
    """
    if unknown := [name for name in options if name not in DEFAULTS]:
        raise TypeError(f"task: got {shown(unknown[0])}, allowed {', '.join(DEFAULTS)}")
    given = {**DEFAULTS, **options}
    load = _numbers("load_kg", given["load_kg"], count)
    if not (np.isfinite(load) & (load >= 0)).all():
        bad = load[~(np.isfinite(load) & (load >= 0))].flat[0]
        raise InputError(f"load_kg: got {bad:g}, allowed: a finite mass of 0 kg or more")
    shocks = _flags("shock", given["shock"], count)
    points = {
        "load": (sheet.load.score(load) + sheet.shock * shocks).astype(np.int8),
    }
    for name in ("coupling", "activity"):
        points[name] = whole_numbers(name, given[name], 0, sheet.points[name], count)
    flags: dict[str, NDArray[np.bool_] | Pair] = {
        name: _flags(name, given[name], count) for name in ("seated", "one_leg")
    }
    flags |= {
        name: _pair(name, given[name], count) for name in ("arm_supported", "shoulder_raised")
    }
    return Task(points, flags, load, shocks)


def whole_numbers(
    name: str, value: ArrayLike, low: int, high: int, count: int | None
) -> NDArray[np.int8]:
    """Return whole numbers in a range as int8, shape () or (n,).

    Args:
        name: name of the value in messages.
        value: number or numbers.
        low: smallest allowed.
        high: largest allowed.
        count: allowed length n, None for single values only, -1 for any shape.

    Raises:
        InputError: if they are not whole numbers in the range.
    """
    numbers = _numbers(name, value, count)
    wrong = ~((numbers >= low) & (numbers <= high) & (numbers == np.round(numbers)))
    if wrong.any():
        raise InputError(
            f"{name}: got {numbers[wrong].flat[0]:g}, allowed: a whole number from {low} to {high}"
        )
    return numbers.astype(np.int8)


def _numbers(name: str, value: ArrayLike, count: int | None) -> NDArray[np.float64]:
    array = np.asarray(value)
    if array.dtype.kind not in "iuf":
        raise InputError(f"{name}: got {shown(value)}, allowed: a number{_or_row(count)}")
    return _shaped(name, array.astype(float), count)


def _flags(name: str, value: ArrayLike, count: int | None) -> NDArray[np.bool_]:
    array = np.asarray(value)
    numeric = array.dtype.kind in "iuf" and bool(((array == 0) | (array == 1)).all())
    if array.dtype.kind != "b" and not numeric:
        raise InputError(f"{name}: got {shown(value)}, allowed: True or False{_or_row(count)}")
    return _shaped(name, array.astype(bool), count)


def _pair(name: str, value: tuple[ArrayLike, ArrayLike], count: int | None) -> Pair:
    if not isinstance(value, (tuple, list)) or len(value) != 2:
        raise InputError(f"{name}: got {shown(value)}, allowed: a pair (right, left)")
    return _flags(f"{name} (right)", value[0], count), _flags(f"{name} (left)", value[1], count)


def _shaped(name: str, array: NDArray, count: int | None) -> NDArray:
    if array.ndim == 0 or count == -1 or (count is not None and array.shape == (count,)):
        return array
    allowed = (
        "a single value"
        if count is None
        else f"a single value or one per posture, shape ({count},)"
    )
    raise InputError(f"{name}: got shape {array.shape}, allowed: {allowed}")


def _or_row(count: int | None) -> str:
    return "" if count is None else " or one per posture"
