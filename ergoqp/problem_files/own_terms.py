"""Terms of the user's own in problem files: their tables follow from what they are made with."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import Annotated, Any, get_type_hints

from pydantic import BeforeValidator, create_model

from ergoqp.arguments import shown
from ergoqp.errors import ErgoqpError, InputError
from ergoqp.problem_files.tables import CostTable, FileTable, LimitsTable, ResponseTable, Table
from ergoqp.registry import check_free, own_term, registered

_PARTS = {"cost": CostTable, "limits": LimitsTable, "response": ResponseTable}
_KINDS = {"cost": "cost", "limits": "limit", "response": "response"}


def file_table(raw: Mapping[str, Any]) -> type[FileTable]:
    """Return the table of a file, with the keys of the own terms that it names.

    Only what the file names is imported.

    Args:
        raw: the file's tables.

    Raises:
        InputError: if an own term cannot be imported, does not say what it is made with, or has the
            name of another.
    """
    keys: dict[str, Any] = {}
    for part, table in _PARTS.items():
        given = raw.get(part)
        named, known = set(given) if isinstance(given, Mapping) else set(), set(table.model_fields)
        check_free(_KINDS[part], named & known)
        found = {name: own_term(_KINDS[part], name) for name in (named - known) & own_names(part)}
        if found:
            own: dict[str, Any] = {
                name: (_table_of(name, term) | None, None) for name, term in found.items()
            }
            larger = create_model(table.__name__, __base__=table, **own)
            keys[part] = (larger, FileTable.model_fields[part].default)
    return create_model("FileTable", __base__=FileTable, **keys) if keys else FileTable


def own_names(part: str) -> set[str]:
    """Return the names that installed packages register for a part of a file."""
    return set(registered(_KINDS[part]))


def own_tables(table: Table) -> dict[str, Table]:
    """Return the tables of own terms that a part of a file names: those that no class declares."""
    known = next(kind for kind in _PARTS.values() if isinstance(table, kind)).model_fields
    given = {key: getattr(table, key) for key in type(table).model_fields if key not in known}
    return {key: each for key, each in given.items() if each is not None}


def build_own(part: str, name: str, table: Table) -> Any:
    """Make an own term from the keys that a file says; its own defaults serve for the others.

    Raises:
        InputError: if it does not take them, with what it raised.
    """
    try:
        return own_term(_KINDS[part], name)(**table.model_dump(exclude_unset=True))
    except ErgoqpError:
        raise
    except Exception as error:  # whatever the code of a user's own term does
        words = " ".join(str(error).split())[:100]
        raise InputError(
            f"{part}.{name}: got {type(error).__name__} ({words}), allowed what"
            f" {own_term(_KINDS[part], name)!r:.80} takes"
        ) from None


def _table_of(name: str, term: Any) -> type[Table]:
    """Return a table with the parameters of a term, of the types that it declares."""
    try:
        parameters = inspect.signature(term).parameters
        hints = get_type_hints(term.__init__ if inspect.isclass(term) else term)
    except (TypeError, ValueError, NameError) as error:
        raise InputError(
            f"{name}: got {shown(term)} ({error}), allowed a class or function with typed"
            " parameters"
        ) from None
    keys: dict[str, Any] = {}
    for key, parameter in parameters.items():
        if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
            raise InputError(
                f"{name}: got the parameter {parameter}, allowed only ones that a file can name"
            )
        default = ... if parameter.default is parameter.empty else parameter.default
        held = Annotated[hints.get(key, Any), BeforeValidator(_as_tuple)]
        keys[key] = (held, default)
    return create_model(f"{name} table", __base__=Table, **keys)


def _as_tuple(value: Any) -> Any:
    return tuple(map(_as_tuple, value)) if isinstance(value, list) else value
