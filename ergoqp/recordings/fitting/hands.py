"""Hands of a recording told by direction.

Skeletons put their hand and thumb joints at very different distances.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ergoqp.human import Body
from ergoqp.joints import SIDES


def place_hands(centres: Mapping[str, np.ndarray], body: Body) -> dict[str, np.ndarray]:
    """Return the centres with knuckles and thumbs moved to where this body has them.

    They are moved along their own directions.

    From the wrist to the knuckles only the direction is kept; of the thumb only the side of that
    line on which it lies. A thumb without knuckles, or on the wrist itself, says nothing and is
    left out.

    Args:
        centres: centre -> positions (n, 3) [m].
        body: the person who is fitted.
    """
    placed = {
        name: path for name, path in centres.items() if not name.endswith(("_knuckles", "_thumb"))
    }
    for side in SIDES:
        wrist, knuckles, thumb = (
            centres.get(f"{side}_{name}") for name in ("wrist", "knuckles", "thumb")
        )
        if wrist is None or knuckles is None:
            continue
        along, length = _unit(knuckles - wrist)
        if not _tells(length):
            continue
        own_knuckles, own_thumb = (
            body.model.site(f"{side}_{name}").pos - body.model.site(f"{side}_wrist").pos
            for name in ("knuckles", "thumb")
        )
        reach = float(np.linalg.norm(own_knuckles))
        placed[f"{side}_knuckles"] = wrist + reach * along
        if thumb is None:
            continue
        aside, distance = _unit(
            (thumb - wrist) - np.einsum("ni,ni->n", thumb - wrist, along)[:, None] * along
        )
        if _tells(distance):
            own_along = float(own_thumb @ own_knuckles) / reach
            own_aside = float(np.sqrt(own_thumb @ own_thumb - own_along**2))
            placed[f"{side}_thumb"] = wrist + own_along * along + own_aside * aside
    return placed


def _tells(length: np.ndarray) -> bool:
    """Return whether a distance [m] is long enough to have a direction."""
    seen = length[np.isfinite(length)]
    return len(seen) > 0 and float(np.median(seen)) > 0.005


def _unit(vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    length = np.linalg.norm(vectors, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return vectors / length[:, None], length
