"""Functions of vectors over time (n, 3), with NaN where they are not seen."""

from __future__ import annotations

import numpy as np


def inside(origin: np.ndarray, marker: np.ndarray, aside: np.ndarray, by: float) -> np.ndarray:
    """Return the joint below a marker (n, 3), perpendicular to the bone from `origin` to it.

    Args:
        origin: start of the bone (n, 3).
        marker: marker on the outside of the joint (n, 3).
        aside: outward direction (n, 3).
        by: distance of the joint inside the marker.
    """
    whole = marker - origin
    length = np.linalg.norm(whole, axis=1, keepdims=True)
    along = whole / np.where(length > 0, length, np.nan)
    aside = unit(across(aside, along))
    sine = np.where(length > by, by / np.where(length > 0, length, 1), np.nan)
    cosine = np.sqrt(1 - sine**2)
    return origin + length * cosine * (cosine * along - sine * aside)


def either(*choices: np.ndarray) -> np.ndarray:
    """Return the first of several vectors that is seen, in each frame (n, 3)."""
    found = choices[-1]
    for choice in reversed(choices[:-1]):
        found = np.where(np.isfinite(choice).all(axis=1, keepdims=True), choice, found)
    return found


def across(vectors: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Return the components of vectors perpendicular to unit axes (n, 3)."""
    return vectors - dot(vectors, axes) * axes


def dot(vectors: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Return the components of vectors along unit axes (n, 1)."""
    return (vectors * axes).sum(axis=1, keepdims=True)


def unit(vectors: np.ndarray) -> np.ndarray:
    """Return vectors of length one (n, 3); NaN for those without a direction."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(length > 0, length, np.nan)
