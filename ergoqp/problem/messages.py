"""Mistakes of a problem file in words: key, what was found, what is allowed or unusual."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Final, Literal, Union, get_args, get_origin

import numpy as np
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from ergoqp.arguments import Range, perhaps
from ergoqp.errors import ErgoqpError, InputError


def as_tuple(value: Any) -> Any:
    """Return a list of a file as a tuple."""
    return tuple(value) if isinstance(value, list) else value


def as_list(value: Any) -> Any:
    """Return a single table as a list of one."""
    return [value] if isinstance(value, dict) else value


def keys_of(table: type[BaseModel]) -> dict[str, str]:
    """Return the attribute that holds each key of a table.

    A key of a user's term may have the name of a member of pydantic's tables. Its attribute then
    has another name.
    """
    return {field.alias or name: name for name, field in table.model_fields.items()}


def given_tables(table: BaseModel) -> dict[str, Any]:
    """Return the tables that a file names in a part, by key."""
    found = {key: getattr(table, name) for key, name in keys_of(type(table)).items()}
    return {key: each for key, each in found.items() if each is not None}


_COUNTS: Final = ("no", "one", "two", "three", "four", "five", "six")
_ONE: Final[dict[Any, tuple[str, str]]] = {
    bool: ("true or false", "a list of true and false"),
    int: ("a whole number", "whole numbers"),
    float: ("a number", "numbers"),
    str: ("a text", "texts"),
    Path: ("a path", "paths"),
}
"""Type -> one and several of it."""


@dataclass(frozen=True)
class Place:
    """A value of a file: its type, and its bounds.

    Attributes:
        kind: type of the value.
        bounds: what pydantic checks besides: ``ge``, ``gt``, ``le``, ``lt``, ``min_length``,
            ``max_length``.
        limits: the range of a number, if the parameter states one.
    """

    kind: Any
    bounds: Mapping[str, Any]
    limits: Range | None = None

    @property
    def unit(self) -> str:
        """Unit of a number; empty if it has none or is not known."""
        return self.limits.unit if self.limits else ""

    @property
    def range(self) -> tuple[float, float]:
        """Least and greatest number."""
        low, high = (self.bounds.get(one, self.bounds.get(other)) for one, other in _ENDS)
        return (-math.inf if low is None else low), (math.inf if high is None else high)

    def range_in_words(self) -> str:
        """Return the range of a number, such as "1.2 to 2.3 m"; empty if it has none."""
        low, high = self.range
        unit = f" {self.unit}" if self.unit not in ("", "share") else ""
        if "ge" in self.bounds and "le" in self.bounds:
            return f"{low:g} to {high:g}{unit}"
        words = [
            f"{word} {self.bounds[end]:g}" for end, word in _SAID.items() if end in self.bounds
        ]
        return " and ".join(words) + unit if words else ""

    def in_words(self) -> str:
        """Return what is allowed: type, range, and number of entries; empty if not known."""
        words = _kind_in_words(self.kind)
        if self.kind in (int, float) and (size := self.range_in_words()):
            both = "ge" in self.bounds and "le" in self.bounds
            return f"{words} {'from ' if both else 'of ' if size.startswith('at') else ''}{size}"
        least, most = (self.bounds.get(f"{end}_length") for end in ("min", "max"))
        if words and (least is not None or most is not None):
            end = f"at least {least}" if most is None else f"at most {most}"
            count = f"{least} to {most}" if least and most else end
            entries = "entry" if (most or least) == 1 else "entries"
            words = f"{words} with {count} {entries}"
        return words


_ENDS: Final = (("ge", "gt"), ("le", "lt"))
_SAID: Final = {"gt": "greater than", "ge": "at least", "lt": "less than", "le": "at most"}
_BOUNDS: Final = ("ge", "gt", "le", "lt", "min_length", "max_length")


def place_of(table: type[BaseModel], path: Sequence[int | str]) -> Place | None:
    """Return type and bounds of a value of a file; None if they are not known.

    Args:
        table: table that the file was read as.
        path: keys and, in lists, indices.
    """
    place = Place(table, {})
    for part in path:
        kind, parts = place.kind, get_args(place.kind)
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            name = keys_of(kind).get(str(part))
            if name is None:
                return None
            field = kind.model_fields[name]
            place = _place(field.annotation, field.metadata)
        elif get_origin(kind) in (dict, Mapping) and isinstance(part, str):
            place = _place(parts[1], ())
        elif get_origin(kind) in (list, tuple) and isinstance(part, int):
            fixed = get_origin(kind) is tuple and Ellipsis not in parts
            if fixed and part >= len(parts):
                return None
            place = _place(parts[part if fixed else 0], ())
        else:
            return None
    return place


def _place(annotation: Any, metadata: Sequence[Any]) -> Place:
    """Return a type without `Annotated` and None, and the bounds that stood there."""
    bounds: dict[str, Any] = {}
    limits = None
    while True:
        for each in metadata:
            for one in each.metadata if isinstance(each, FieldInfo) else [each]:
                limits = one if isinstance(one, Range) else limits
                for part in one if isinstance(one, Range) else [one]:
                    found = {name: getattr(part, name, None) for name in _BOUNDS}
                    bounds |= {name: end for name, end in found.items() if end is not None}
        metadata = ()
        if get_origin(annotation) is Annotated:
            annotation, *metadata = get_args(annotation)
        elif get_origin(annotation) in (Union, UnionType):
            parts = [each for each in get_args(annotation) if each is not NoneType]
            if len(parts) != 1:
                return Place(annotation, bounds, limits)
            annotation = parts[0]
        else:
            return Place(annotation, bounds, limits)


def _kind_in_words(kind: Any) -> str:
    """Return a type in words; empty for one that has none."""
    if kind in _ONE:
        return _ONE[kind][0]
    is_table = isinstance(kind, type) and issubclass(kind, BaseModel)
    if is_table or {dict, Mapping} & {kind, get_origin(kind)}:
        return "a table"
    if kind in (list, tuple, Sequence):
        return "a list"
    if get_origin(kind) not in (list, tuple, Sequence):
        return ""
    fixed = get_origin(kind) is tuple and Ellipsis not in get_args(kind)
    entries = [_place(each, ()).kind for each in get_args(kind) if each is not Ellipsis]
    if get_origin(entries[0]) is Literal:
        return f"a list such as {json.dumps(get_args(entries[0])[:2])}"
    if set(entries) == {bool}:
        return f"a list such as {json.dumps([i % 2 == 0 for i in range(len(entries))])}"
    count = f"{_COUNTS[len(entries)]} " if fixed and len(entries) < len(_COUNTS) else ""
    one = entries[0] if len(set(entries)) == 1 else None
    several = _ONE[one][1] if one in _ONE else _several(one)
    return f"a list of {count}{several}"


def _several(kind: Any) -> str:
    words = _kind_in_words(kind)
    return {"a table": "tables"}.get(words, "lists" if words.startswith("a list") else "values")


def as_written(value: Any) -> str:
    """Return a value as a file has it; tables as their keys, and nothing too long."""
    if isinstance(value, Mapping):
        return f"a table with {listing(value)}" if value else "an empty table"
    if isinstance(value, list | tuple):
        if any(isinstance(each, Mapping) for each in value):
            return "a list of tables"
        return f"[{', '.join(map(as_written, value))}]"[:80]
    if isinstance(value, bool):
        return "true" if value else "false"
    return f"{value!r:.80}"


def listing(names: Sequence[str] | Mapping[str, Any]) -> str:
    """Return names as "a, b and c"."""
    *most, last = names
    return f"{', '.join(most)} and {last}" if most else last


def nearest(got: str, allowed: Sequence[str]) -> str | None:
    """Return the allowed name that was probably meant, or None."""
    return next(iter(get_close_matches(got, allowed, 1, 0.6)), None)


def nearest_first(got: str, allowed: Sequence[str], required: bool = False) -> list[str]:
    """Return the allowed names. The one that was probably meant is first and marked.

    Args:
        got: name that is none of them.
        allowed: the allowed names.
        required: whether the one that was probably meant is required.
    """
    near = nearest(got, allowed)
    return [
        *([f"{near} (the nearest{', required' if required else ''})"] if near else []),
        *(each for each in allowed if each != near),
    ]


_ANGLES: Final = ("response.ik.comfort_deg", "limits.joints.ranges_deg")
"""Tables of angles in degrees. Usually at least one angle is larger than pi."""


def unusual(table: type[BaseModel], raw: dict[str, Any], meant: Sequence[str]) -> list[str]:
    """Return a sentence for each number that is unusual beside a person.

    Numbers whose key is in `meant` are left out.

    Args:
        table: table that the file was read as.
        raw: tables of a file without mistakes.
        meant: keys whose unusual values are meant.
    """
    usual = dict(_usual(table))
    known = {*usual, *_ANGLES}
    found = [
        f"unusual: got {key!r}, allowed {', '.join(nearest_first(key, sorted(known)))}"
        for key in meant
        if key not in known
    ]
    for key, (low, high, unit) in usual.items():
        strange = [each for each in _numbers(_value(raw, key)) if not low <= each <= high]
        if strange and key not in meant:
            found.append(
                f"{key}: got {strange[0]:g}, usual are {low:g} to {high:g} {unit}"
                f"{perhaps(strange, low, high, unit)}{_if_meant(key)}"
            )
    for key in _ANGLES:
        angles = list(_numbers(_value(raw, key)))
        if any(angles) and max(map(abs, angles)) <= np.pi and key not in meant:
            found.append(
                f"{key}: got no angle beyond {max(map(abs, angles)):g}, usual are degrees, not"
                f" radians{_if_meant(key)}"
            )
    return found


def _usual(
    table: type[BaseModel], above: str = ""
) -> Iterator[tuple[str, tuple[float, float, str]]]:
    """Yield (key, (least, greatest, unit)) for all numbers that have a usual range."""
    for key, name in keys_of(table).items():
        field = table.model_fields[name]
        for inner in _tables(field.annotation):
            yield from _usual(inner, f"{above}{key}.")
        place = _place(field.annotation, field.metadata)
        for one in (place, *(_place(each, ()) for each in get_args(place.kind))):
            if one.limits is not None and one.limits.usual is not None:
                yield f"{above}{key}", (*one.limits.usual, one.limits.unit)
                break


def _if_meant(key: str) -> str:
    return f'; if it is meant, name it in the first lines: unusual = ["{key}"]'


def _value(raw: Any, key: str) -> Any:
    """Return the value of a key; for an array of tables, a list of values."""
    if isinstance(raw, list):
        return [_value(each, key) for each in raw]
    first, _, rest = key.partition(".")
    value = raw.get(first) if isinstance(raw, dict) else None
    return _value(value, rest) if rest else value


def _numbers(value: Any) -> Iterator[float]:
    """Yield all numbers in tables and lists."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, (list, tuple)):
        for each in value:
            yield from _numbers(each)
    elif value is not None:
        yield float(value)


_RANGES: Final = ("greater_than", "greater_than_equal", "less_than", "less_than_equal")
_LENGTHS: Final = ("too_short", "too_long")
_KINDS: Final = {
    "list_type": "a list",
    "tuple_type": "a list",
    "dict_type": "a table",
    "model_type": "a table",
    "bool_type": "true or false",
    "float_type": "a number",
    "int_type": "a whole number",
    "string_type": "a text",
}
"""Errors of pydantic about a type, and what is allowed if the place has no words of its own."""

_TOLD: Final = {"seated": "the stance under [response.ik] tells whether the person sits"}
"""Keys that users look for, and what tells it."""


def listed(name: str, found: Sequence[str]) -> str:
    """Return the mistakes of a file as one text."""
    head = f"{name}: " if len(found) == 1 else f"{name}: {len(found)} mistakes:\n  "
    return head + "\n  ".join(found)


def mistakes(table: type[BaseModel], error: ValidationError) -> list[str]:
    """Return a sentence for each mistake that was found in a table.

    A required key that is missing because it was misspelled is one mistake, not two.

    Args:
        table: table that the file was read as.
        error: errors of pydantic.
    """
    items: list[dict[str, Any]] = [dict(item) for item in error.errors(include_url=False)]
    missing = {item["loc"] for item in items if item["type"] == "missing"}
    meant = {}
    for item in items:
        if item["type"] == "extra_forbidden":
            *above, last = item["loc"]
            near = (*above, nearest(str(last), _keys(table, above)))
            if near in missing:
                meant[item["loc"]] = near
    found = [
        _sentence(table, item, item["loc"] in meant)
        for item in items
        if item["type"] != "missing" or item["loc"] not in meant.values()
    ]
    # A list that lacks several entries is one mistake.
    return list(dict.fromkeys(found))


def _sentence(table: type[BaseModel], item: dict[str, Any], required: bool) -> str:
    """Return an error of pydantic as a sentence.

    Args:
        table: table that the file was read as.
        item: the error.
        required: whether the key was meant to be one that is required.
    """
    path, kind, message = item["loc"], item["type"], item["msg"]
    if kind == "missing" and isinstance(path[-1], int):
        path, kind = path[:-1], "too_short"
    key = ".".join(map(str, path))
    if kind == "extra_forbidden":
        return f"{key}: got a key that is not known, {_instead(table, path, required)}"
    if kind == "missing":
        return f"{key}: got nothing, required"
    got, place = f"got {as_written(item['input'])}", place_of(table, path)
    if place and kind in _RANGES and (size := place.range_in_words()):
        return f"{key}: {got}, allowed {size}{perhaps([item['input']], *place.range, place.unit)}"
    if kind in _KINDS or kind in _LENGTHS:
        words = place.in_words() if place else ""
        if words or kind in _KINDS:
            return f"{key}: {got}, allowed {words or _KINDS[kind]}"
    if message.startswith("Input should be "):
        return f"{key}: {got}, allowed {message.removeprefix('Input should be ')}"
    if message.startswith("got "):
        return f"{key}: {message}"
    message = message.removeprefix("Value error, ")
    return f"{key}: {message[0].lower()}{message[1:]}, {got}".removeprefix(": ")


def _instead(table: type[BaseModel], path: Sequence[int | str], required: bool) -> str:
    """Return what is allowed in place of a key that is not known."""
    *above, last = path
    key, keys = str(last), _keys(table, above)
    words = f"allowed {', '.join(nearest_first(key, keys, required))}"
    if key in _TOLD:
        return f"{words}; {_TOLD[key]}"
    # A key at the wrong place is named only if it is not a misspelled one of this place.
    places = [] if nearest(key, keys) else list(dict.fromkeys(_places(table, key)))
    if not 1 <= len(places) <= 2:
        return words
    return f"{words}; {key} belongs {' or '.join(places)}"


def _places(table: type[BaseModel], key: str, above: str = "") -> Iterator[str]:
    """Yield the tables that have a key, such as "under [limits.twist]"."""
    for name, attribute in keys_of(table).items():
        if name == key:
            yield f"under [{above}]" if above else "at the top of the file, above all tables"
        inner = f"{above}.{name}" if above else name
        for each in _tables(table.model_fields[attribute].annotation):
            yield from _places(each, key, inner)


def _keys(table: type[BaseModel], path: Sequence[int | str]) -> list[str]:
    """Return the keys of the table at a path."""
    place = place_of(table, path)
    return list(keys_of(place.kind)) if place else []


def _tables(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the tables that a type consists of, as a union or as a list."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for each in get_args(annotation):
        yield from _tables(each)


_ARGUMENT: Final = re.compile(r" ?([A-Za-z_]\w*)(?=:| of )")


@contextmanager
def full_keys(tables: Mapping[str, Mapping[str, Any]], called: str = "") -> Iterator[None]:
    """Name arguments by their keys in the errors that are raised within.

    An error that begins with the name of an argument, or with that of the term, then begins with
    the full key. All other errors stay as they are.

    Args:
        tables: names of tables, such as ``limits.workspace``, and the keys of each with their
            values.
        called: what the term, which is of the first table, is called in its own errors.

    Raises:
        ErgoqpError: an `InputError` in place of an error that names an argument.
    """
    try:
        yield
    except ErgoqpError as error:
        words = str(error)
        whole = _with_key(words, tables, called)
        if whole == words:
            raise
        raise InputError(whole) from None


def _with_key(words: str, tables: Mapping[str, Mapping[str, Any]], called: str) -> str:
    for where, values in tables.items():
        for name in (called, called.replace("_", " ")) if called else ():
            if words.startswith((f"{name}:", f"{name} ")):
                rest = words.removeprefix(name)
                return f"{where}{rest}" if (key := _key(rest, values)) is None else f"{where}.{key}"
        called = ""
        if (key := _key(words, values)) is not None:
            return f"{where}.{key}"
    return words


def _key(words: str, values: Mapping[str, Any]) -> str | None:
    """Return words that begin with a key of a table, or of one within it, with all keys."""
    found = _ARGUMENT.match(words)
    if found is None:
        return None
    key = found[1]
    tables = {name: value for name, value in values.items() if isinstance(value, Mapping)}
    within = next((name for name, table in tables.items() if key in table), None)
    if key not in values and within is None:
        return None
    return words.lstrip() if key in values else f"{within}.{words.lstrip()}"
