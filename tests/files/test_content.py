"""What things are made of, for keys."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ergoqp.files.cache import content_of, digest_of


@dataclass(frozen=True)
class Inner:
    at: Any


@dataclass(frozen=True)
class Outer:
    inner: Inner
    table: dict


def test_a_field_counts_however_deep() -> None:
    made = [
        Outer(Inner((0.1, 2)), {"a": 1}),
        Outer(Inner((0.1, 3)), {"a": 1}),
        Outer(Inner((0.1, 2)), {"b": 1}),
        Outer(Inner(np.array([0.1, 2.5])), {"a": 1}),
        Outer(Inner(Inner([0.1, 2])), {"a": 1}),
        Outer(Inner(None), {}),
        Outer(Inner(object()), {}),
        Outer(Inner(Inner), {}),
    ]
    keys = [digest_of(content_of(each)) for each in made]
    assert len(set(keys)) == len(made)
    assert keys == [digest_of(content_of(each)) for each in made]


def test_the_same_things_are_the_same() -> None:
    one, other = (Outer(Inner(np.float64(0.5)), {"a": object()}) for _ in range(2))
    assert content_of(one) == content_of(other)
