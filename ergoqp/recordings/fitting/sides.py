"""Check that left and right are named correctly, by the direction in which a body faces.

The left and the right hip (or shoulder) define the forward direction. If toes, nose, knees or hands
show the opposite, the names are exchanged or an axis is mirrored, and the angles of both shoulders
would be wrong.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.joints import SIDES

_FEW: Final = 5
"""Fewer frames than this are no evidence."""
_CLEAR: Final = 0.8
"""Share of frames that have to show the same direction."""
_BENT: Final = np.cos(np.radians(25))
"""Cosine between the bones of a leg above which the knee shows no direction."""
_REACHES: Final = 0.5
"""Least distance of hands in front of or behind the shoulders that counts [length of the trunk]."""


def check_sides(where: str, places: Mapping[str, np.ndarray]) -> str:
    """Raise if the person faces backward; return a sentence if nothing shows the direction.

    The first clear evidence decides: toes, nose, bent knees, hands away from the trunk.

    Args:
        where: the recording's name, for messages.
        places: centre -> positions (n, 3), any unit, along our axes.

    Returns:
        A sentence that states the assumption, or an empty text.

    Raises:
        RecordingError: if left and right are exchanged, or an axis is mirrored.
    """
    ahead = _ahead(places)
    if ahead is None:
        return ""
    for what, ways in _evidence(places, ahead):
        ways = ways[np.isfinite(ways)]
        if len(ways) < _FEW or max((ways > 0).mean(), (ways < 0).mean()) < _CLEAR:
            continue
        if np.median(ways) > 0:
            return ""
        raise RecordingError(
            f"{where}: {what} backward: left and right are exchanged, or an axis is mirrored;"
            " exchange the names (mapping) or reverse the axis"
        )
    return (
        "Left and right are taken as named, because no toe, nose, bent knee or reaching hand shows"
        " which way the person faces."
    )


def _ahead(places: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Return the horizontal forward direction (n, 3); None if it is unknown.

    NaN while the trunk is not upright.
    """
    pair = next((p for p in ("hip", "shoulder") if all(f"{s}_{p}" in places for s in SIDES)), None)
    trunk = _trunk(places)
    if pair is None or trunk is None:
        return None
    left = places[f"left_{pair}"] - places[f"right_{pair}"]
    ahead = np.stack([left[:, 1], -left[:, 0], 0 * left[:, 0]], axis=1).astype(float)
    # A trunk that is level or upside down does not show left and right.
    ahead[~(trunk[:, 2] > 0.5 * np.linalg.norm(trunk, axis=1))] = np.nan
    return ahead / np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-12)


def _trunk(places: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Return the vector from the hips to the top of the trunk (n, 3)."""
    below = _middle(places, "hip", "pelvis")
    above = _middle(places, "shoulder", "neck")
    return None if below is None or above is None else above - below


def _middle(places: Mapping[str, np.ndarray], pair: str, one: str) -> np.ndarray | None:
    sides = [places[f"{side}_{pair}"] for side in SIDES if f"{side}_{pair}" in places]
    return (sides[0] + sides[1]) / 2 if len(sides) == 2 else places.get(one)


def _evidence(
    places: Mapping[str, np.ndarray], ahead: np.ndarray
) -> Iterator[tuple[str, np.ndarray]]:
    """Yield each evidence in words, and how far it points forward in each frame; NaN: unknown."""
    yield "the feet point", np.concatenate([_toes(places, ahead, side) for side in SIDES])
    if "head" in places and "nose" in places:
        yield "the nose points", _along(ahead, places["nose"] - places["head"])
    yield "the knees bend", np.concatenate([_knees(places, ahead, side) for side in SIDES])
    trunk = _trunk(places)
    if trunk is None:
        return
    # Forward here is perpendicular to the trunk, not along the floor, so a tilt does not matter.
    size = np.linalg.norm(trunk, axis=1, keepdims=True)
    left = np.stack([-ahead[:, 1], ahead[:, 0], 0 * ahead[:, 0]], axis=1)
    before = np.cross(left, trunk / np.maximum(size, 1e-12))
    reaches = [_hands(places, before, side, size[:, 0]) for side in SIDES]
    yield "the hands reach", np.concatenate(reaches)


def _toes(places: Mapping[str, np.ndarray], ahead: np.ndarray, side: str) -> np.ndarray:
    knee, ankle, toe = (places.get(f"{side}_{name}") for name in ("knee", "ankle", "toe"))
    if knee is None or ankle is None or toe is None:
        return np.empty(0)
    # A person who kneels has the toes behind.
    shank = knee - ankle
    stands = shank[:, 2] > 0.7 * np.linalg.norm(shank, axis=1)
    return np.where(stands, _along(ahead, toe - ankle), np.nan)


def _knees(places: Mapping[str, np.ndarray], ahead: np.ndarray, side: str) -> np.ndarray:
    hip, knee, ankle = (places.get(f"{side}_{name}") for name in ("hip", "knee", "ankle"))
    if hip is None or knee is None or ankle is None:
        return np.empty(0)
    thigh, shank = knee - hip, ankle - knee
    size = np.linalg.norm(thigh, axis=1) * np.linalg.norm(shank, axis=1)
    bent = (thigh * shank).sum(axis=1) < _BENT * size
    return np.where(bent, _along(ahead, knee - (hip + ankle) / 2), np.nan)


def _hands(
    places: Mapping[str, np.ndarray], before: np.ndarray, side: str, trunk: np.ndarray
) -> np.ndarray:
    shoulder, wrist = places.get(f"{side}_shoulder"), places.get(f"{side}_wrist")
    if shoulder is None or wrist is None:
        return np.empty(0)
    reach = _along(before, wrist - shoulder)
    return np.where(np.abs(reach) > _REACHES * trunk, reach, np.nan)


def _along(ahead: np.ndarray, vector: np.ndarray) -> np.ndarray:
    return (ahead * vector).sum(axis=1)
