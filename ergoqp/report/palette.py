"""Colours and words of scores. A colour has the same meaning in the 3-D scene, figures and charts.

The five colours run from teal over yellow to dark red. They can be distinguished under
simulated red-green blindness. Every place that uses them also shows the number.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ergoqp.sheets import reba
from ergoqp.sheets.options import sheet_of

COLOURS: Final = ("#1b7c7e", "#9ccf9b", "#f7dc6f", "#dd6b20", "#a3123a")
"""Fill of level 0 to 4, lowest risk first."""

INKS: Final = ("#ffffff", "#10261a", "#2b2300", "#2b1400", "#ffffff")
"""Text colour that is readable on each fill colour."""

UNSCORED: Final = "#c3c9d0"
"""Fill of everything without a score: invalid postures, shoes, hair."""

_SHEET: Final = sheet_of(reba.Method())

SEGMENTS: Final[tuple[str, ...]] = tuple(
    segment.label(side) for segment in _SHEET.segments.values() for side in segment.sides
)
"""The segments that are scored separately, in the order of every table and chart."""

LEVEL_STARTS: Final = _SHEET.level_starts
"""Lowest final score of each action level."""

POINTS: Final = ("1 point", "2 points", "3 points", "4 points", "5 or more")
"""Meaning of the five colours on a segment."""


def level_of_points(points: ArrayLike) -> NDArray[np.int64]:
    """Return the colour level 0 to 4 of segment scores: points above the best; -1 without a score.

    Args:
        points: segment scores, any shape; 0 or less without a score.
    """
    return np.clip(np.asarray(points, dtype=np.int64) - 1, -1, len(COLOURS) - 1)


def colour_of_level(level: int) -> str:
    """Return the fill of a level 0 to 4, or that for no score for -1."""
    return COLOURS[level] if level >= 0 else UNSCORED


def ink_of_level(level: int) -> str:
    """Return the text colour on the fill of a level."""
    return INKS[level] if level >= 0 else "#10161d"


def risk_of_level(level: int) -> str:
    """Return the sheet's word for an action level, ``"not scored"`` for -1."""
    return reba.ACTION_LEVELS[level] if level >= 0 else "not scored"


def risk_of_score(score: int) -> str:
    """Return the sheet's word for the action level of a final score, ``"not scored"`` for 0."""
    return risk_of_level(int(level_of_score(score)))


def level_of_score(final: ArrayLike) -> NDArray[np.int64]:
    """Return the action level 0 to 4 of final scores, -1 for 0 (not scored); same shape."""
    return np.searchsorted(LEVEL_STARTS, np.asarray(final), side="right") - 1


def segment_highest(segment: str) -> int:
    """Return the highest score of a segment on the sheet, with or without its side."""
    return _SHEET.segments[segment.removeprefix("right_").removeprefix("left_")].highest


def segments_at(assessment: reba.Assessment, row: int) -> dict[str, int]:
    """Return the score of each of `SEGMENTS` in one posture of an assessment."""
    return {name: int(assessment.segments[name][row]) for name in SEGMENTS}


def rgb(colour: str) -> tuple[int, int, int]:
    """Return the red, green and blue of ``"#rrggbb"``, 0 to 255."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)
