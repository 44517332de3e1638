"""Quaternions of bodies: the order of their numbers, and which are not of length 1."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np

from ergoqp.recordings.formats.opening import some
from ergoqp.recordings.formats.poses import unit_turns

_LOOKED_AT: Final = 500
"""Frames from which the order of quaternions is found, about."""
_USUAL: Final = "x, y, z, w"
_SURELY: Final = 0.8
"""With the right order, neighbours move by less than this share of what they do with the wrong."""
_STILL: Final = 1e-3
"""Movement below this share of the distance between bodies is no evidence."""


def order_of(
    places: dict[str, np.ndarray], turns: dict[str, np.ndarray]
) -> tuple[tuple[int, ...], str]:
    """Return the columns of x, y, z and w, and a sentence about how they were found.

    With the right order, a neighbour's place in a bone's axes is fixed.

    Args:
        places: name of a body -> positions (n, 3).
        turns: name of a body whose order is unknown -> its quaternions (n, 4).
    """
    orders = {"x, y, z, w": (0, 1, 2, 3), "w, x, y, z": (1, 2, 3, 0)}
    if len(places) < 2:
        return orders[_USUAL], (
            f"The quaternions are taken as {_USUAL}, because one body does not show their order."
        )
    every = max(1, len(next(iter(places.values()))) // _LOOKED_AT)
    near = {name: place[::every].astype(float) for name, place in places.items()}
    offsets = {name: _offsets(near, name) for name in turns}
    spread = {}
    for words, order in orders.items():
        least = []
        for name, turn in turns.items():
            bone = unit_turns(turn[::every][:, order].astype(float))
            least.append(min((_wanders(bone, each) for each in offsets[name]), default=np.inf))
        known = [each for each in least if each < np.inf]
        spread[words] = float(np.median(known)) if known else 0.0
    best = min(spread, key=lambda words: spread[words])
    most = max(spread.values())
    if spread[best] >= _SURELY * most or most < _STILL * _size(offsets.values()):
        return orders[_USUAL], (
            f"The quaternions are taken as {_USUAL}, because the movement does not show their"
            " order: with either order, a bone's neighbour moves in its axes by about"
            f" {1000 * spread[_USUAL]:.0f} mm (if the file's unit is a metre)."
        )
    return orders[best], (
        f"The quaternions are taken as {best}: a bone's neighbour then moves in its axes by"
        f" {1000 * spread[best]:.0f} mm, and with the other order by"
        f" {1000 * most:.0f} mm (if the file's unit is a metre)."
    )


def _wanders(turns: np.ndarray, offsets: np.ndarray) -> float:
    """Return how much a point moves in the axes of a body; infinite if it is not seen."""
    from scipy.spatial.transform import Rotation

    seen = np.isfinite(turns).all(axis=1) & np.isfinite(offsets).all(axis=1)
    if np.count_nonzero(seen) < 2:
        return np.inf
    fixed = Rotation.from_quat(turns[seen]).inv().apply(offsets[seen])
    return float(np.std(fixed, axis=0).max())


def _offsets(places: Mapping[str, np.ndarray], name: str) -> list[np.ndarray]:
    """Return the vectors from one body to each other (n, 3), without bodies at the same place."""
    found = [each - places[name] for other, each in places.items() if other != name]
    return [each for each in found if np.isfinite(each).any() and np.nanmax(np.abs(each)) > 0]


def _size(offsets: Iterable[list[np.ndarray]]) -> float:
    """Return the median distance of a body from its nearest neighbour."""
    nearest = [
        min(float(np.nanmedian(np.linalg.norm(each, axis=1))) for each in others)
        for others in offsets
        if others
    ]
    return float(np.median(nearest)) if nearest else 0.0


def lengths_said(turns: Mapping[str, np.ndarray]) -> list[str]:
    """Return a sentence with the bodies whose quaternions (n, 4) are not of length 1."""
    found = []
    for name, each in turns.items():
        told = np.isfinite(each).all(axis=1) & each.any(axis=1)
        lost = told & ~np.isfinite(unit_turns(each)).all(axis=1)
        if lost.any():
            length = float(np.median(np.linalg.norm(each[lost].astype(float), axis=1)))
            count = np.count_nonzero(lost)
            found.append(f"{name} ({count} of {len(each)}, {length:.3g} in the median)")
    if not found:
        return []
    return [f"Quaternions whose length is not 1 are not read: of {some(found, 30)}."]
