"""Types of the parameters of users' terms, as files can give them.

Lists stand for tuples and arrays.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Final, Union, get_args, get_origin

import numpy as np
from pydantic import BeforeValidator
from pydantic_core import PydanticCustomError

from ergoqp.problem_files.keys import as_tuple

_CONTAINERS: Final[tuple[Any, ...]] = (list, dict, Sequence, Mapping)


def as_in_files(hint: Any) -> Any:
    """Return a type that accepts what a TOML file can give for a type.

    Args:
        hint: type that the user's code declares.
    """
    kind: Any = get_origin(hint) or hint
    parts = tuple(map(as_in_files, get_args(hint)))
    if kind is np.ndarray:
        return Annotated[Any, BeforeValidator(_as_array)]
    if kind is Path:
        return Annotated[Path, BeforeValidator(_as_path)]
    if kind is tuple:
        return Annotated[tuple[parts] if parts else tuple, BeforeValidator(as_tuple)]
    if kind in (Union, UnionType):
        return Union[parts]  # noqa: UP007  # of types that are known only now
    if kind in _CONTAINERS and parts:
        return kind[parts]
    return hint


def _as_path(value: Any) -> Any:
    return Path(value) if isinstance(value, str) else value


def _as_array(value: Any) -> np.ndarray:
    with contextlib.suppress(ValueError):  # lists of several lengths
        array = np.array(value)
        if array.ndim and array.dtype.kind in "iuf":
            return array.astype(float)
    raise PydanticCustomError("array", "Input should be an array of numbers")
