"""Terms of the user in problem files: their tables follow from their parameters."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import Any, get_type_hints

from pydantic import Field, PydanticUserError, create_model

from ergoqp.arguments import shown
from ergoqp.errors import ErgoqpError, InputError, in_words
from ergoqp.problem.kinds import check_response
from ergoqp.problem_files.full_keys import full_keys
from ergoqp.problem_files.keys import given_tables, keys_of
from ergoqp.problem_files.own_types import as_in_files
from ergoqp.problem_files.tables import CostTable, FileTable, LimitsTable, ResponseTable, Table
from ergoqp.registry import check_free, own_term, registered

_PARTS = {"cost": CostTable, "limits": LimitsTable, "response": ResponseTable}
_KINDS = {"cost": "cost", "limits": "limit", "response": "response"}


def file_table(raw: Mapping[str, Any]) -> type[FileTable]:
    """Return the table of a file, with the keys of the user's terms that it names.

    Only terms that the file names are imported.

    Args:
        raw: tables of the file.

    Raises:
        InputError: if a user's term cannot be imported, does not declare its parameters, or has the
            name of another term.
    """
    parts: dict[str, Any] = {}
    for part, table in _PARTS.items():
        given = raw.get(part)
        named, known = set(given) if isinstance(given, Mapping) else set(), set(table.model_fields)
        check_free(_KINDS[part], named & known)
        found = {name: own_term(_KINDS[part], name) for name in (named - known) & own_names(part)}
        if found:
            own = {name: (_table_of(name, term) | None, None) for name, term in found.items()}
            larger = _with_keys(table.__name__, table, own)
            parts[part] = (larger, FileTable.model_fields[part].default)
    return create_model("FileTable", __base__=FileTable, **parts) if parts else FileTable


def own_names(part: str) -> set[str]:
    """Return the names that installed packages register for a part of a file."""
    return set(registered(_KINDS[part]))


def own_tables(table: Table) -> dict[str, Table]:
    """Return the tables of the user's terms in a part of a file: those that no class declares."""
    known = next(kind for kind in _PARTS.values() if isinstance(table, kind)).model_fields
    return {key: each for key, each in given_tables(table).items() if key not in known}


def build_own(part: str, name: str, table: Table) -> Any:
    """Return a user's term made from the keys of a file. Keys that are missing keep their defaults.

    Raises:
        InputError: if the term does not accept the keys, with the error that it raised.
    """
    said = {
        key: getattr(table, attribute)
        for key, attribute in keys_of(type(table)).items()
        if attribute in table.model_fields_set
    }
    try:
        with full_keys({f"{part}.{name}": said}):
            made = own_term(_KINDS[part], name)(**said)
    except ErgoqpError:
        raise
    except Exception as error:  # any error in the code of a user's term
        raise InputError(
            f"{part}.{name}: got {in_words(error)}, allowed what"
            f" {own_term(_KINDS[part], name)!r:.80} takes"
        ) from None
    if part == "response":
        # Its state decides which limits there are, before `Problem` checks all terms.
        check_response(f"{part}.{name}", made)
    return made


def _table_of(name: str, term: Any) -> type[Table]:
    """Return a table with the parameters of a term and their types."""
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
        keys[key] = (
            as_in_files(hints.get(key, Any)),
            ... if parameter.default is parameter.empty else None,
        )
        try:
            _with_keys(name, Table, {key: keys[key]})
        except PydanticUserError:
            raise InputError(
                f"{name}: got the parameter {parameter!s:.80}, allowed numbers, texts,"
                " lists and arrays of them, and tables"
            ) from None
    return _with_keys(name, Table, keys)


def _with_keys(name: str, base: type[Table], keys: Mapping[str, tuple[Any, Any]]) -> Any:
    """Return a table with more keys, each with its type and default (`...`: required)."""
    fields: dict[str, Any] = {
        f"own_{i}": (kind, Field(default, alias=key))
        for i, (key, (kind, default)) in enumerate(keys.items())
    }
    return create_model(f"{name} table", __base__=base, **fields)
