"""The regions to keep out of of a fuzzed problem, in numpy: random ones, and who gets into one."""

from __future__ import annotations

from typing import Any

import numpy as np

from ergoqp.limits import Ball, Box, HalfSpace, KeepOut, WorkspaceBox
from ergoqp.problem.problem import Problem
from tools.fuzz.world import Way

Rng = np.random.Generator


def random_regions(rng: Rng, middle: np.ndarray, limits: list[Any]) -> list[KeepOut]:
    """Return regions beside a place (3,), over each other and at the ends of the workspace."""
    box = next((limit for limit in limits if isinstance(limit, WorkspaceBox)), None)
    low, high = (
        (middle - 0.3, middle + 0.3) if box is None else map(np.array, (box.lower, box.upper))
    )
    found = []
    for number in range(int(rng.integers(1, 4))):
        at = rng.uniform(low, high) + rng.choice([0.0, 0.1]) * rng.normal(size=3)
        size = float(10 ** rng.uniform(-2, -0.5))
        normal = rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        if rng.random() < 0.5:
            # Beside the place, so that the object comes to it.
            at = middle - (size + 10 ** rng.uniform(-3, -1.5)) * normal
        elif rng.random() < 0.8:
            axis = int(rng.integers(3))
            at[axis] = (low, high)[int(rng.integers(2))][axis]
        half = size * rng.uniform(0.2, 1.0, 3)
        region = (
            Ball(tuple(at), size),
            Box(tuple(at - half), tuple(at + half)),
            HalfSpace(tuple(normal), float(normal @ at)),
        )[rng.integers(3)]
        found.append(KeepOut(region, name=f"region {number}"))
    return found


class Regions:
    """The regions of a problem as numbers.

    Attributes:
        names: name of each.
    """

    def __init__(self, problem: Problem) -> None:
        """Read the limits."""
        kept = [limit for limit in problem.limits if isinstance(limit, KeepOut)]
        self.names = [limit.name for limit in kept]
        self._regions = [limit.region for limit in kept]

    def depths(self, place: np.ndarray) -> np.ndarray:
        """How deep a place (3,) is in each region (k,) [m]; negative outside."""
        found = []
        for region in self._regions:
            match region:
                case Ball(centre, radius):
                    found.append(radius - np.linalg.norm(place - centre))
                case HalfSpace(normal, offset):
                    found.append(offset - np.dot(normal, place))
                case Box(lower, upper):
                    apart = np.maximum(np.subtract(lower, place), np.subtract(place, upper))
                    found.append(-(np.linalg.norm(apart.clip(0)) or apart.max()))
        return np.array(found)

    def met(self, way: Way, wider: float) -> np.ndarray:
        """Which regions, each so much wider [m], a way goes through (k,)."""
        start = np.stack([pose[:3, 3] for pose, _ in way])
        parts = np.stack([part[:3] for _, part in way])
        found = []
        for region in self._regions:
            match region:
                case Ball(centre, radius):
                    squares = np.maximum((parts**2).sum(axis=1), 1e-30)
                    share = np.clip(((centre - start) * parts).sum(axis=1) / squares, 0, 1)
                    far = np.linalg.norm(start + share[:, None] * parts - centre, axis=1)
                    found.append((far < radius + wider).any())
                case HalfSpace(normal, offset):
                    least = np.minimum(start @ normal, (start + parts) @ normal)
                    found.append((least < offset + wider).any())
                case Box(lower, upper):
                    pace = np.where(np.abs(parts) > 1e-15, parts, 1e-15)
                    ends = (
                        (np.array([lower, upper]) + np.array([[-wider], [wider]]))[:, None] - start
                    ) / pace
                    enter, leave = ends.min(axis=0).max(axis=1), ends.max(axis=0).min(axis=1)
                    found.append((np.maximum(enter, 0) < np.minimum(leave, 1)).any())
        return np.array(found, dtype=bool)
