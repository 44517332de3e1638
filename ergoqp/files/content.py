"""The contents of objects as plain values, for keys of results that depend on them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np


def content_of(value: Any) -> Any:
    """Return numbers, texts and lists that are equal for objects with equal contents.

    A dataclass becomes its name and its fields, recursively. Any other object becomes the name
    of its class only.
    """
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    if isinstance(value, (np.ndarray, np.generic)):
        return content_of(value.tolist())
    if isinstance(value, Mapping):
        return [[content_of(part) for part in pair] for pair in value.items()]
    if isinstance(value, (list, tuple)):
        return [content_of(part) for part in value]
    kind = value if isinstance(value, type) else type(value)
    name = f"{kind.__module__}.{kind.__qualname__}"
    if not is_dataclass(kind) or value is kind:
        return name
    return [name, [[each.name, content_of(getattr(value, each.name))] for each in fields(value)]]
