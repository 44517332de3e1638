"""What a thing is made of, as plain values: for keys of what was computed from it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np


def content_of(value: Any) -> Any:
    """Return numbers, texts and lists that are the same for what is made of the same.

    A dataclass is its name and its fields, however deep; an object that is none is known by the
    name of its class alone.
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
