"""Checks of the arguments that users give to functions of the package.

Every check raises an error of one sentence if the value has the wrong type or is out of range.
"""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, fields
from functools import cache
from numbers import Integral
from os import PathLike
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, Final, Literal, get_args, get_origin, get_type_hints

import numpy as np
from annotated_types import Ge, GroupedMetadata, Le

from ergoqp.errors import ErgoqpError, InputError

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
        >>> from ergoqp.arguments import perhaps
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


MOST_WHOLE: Final = 2**63 - 1
"""Largest whole number that arrays and seeds accept."""

_FEW: Final = 6
"""Messages show the shape of an array with more entries than this, not its values."""

LARGEST_SEED: Final = 2**32 - 1
"""Largest seed of learning functions, the limit of scikit-learn."""


def shown(value: Any, most: int = 40) -> str:
    """Return a value as text for a message: short, and without ever raising an exception."""
    try:
        if isinstance(value, np.ndarray) and value.size > _FEW:
            return f"an array of {value.dtype} of shape {value.shape}"
        return f"{value!r:.{most}}"
    except Exception:  # an int with thousands of digits, or an object whose repr raises
        return f"a {type(value).__name__} that cannot be shown"


def check_number(
    what: str,
    value: Any,
    low: float,
    high: float,
    unit: str = "",
    error: type[ErgoqpError] = InputError,
) -> None:
    """Check a real number.

    Args:
        what: name of the value, for the message.
        value: the value, of any type.
        low: least allowed value.
        high: greatest allowed value.
        unit: unit, for the message.
        error: type of the error to raise.

    Raises:
        ErgoqpError: `error`, if the value is not a number from `low` to `high`.
    """
    if not (_is_real(value) and low <= value <= high):
        end = f" {unit}" if unit not in ("", "share") else ""
        kind = "" if _is_real(value) else "a number from "
        unlike = "" if kind else perhaps([value], low, high, unit)
        raise error(
            f"{what}: got {shown(value)}{'' if kind else end}, allowed {kind}{low:g} to"
            f" {high:g}{end}{unlike}"
        )


def check_real(what: str, value: Any, unit: str, error: type[ErgoqpError] = InputError) -> None:
    """Check that a value is a real number. The range is checked where its meaning is known.

    Raises:
        ErgoqpError: `error`, if it is not a real number.
    """
    if not _is_real(value):
        raise error(f"{what}: got {shown(value)}, allowed a number of {unit}")


def check_whole(
    what: str, value: Any, least: int, most: int = MOST_WHOLE, error: type[ErgoqpError] = InputError
) -> None:
    """Check a whole number.

    Raises:
        ErgoqpError: `error`, if it is not a whole number from `least` to `most`.
    """
    whole = isinstance(value, Integral) and not isinstance(value, bool)
    if not (whole and least <= int(value) <= most):
        above = whole and int(value) > most
        allowed = (
            f"of at least {least}"
            if most == MOST_WHOLE and not above
            else f"from {least} to {most}"
        )
        raise error(f"{what}: got {shown(value)}, allowed a whole number {allowed}")


def check_word(
    what: str, value: Any, words: Iterable[str], error: type[ErgoqpError] = InputError
) -> None:
    """Check that a value is one of the given words.

    Raises:
        ErgoqpError: `error`, if it is none of them.
    """
    words = tuple(words)
    if not (isinstance(value, str) and value in words):
        raise error(f"{what}: got {shown(value)}, allowed {', '.join(words)}")


def numbers_of(
    what: str, values: Any, low: float, high: float, error: type[ErgoqpError] = InputError
) -> tuple[float, ...]:
    """Return a list of one or more numbers as a tuple.

    Raises:
        ErgoqpError: `error`, if it is not such a list, or a number is not from `low` to
            `high`.
    """
    if (
        isinstance(values, (str, bytes, Mapping))
        or not isinstance(values, Iterable)
        or not (numbers := tuple(values))
    ):
        raise error(
            f"{what}: got {shown(values)}, allowed a list of numbers from {low:g} to {high:g}"
        )
    for number in numbers:
        check_number(what, number, low, high, error=error)
    return tuple(float(number) for number in numbers)


def are_shares(values: Any, count: int) -> bool:
    """Return whether numbers are `count` shares: not negative, and adding up to 1."""
    shares = np.asarray(values, dtype=float)
    whole = shares.shape == (count,) and abs(float(shares.sum()) - 1) <= 1e-9
    return whole and bool((shares >= 0).all())


def unmasked(value: Any) -> np.ndarray:
    """Return an array. Masked entries become NaN, because the value below a mask is unknown."""
    if isinstance(value, np.ma.MaskedArray) and np.ma.getmaskarray(value).any():
        return np.ma.filled(value.astype(float), np.nan)
    return np.asarray(value)


def read_array(
    what: str,
    value: Any,
    shape: tuple[int, ...],
    allowed: str,
    error: type[ErgoqpError] = InputError,
) -> np.ndarray:
    """Return finite numbers as an array of a shape.

    Args:
        what: name of the value, for the message.
        value: the value, of any type.
        shape: required shape.
        allowed: what is allowed, in words.
        error: type of the error to raise.

    Raises:
        ErgoqpError: `error`, if the value is not an array of finite numbers of that shape.
    """
    if type(value) is np.ndarray:  # nothing of a user's runs, so no error is caught
        array = value
    else:
        try:
            array = unmasked(value)
        except Exception:  # not an array
            array = np.array(None)
    found = ""
    if array.shape == shape and array.dtype.kind in "iuf":
        numbers = array.astype(float)
        if np.isfinite(numbers).all():
            return numbers
        if array.size > _FEW:
            found = f"{numbers[~np.isfinite(numbers)][0]:g} among {array.size} numbers"
    raise error(f"{what}: got {found or shown(value)}, allowed {allowed}")


@dataclass(frozen=True)
class Range(GroupedMetadata):
    """What a number of a parameter may be, stated once for the object, the file and the pages.

    Attributes:
        low: least value.
        high: greatest value.
        unit: of the number; empty if it has none.
        usual: least and greatest value beside a person, if there are such; a value outside usually
            has the wrong unit.

    Example:
        >>> from typing import Annotated
        >>> from ergoqp.arguments import Range
        >>> Stature = Annotated[float, Range(1.2, 2.3, "m")]
    """

    low: float = -math.inf
    high: float = math.inf
    unit: str = ""
    usual: tuple[float, float] | None = None

    def __iter__(self) -> Iterator[Any]:
        """Yield the ends as pydantic knows them."""
        if self.low > -math.inf:
            yield Ge(self.low)
        if self.high < math.inf:
            yield Le(self.high)


def check_parameters(
    term: Any, prefix: str = "", error: type[ErgoqpError] = InputError, **otherwise: str
) -> None:
    """Check the fields of a dataclass by their types; a flag becomes a bool.

    Numbers must be in their `Range`, alone or as values of a table, and words among those of their
    ``Literal``. Fields of other types are left to the term.

    Args:
        term: the object.
        prefix: before the name of each field, for the message.
        error: type of the error to raise.
        otherwise: what a field is called in the message, where it is not its name.

    Raises:
        ErgoqpError: `error`, if a value is not allowed.
    """
    for name, hint in _hints(type(term)).items():
        what, value = prefix + otherwise.get(name, name), getattr(term, name)
        if hint is bool:
            object.__setattr__(term, name, flag(what, value, error))
        else:
            _check(what, value, hint, error)


def _check(what: str, value: Any, hint: Any, error: type[ErgoqpError]) -> None:
    kind, parts = get_origin(hint), get_args(hint)
    if kind is Annotated:
        for each in hint.__metadata__:
            if isinstance(each, Range):
                check_number(what, value, each.low, each.high, each.unit, error)
    elif kind is Literal:
        check_word(what, value, parts, error)
    elif NoneType in parts:
        if value is not None:
            _check(what, value, next(each for each in parts if each is not NoneType), error)
    elif kind is Mapping and isinstance(value, Mapping):
        for key, each in value.items():
            _check(f"{what} of {key}", each, parts[1], error)


@cache
def _hints(kind: type) -> dict[str, Any]:
    hints = get_type_hints(kind, include_extras=True)
    return {each.name: hints[each.name] for each in fields(kind)}


def check_kind(
    what: str,
    value: Any,
    kind: type | tuple[type, ...],
    allowed: str,
    error: type[ErgoqpError] = InputError,
) -> None:
    """Check the type of a value.

    Args:
        what: name of the value, for the message.
        value: the value, of any type.
        kind: one or several types.
        allowed: what is allowed, in words.
        error: type of the error to raise.

    Raises:
        ErgoqpError: `error`, if the value has none of these types.
    """
    if not isinstance(value, kind):
        if isinstance(value, type) and issubclass(value, kind):
            allowed = object_of(value)
        raise error(f"{what}: got {shown(value)}, allowed {allowed}")


def of_package(*terms: Any) -> bool:
    """Return whether the classes of all objects come with ergoqp, or with Python itself."""
    return all(type(term).__module__.startswith(("ergoqp.", "builtins")) for term in terms)


def object_of(given: type) -> str:
    """Return what is allowed in place of a class, in words."""
    return f"an object, not the class: {given.__name__}(...)"


def check_has(what: str, value: Any, member: str, allowed: str) -> None:
    """Check that an object has a member.

    Raises:
        InputError: if it has not, or is a class.
    """
    has = hasattr(value, member)
    if not has or isinstance(value, type):
        allowed = object_of(value) if has else allowed
        raise InputError(f"{what}: got {shown(value)}, allowed {allowed}")


def check_text(what: str, value: Any, error: type[ErgoqpError] = InputError) -> None:
    """Check a name.

    Raises:
        ErgoqpError: `error`, if it is not one line of 1 to 250 characters.
    """
    if not (
        isinstance(value, str)
        and 1 <= len(value) <= 250
        and not any(unicodedata.category(c) == "Cc" for c in value)
    ):
        raise error(f"{what}: got {shown(value)}, allowed a text of one line, 1 to 250 characters")


def flag(what: str, value: Any, error: type[ErgoqpError] = InputError) -> bool:
    """Return True or False. NumPy booleans, 0 and 1 are accepted too.

    Raises:
        ErgoqpError: `error`, if the value is none of these.
    """
    if isinstance(value, (bool, np.bool_)) or (
        isinstance(value, (int, np.integer)) and value in (0, 1)
    ):
        return bool(value)
    raise error(f"{what}: got {shown(value)}, allowed True or False")


def names_of(
    what: str, values: Any, allowed: str, error: type[ErgoqpError] = InputError
) -> tuple[str, ...]:
    """Return names from a list, a tuple, an array or any other iterable.

    Raises:
        ErgoqpError: `error`, if one of them is not a string, or there are none.
    """
    try:
        names = () if isinstance(values, (str, bytes, Mapping)) else tuple(values)
    except Exception:  # not an iterable
        names = ()
    if not names or not all(isinstance(name, str) for name in names):
        raise error(f"{what}: got {shown(values)}, allowed {allowed}")
    return tuple(str(name) for name in names)


def path_of(what: str, value: Any, error: type[ErgoqpError] = InputError) -> Path:
    """Return the path of a file or folder.

    Raises:
        ErgoqpError: `error`, if it is not a path.
    """
    if not isinstance(value, (str, PathLike)) or not str(value) or "\0" in str(value):
        raise error(f"{what}: got {shown(value)}, allowed a path")
    return Path(value)


def table_of_numbers(what: str, values: Any, error: type[ErgoqpError] = InputError) -> np.ndarray:
    """Return numbers of any shape as an array of float. Masked entries become NaN.

    Raises:
        ErgoqpError: `error`, if they are strings, complex or no numbers at all.
    """
    try:
        array = unmasked(values)
        if array.dtype.kind in "biuf":
            return array.astype(float)
    except Exception:  # not an array
        pass
    raise error(f"{what}: got {shown(values)}, allowed real numbers")


def check_called(what: str, value: Any, allowed: str) -> None:
    """Check that something can be called, or is None.

    Raises:
        InputError: if it is neither.
    """
    if value is not None and not callable(value):
        raise InputError(f"{what}: got {shown(value)}, allowed {allowed}, or None")


def sentences(what: str, values: Any) -> tuple[str, ...]:
    """Return a list of texts as a tuple.

    Raises:
        InputError: if it is not a list of texts.
    """
    texts = as_tuple(what, values)
    for text in texts:
        check_kind(what, text, str, "a list of texts")
    return texts


def as_tuple(
    what: str, values: Iterable[Any], error: type[ErgoqpError] = InputError
) -> tuple[Any, ...]:
    """Return the entries of an iterable as a tuple. Strings and mappings are not accepted.

    Raises:
        ErgoqpError: `error`, if it is not an iterable, or a string or a mapping.
    """
    try:
        if not isinstance(values, (str, bytes, Mapping)):
            return tuple(values)
    except TypeError:
        pass
    raise error(f"{what}: got {shown(values)}, allowed a list")


def _is_real(value: Any) -> bool:
    """Return whether a value is a Python or NumPy number for float arithmetic."""
    return isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)


Progress = Callable[[float], None]
"""Called with the share that is done, from 0 to 1."""


def unseen(share: float) -> None:
    """Ignore the progress."""


def part_of(progress: Progress, begin: float, end: float) -> Progress:
    """Return the progress callback of a part of the work, between two shares of the whole."""
    return lambda share: progress(begin + (end - begin) * share)
