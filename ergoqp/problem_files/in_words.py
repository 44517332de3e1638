"""The types and ranges of a problem file in words, and values as they stand in it."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Final, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from ergoqp.problem_files.keys import keys_of
from ergoqp.units import perhaps

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
    """

    kind: Any
    bounds: Mapping[str, Any]

    @property
    def range(self) -> tuple[float, float]:
        """Least and greatest number."""
        low, high = (self.bounds.get(one, self.bounds.get(other)) for one, other in _ENDS)
        return (-math.inf if low is None else low), (math.inf if high is None else high)

    def range_in_words(self, unit: str) -> str:
        """Return the range of a number, such as "1.2 to 2.3 m"; empty if it has none."""
        low, high = self.range
        end = f" {unit}" if unit and unit != "share" else ""
        if "ge" in self.bounds and "le" in self.bounds:
            return f"{low:g} to {high:g}{end}"
        words = [
            f"{word} {self.bounds[bound]:g}"
            for bound, word in (
                ("gt", "greater than"),
                ("ge", "at least"),
                ("lt", "less than"),
                ("le", "at most"),
            )
            if bound in self.bounds
        ]
        return " and ".join(words) + end if words else ""

    def in_words(self, unit: str) -> str:
        """Return what is allowed: type, range, and number of entries; empty if not known."""
        words = _kind_in_words(self.kind)
        if self.kind in (int, float) and (size := self.range_in_words(unit)):
            both = "ge" in self.bounds and "le" in self.bounds
            return f"{words} {'from ' if both else 'of ' if size.startswith('at') else ''}{size}"
        least, most = (self.bounds.get(f"{end}_length") for end in ("min", "max"))
        if words and (least is not None or most is not None):
            count = f"{least} to {most}" if least and most else f"at {_end(least, most)}"
            entries = "entry" if (most or least) == 1 else "entries"
            words = f"{words} with {count} {entries}"
        return words


_ENDS: Final = (("ge", "gt"), ("le", "lt"))


def _end(least: int | None, most: int | None) -> str:
    return f"most {most}" if most is not None else f"least {least}"


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
        elif get_origin(kind) is dict and isinstance(part, str):
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
    while True:
        for each in metadata:
            for one in each.metadata if isinstance(each, FieldInfo) else [each]:
                names = ("ge", "gt", "le", "lt", "min_length", "max_length")
                bounds |= {name: getattr(one, name) for name in names if hasattr(one, name)}
        metadata = ()
        if get_origin(annotation) is Annotated:
            annotation, *metadata = get_args(annotation)
        elif get_origin(annotation) in (Union, UnionType):
            parts = [each for each in get_args(annotation) if each is not NoneType]
            if len(parts) != 1:
                return Place(annotation, bounds)
            annotation = parts[0]
        else:
            return Place(annotation, bounds)


def _kind_in_words(kind: Any) -> str:
    """Return a type in words; empty for one that has none."""
    if kind in _ONE:
        return _ONE[kind][0]
    if get_origin(kind) is dict or kind is dict:
        return "a table"
    if isinstance(kind, type) and issubclass(kind, BaseModel):
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


def out_of_range(place: Place, value: Any, unit: str) -> str:
    """Return the range that a number is outside of, and the unit in which it would be inside."""
    return f"{place.range_in_words(unit)}{perhaps([value], *place.range, unit)}"


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
