"""The keys of the tables of a problem file, and the types of their numbers."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, Field


def as_tuple(value: Any) -> Any:
    """Return a list of a file as a tuple."""
    return tuple(value) if isinstance(value, list) else value


def as_list(value: Any) -> Any:
    """Return a single table as a list of one."""
    return [value] if isinstance(value, dict) else value


Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Number = Annotated[float, Field(allow_inf_nan=False)]
Vector = Annotated[tuple[Number, Number, Number], BeforeValidator(as_tuple)]


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
