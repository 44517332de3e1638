"""Full keys in the errors of terms: a term knows its own argument, and not the table it is from."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Final

from ergoqp.errors import ErgoqpError, InputError

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
    within = next((name for name, value in values.items() if key in _of(value)), None)
    if key not in values and within is None:
        return None
    return words.lstrip() if key in values else f"{within}.{words.lstrip()}"


def _of(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}
