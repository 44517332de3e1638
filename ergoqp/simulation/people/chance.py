"""What is drawn of a person, each thing apart."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np


def generators(kind: str, problem: str, seed: int) -> Iterator[np.random.Generator]:
    """Yield the generators of a person's body, habits and senses.

    Who is given another body keeps the rest, and no kind has the people of another.

    Args:
        kind: of the person.
        problem: name of the problem.
        seed: of the person.
    """
    said = [seed, *kind.encode(), 0, *problem.encode()]
    return (np.random.default_rng([*said, part]) for part in range(3))
