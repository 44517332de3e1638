"""Markers that move as one: their shape, and how it is turned and placed in each frame.

The turn that brings a shape the nearest to points in the least squares is Kabsch's (1976). Of four
markers and more, one that does not fit is left out: it is another's, or fell off.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

_SAMPLE: Final = 2000
"""Frames by which a shape is found."""
_ROUNDS: Final = 5
_FLAT: Final = 0.01
"""A shape that is nowhere wider across its length is a line, and turns about it [m]."""
_ASTRAY: Final = 0.03
"""What misses a shape by more is another marker, if those without it fit [m]."""


@dataclass(frozen=True, eq=False)
class Followed:
    """A rigid shape in each frame.

    Attributes:
        turn: its axes in the world (n, 3, 3); NaN where fewer than three points are seen.
        place: its origin in the world (n, 3) [m].
        points: where its points are by that (n, m, 3) [m].
        astray: points that were seen elsewhere (n, m) bool.
    """

    turn: np.ndarray
    place: np.ndarray
    points: np.ndarray
    astray: np.ndarray


def shape_of(points: np.ndarray) -> np.ndarray | None:
    """Return the shape (m, 3) that points (n, m, 3) keep, about their middle; None if none.

    It is the median over frames in which they are brought to one another.
    """
    seen = _seen(points)
    whole = np.flatnonzero(seen.sum(axis=1) == seen.sum(axis=1).max(initial=0))
    if not len(whole) or seen[whole[0]].sum() < 3:
        return None
    sample = points[:: max(1, len(points) // _SAMPLE)].astype(float)
    first = points[whole[len(whole) // 2]].astype(float)
    shape = first - np.nanmean(first, axis=0)
    for _ in range(_ROUNDS):
        turn, place = _brought(sample, shape, _seen(sample))
        back = np.einsum("nji,nmj->nmi", turn, sample - place[:, None])
        some = np.isfinite(back).any(axis=(0, 2))
        found = np.full_like(shape, np.nan)
        found[some] = np.nanmedian(back[:, some], axis=0)
        shape = np.where(np.isfinite(found), found, shape)
    return shape - np.nanmean(shape, axis=0)


def follow(points: np.ndarray, shape: np.ndarray) -> Followed:
    """Return where a shape is.

    Args:
        points: what is seen (n, m, 3) [m]; NaN where not.
        shape: its points (m, 3) [m]; NaN for one that is not known.
    """
    points = points.astype(float)
    known = np.isfinite(shape).all(axis=1)
    seen = _seen(points) & known
    size = np.linalg.svd(shape[known] - shape[known].mean(axis=0), compute_uv=False)
    if known.sum() < 3 or size[1] < _FLAT:
        lost = np.full_like(points, np.nan)
        nowhere = np.full((len(points), 3, 3), np.nan)
        return Followed(nowhere, lost[:, 0], lost, np.zeros_like(seen))
    turn, place = _brought(points, shape, seen)
    there = place[:, None] + np.einsum("nij,mj->nmi", turn, np.nan_to_num(shape))
    miss = np.where(seen, np.linalg.norm(points - there, axis=2), 0.0)
    astray = np.zeros_like(seen)
    bad = np.flatnonzero((miss.max(axis=1) > _ASTRAY / 2) & (seen.sum(axis=1) >= 4))
    if len(bad):
        astray[bad] = _astray(points[bad], shape, seen[bad])
        again = bad[astray[bad].any(axis=1)]
        if len(again):
            turn[again], place[again] = _brought(points[again], shape, seen[again] & ~astray[again])
    there = place[:, None] + np.einsum("nij,mj->nmi", turn, np.nan_to_num(shape))
    there[:, ~known] = np.nan
    return Followed(turn, place, there, astray)


def _seen(points: np.ndarray) -> np.ndarray:
    """Return which points (n, m, 3) are seen (n, m) bool."""
    return np.asarray(np.isfinite(points).all(axis=2))


def _astray(points: np.ndarray, shape: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Return the point of each frame without which the others fit (n, m) bool, where they do."""
    count = points.shape[1]
    left = np.full(points.shape[:2], np.inf)
    miss = np.zeros(points.shape[:2])
    for i in range(count):
        without = seen.copy()
        without[:, i] = False
        turn, place = _brought(points, shape, without)
        there = place[:, None] + np.einsum("nij,mj->nmi", turn, np.nan_to_num(shape))
        away = np.linalg.norm(points - there, axis=2)
        left[:, i] = np.where(
            seen[:, i] & (without.sum(axis=1) >= 3),
            np.sqrt(np.where(without, away**2, 0).sum(axis=1) / without.sum(axis=1).clip(1)),
            np.inf,
        )
        miss[:, i] = away[:, i]
    best = np.argmin(left, axis=1)
    rows = np.arange(len(points))
    found = np.zeros_like(seen)
    found[rows, best] = (left[rows, best] < _ASTRAY / 2) & (miss[rows, best] > _ASTRAY)
    return found


def _brought(
    points: np.ndarray, shape: np.ndarray, seen: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return turns (n, 3, 3) and places (n, 3) that bring a shape to points; NaN for too few."""
    weight = (seen & np.isfinite(shape).all(axis=1)).astype(float)
    total = weight.sum(axis=1)
    enough = total >= 3
    share = weight / np.where(total > 0, total, 1)[:, None]
    here, own = np.where(weight[:, :, None] > 0, points, 0.0), np.nan_to_num(shape)
    middle = np.einsum("nm,nmi->ni", share, here)
    centre = share @ own
    across = np.einsum(
        "nm,nmi,nmj->nij",
        weight,
        here - middle[:, None],
        own[None] - centre[:, None],
        optimize=True,
    )
    left, _, right = np.linalg.svd(across)
    flip = np.sign(np.linalg.det(left @ right))
    left[:, :, 2] *= flip[:, None]
    turn = left @ right
    place = middle - np.einsum("nij,nj->ni", turn, centre)
    turn[~enough], place[~enough] = np.nan, np.nan
    return turn, place
