"""Whether the workspace has a place where a person can hold the object.

Only what nobody could use is refused: every place is in a region to keep out of, or out of reach of
even the tallest.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from itertools import product
from typing import Any, Final

import numpy as np

from ergoqp.human.body import FRACTIONS
from ergoqp.limits import Ball, Box, HalfSpace, KeepOut, WorkspaceBox
from ergoqp.responses import IkResponse

PLACES: Final = 40
"""Number of places that are tried for a start."""

_TALLEST: Final = 2.1
"""Stature of the tallest person who might stand there [m]."""

_STEP: Final = 0.4
"""How far the hips may be from above the origin, where the model person stands or sits [m].

People who step after the object were seen to reach 0.1 m less far than this, see
`ergoqp.lab.people.kinds`.
"""

_MOST_CELLS: Final = 4096
"""A workspace that is left in more parts than this counts as one with room."""

_CORNERS: Final = np.array(list(product((0, 1), repeat=3)), dtype=bool)

Depth = Callable[[np.ndarray], np.ndarray]
"""How deep points (n, 3) are in a region (n,) [m]; negative outside."""


def no_start(notes: Sequence[str]) -> str:
    """Return why none of some places can be a start, from a note on each."""
    words = ", ".join(f"{count} {note}" for note, count in sorted(Counter(notes).items()))
    return (
        f"none of {len(notes)} places of the workspace can be a start ({words}); enlarge the"
        " workspace or loosen the limits"
    )


def no_room(limits: Sequence[Any], response: Any) -> str:
    """Return why no place of the workspace can be used, or an empty text if one may be.

    The workspace is halved until a part of it has a free place in its middle, or every part is in
    one region or out of reach. Both are exact: regions are convex, and reach is judged by the
    nearest point of a part. Regions of users are not judged.

    Args:
        limits: limits of a problem.
        response: its response. Only an `IkResponse` says how far the person reaches.
    """
    box = next((limit for limit in limits if isinstance(limit, WorkspaceBox)), None)
    if box is None:
        return ""
    regions = {
        limit.name: depth
        for limit in limits
        if isinstance(limit, KeepOut) and (depth := _depth_of(limit.region)) is not None
    }
    hips, arm = _reach_of(response)
    lower, upper = _parts(box, [limit.region for limit in limits if isinstance(limit, KeepOut)])
    while len(lower) <= _MOST_CELLS:
        middle = (lower + upper) / 2
        free = _apart(middle, middle, hips) <= arm
        left = _apart(lower, upper, hips) <= arm
        for depth in regions.values():
            corners = np.where(_CORNERS, upper[:, None], lower[:, None])
            free &= depth(middle) < 0
            left &= (depth(corners.reshape(-1, 3)).reshape(-1, 8) < 0).any(axis=1)
        if free.any():
            return ""
        if not left.any():
            break
        lower, upper = _halved(lower[left], upper[left])
    else:
        return ""
    places = np.random.default_rng(0).uniform(box.lower, box.upper, (PLACES, 3))
    notes = np.full(PLACES, "out of reach", dtype=object)
    for name, depth in regions.items():
        notes[(_apart(places, places, hips) <= arm) & (depth(places) >= 0)] = f"in {name}"
    return no_start(notes.tolist())


def _depth_of(region: Any) -> Depth | None:
    """Return the depth in a region of the package, None for one of a user."""
    match region if type(region) in (HalfSpace, Ball, Box) else None:
        case HalfSpace(normal, offset):
            return lambda points: offset - points @ np.array(normal)
        case Ball(centre, radius):
            return lambda points: radius - np.linalg.norm(points - centre, axis=1)
        case Box(lower, upper):
            return lambda points: np.minimum(points - lower, upper - points).min(axis=1)
    return None


def _reach_of(response: Any) -> tuple[float, float]:
    """Return the height of the column in which the hips are, and the reach from there [m].

    Trunk and arm are taken stretched in any direction, which no person can do. They are those of
    the tallest person, or of the model if it is larger still.
    """
    if not isinstance(response, IkResponse):
        return 0.0, np.inf
    most = {
        name: max(share * _TALLEST, response.body.lengths[name])
        for name, share in FRACTIONS.items()
    }
    shoulder = float(np.hypot(most["shoulder_height"], most["shoulder_width"] / 2))
    arm = most["upper_arm"] + most["forearm"] + most["hand"]
    return most["thigh"] + most["shank"] + most["foot_height"], shoulder + arm + _STEP


def _apart(lower: np.ndarray, upper: np.ndarray, hips: float) -> np.ndarray:
    """Return the distance of boxes (n, 3) from the column of the hips (n,) [m]."""
    column = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, hips]])
    return np.linalg.norm(np.maximum(np.maximum(lower - column[1], column[0] - upper), 0), axis=1)


def _parts(box: WorkspaceBox, regions: Sequence[Any]) -> tuple[np.ndarray, np.ndarray]:
    """Return a workspace cut along the faces of box regions, as corners of parts (n, 3)."""
    ends = []
    for low, high, *cuts in zip(
        box.lower,
        box.upper,
        *(corner for each in regions if type(each) is Box for corner in (each.lower, each.upper)),
        strict=True,
    ):
        ends.append(np.unique([low, high, *(cut for cut in cuts if low < cut < high)]))
    pairs = [(each[:-1], each[1:]) if len(each) > 1 else (each, each) for each in ends]
    lower, upper = (
        np.stack(np.meshgrid(*(pair[side] for pair in pairs), indexing="ij"), axis=-1)
        for side in (0, 1)
    )
    return lower.reshape(-1, 3), upper.reshape(-1, 3)


def _halved(lower: np.ndarray, upper: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the eight parts of each box (n, 3), halved along every axis."""
    middle = ((lower + upper) / 2)[:, None]
    below, above = lower[:, None], upper[:, None]
    return (
        np.where(_CORNERS, middle, below).reshape(-1, 3),
        np.where(_CORNERS, above, middle).reshape(-1, 3),
    )
