"""Terms of the user's own in problem files: their tables follow from what they are made with."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import Annotated, Any, get_type_hints

from pydantic import BeforeValidator, create_model

from ergoqp.arguments import shown
from ergoqp.errors import ErgoqpError, InputError
from ergoqp.problem_files.tables import CostTable, FileTable, LimitsTable, ResponseTable, Table
from ergoqp.registry import own_term, registered

_PARTS = {"cost": CostTable, "limits": LimitsTable, "response": ResponseTable}
_KINDS = {"cost": "cost", "limits": "limit", "response": "response"}


def file_table(raw: Mapping[str, Any]) -> type[FileTable]:
    """Return the table of a file, with the keys of the own terms that it names.

    Only what the file names is imported.

    Args:
        raw: the file's tables.

    Raises:
        InputError: if an own term cannot be imported, or does not say what it is made with.
    """
    keys: dict[str, Any] = {}
    for part, table in _PARTS.items():
        given = raw.get(part)
        named = set(given) - set(table.model_fields) if isinstance(given, Mapping) else set()
        found = {name: own_term(_KINDS[part], name) for name in named & own_names(part)}
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


def build_own(part: str, name: str, values: Mapping[str, Any]) -> Any:
    """Make an own term from its keys.

    Raises:
        InputError: if it does not take them, with what it raised.
    """
    try:
        return own_term(_KINDS[part], name)(**values)
    except ErgoqpError:
        raise
    except Exception as error:  # whatever the code of a user's own term does
        words = " ".join(str(error).split())[:100]
        raise InputError(f"{part}.{name}: got {type(error).__name__} ({words})") from None


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
        default = ... if parameter.default is parameter.empty else parameter.default
        held = Annotated[hints.get(key, Any), BeforeValidator(_as_tuple)]
        keys[key] = (held, default)
    return create_model(f"{name} table", __base__=Table, **keys)


def _as_tuple(value: Any) -> Any:
    return tuple(map(_as_tuple, value)) if isinstance(value, list) else value
