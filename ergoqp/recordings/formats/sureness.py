"""Confidence columns of a table, and the places that are taken as not seen because of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from ergoqp.recordings.formats.rows import Gathered

_LEVELS: Final = 3.0
"""Highest value of a scale of few levels (Kinect has 0 to 3), on which only zero means not seen."""
_STEP: Final = 0.25
"""Levels are multiples of this: the Azure Kinect's ROS driver writes 0.25 for a low confidence,
which is that of a joint in view."""
_HUNDRED: Final = 100.0
_LEAST: Final = 0.3
"""Share of the whole scale below which a place is taken as not seen."""


@dataclass(frozen=True)
class Sure:
    """A confidence column of a point.

    Attributes:
        column: index of the column.
        point: index of the point.
        head: name of such columns; columns with the same name have the same scale.
    """

    column: int
    point: int
    head: str


class Doubts:
    """Values of the confidence columns, gathered block by block."""

    def __init__(self, columns: Sequence[Sure]) -> None:
        """Begin without rows of these columns."""
        self._columns = columns
        self._values = Gathered()
        self._most = dict.fromkeys([each.head for each in columns], 0.0)
        self._levels = dict.fromkeys(self._most, True)

    def add(self, values: np.ndarray, share: float) -> None:
        """Add rows (n, columns); `share` is the share of the file that is read up to them."""
        for i, each in enumerate(self._columns):
            known = values[:, i][np.isfinite(values[:, i])]
            self._most[each.head] = max(self._most[each.head], float(known.max(initial=0.0)))
            steps = known / _STEP
            self._levels[each.head] &= bool((steps == np.rint(steps)).all())
        # Half precision is enough for a scale, and a scale beyond a hundred has no threshold.
        self._values.add(np.clip(values, -1, 2 * _HUNDRED).astype(np.float16), share)

    def blank(self, positions: np.ndarray) -> list[str]:
        """Set unsure positions (n, m, 3) to NaN, in place, and return sentences with the counts."""
        if not self._values:
            return []
        values = self._values.whole
        lost = dict.fromkeys(self._most, 0)
        for i, each in enumerate(self._columns):
            least = self._threshold(each.head)
            sure = values[:, i] >= least if least else values[:, i] > 0
            places = positions[:, each.point]
            lost[each.head] += int((~sure & np.isfinite(places).any(axis=1)).sum())
            places[~sure] = np.nan
        total = positions.shape[0] * positions.shape[1]
        return [
            f"{count} of {total} places are taken as not seen: their {head} is"
            f" {f'below {least:g}' if (least := self._threshold(head)) else '0'} or missing."
            for head, count in lost.items()
            if count
        ]

    def _threshold(self, head: str) -> float:
        """Return the least value of a place that is seen; 0: every value above zero."""
        if self._most[head] <= _LEVELS:
            return 0.0 if self._levels[head] else _LEAST
        return _LEAST * _HUNDRED if self._most[head] <= _HUNDRED else 0.0
