"""Independent random generators for the properties of a person."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np


def generators(kind: str, problem: str, seed: int) -> Iterator[np.random.Generator]:
    """Yield the generators for body, habits and senses of a person.

    With another body the other properties stay the same. Every kind has its own people.

    Args:
        kind: kind of the person.
        problem: name of the problem.
        seed: seed of the person.
    """
    said = [seed, *kind.encode(), 0, *problem.encode()]
    return (np.random.default_rng([*said, part]) for part in range(3))
