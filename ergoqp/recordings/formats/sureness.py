"""How surely each place of a table is seen, and which are taken as not seen by that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from ergoqp.recordings.formats.rows import Gathered

_LEVELS: Final = 3.0
"""The highest of few levels (Kinect has 0 to 3): only zero says that nothing is seen."""
_STEP: Final = 0.25
"""What is a multiple of it is such a level: the Azure Kinect's ROS driver writes 0.25 for low, and
that is of a joint that is in view."""
_HUNDRED: Final = 100.0
_LEAST: Final = 0.3
"""Share of the whole scale below which a place is a guess."""


@dataclass(frozen=True)
class Sure:
    """A column that says how surely a point is seen.

    Attributes:
        column: which.
        point: number of the point.
        head: how such columns are called; those that are called alike have one scale.
    """

    column: int
    point: int
    head: str


class Doubts:
    """What some columns say, gathered block by block."""

    def __init__(self, columns: Sequence[Sure]) -> None:
        """Begin without any row of these columns."""
        self._columns = columns
        self._values = Gathered()
        self._most = dict.fromkeys([each.head for each in columns], 0.0)
        self._levels = dict.fromkeys(self._most, True)

    def add(self, values: np.ndarray, share: float) -> None:
        """Add rows (n, columns), with the share of the file that is read with them."""
        for i, each in enumerate(self._columns):
            known = values[:, i][np.isfinite(values[:, i])]
            self._most[each.head] = max(self._most[each.head], float(known.max(initial=0.0)))
            steps = known / _STEP
            self._levels[each.head] &= bool((steps == np.rint(steps)).all())
        # Half the bits suffice for a scale, and one beyond a hundred has no threshold.
        self._values.add(np.clip(values, -1, 2 * _HUNDRED).astype(np.float16), share)

    def blank(self, positions: np.ndarray) -> list[str]:
        """Take the unsure ones of places (n, m, 3) as not seen, in place, and say how many."""
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
            f" {f'below {least:g}' if (least := self._threshold(head)) else '0'} or not told."
            for head, count in lost.items()
            if count
        ]

    def _threshold(self, head: str) -> float:
        """Return the least value of what is seen; 0 if all above it is."""
        if self._most[head] <= _LEVELS:
            return 0.0 if self._levels[head] else _LEAST
        return _LEAST * _HUNDRED if self._most[head] <= _HUNDRED else 0.0
