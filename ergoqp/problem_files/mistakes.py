"""Mistakes of a problem file in words: the key, what was found and what is allowed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Final, get_args

from pydantic import BaseModel, ValidationError

from ergoqp.problem_files.in_words import (
    as_written,
    nearest,
    nearest_first,
    out_of_range,
    place_of,
)
from ergoqp.problem_files.keys import keys_of
from ergoqp.problem_files.usual import unit_of

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
    unit = unit_of(".".join(part for part in path if isinstance(part, str)))
    if place and kind in _RANGES and (size := out_of_range(place, item["input"], unit)):
        return f"{key}: {got}, allowed {size}"
    if kind in _KINDS or kind in _LENGTHS:
        words = place.in_words(unit) if place else ""
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
    for part in path:
        if isinstance(part, str):
            table = next(_tables(table.model_fields[keys_of(table)[part]].annotation))
    return list(keys_of(table))


def _tables(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the tables that a type consists of, as a union or as a list."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for each in get_args(annotation):
        yield from _tables(each)
