"""A map of scores over two coordinates of the object's place.

Each cell has a number and the colour of its action level.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ergoqp.placing.slices import Slice
from ergoqp.report import palette
from ergoqp.report.charts import svg
from ergoqp.report.charts.axes import Scale, width_of, words_of
from ergoqp.sheets.reba import ACTION_LEVELS

AXES: Final = (
    ("x, forward, m", 1.0),
    ("y, to the left, m", 1.0),
    ("z, height, m", 1.0),
    ("tilt up, deg", -180 / np.pi),
    ("turn to the left, deg", 180 / np.pi),
)
"""Label and factor of the five coordinates of a place. A positive turn about y is down."""

NOT_REACHED: Final = "not reached"

COLOURS: Final = (
    *((f"level{level}", words) for level, words in enumerate(ACTION_LEVELS)),
    ("none", NOT_REACHED),
)
"""Meaning of the colours of a map: class of a chip, and words.

Cells where the tool axis may not be are blank.
"""

_WIDTH: Final = 430.0
_TALLEST: Final = 380.0
_LARGEST_CELL: Final = 30.0
_LEFT, _TOP, _RIGHT, _BELOW = 62.0, 12.0, 14.0, 46.0


@dataclass(frozen=True)
class Spot:
    """A marked place.

    Attributes:
        point: place of the object (5,), see `ergoqp.placing.place.Placing`.
        name: name beside it, empty for none.
        style: class of the dot, ``"spot"`` or ``"spot other"``.
    """

    point: NDArray[np.float64]
    name: str = ""
    style: str = "spot"


def score_map(
    slice_: Slice,
    values: NDArray[np.float64],
    title: str,
    spots: Sequence[Spot] = (),
    missing: Callable[[int, int], str] | None = None,
) -> str:
    """Draw one map.

    Args:
        slice_: the places.
        values: score per place (v, h): 0 if not reached, -1 if the object may not be there;
            means may be fractions.
        title: title of the picture.
        spots: marked places, projected onto the map.
        missing: (row, column) -> who cannot reach that place, for the tooltip; None if there
            is only one person.
    """
    x_label, x_factor = AXES[slice_.across]
    y_label, y_factor = AXES[slice_.up]
    columns, rows = (x_factor * slice_.horizontal).tolist(), (y_factor * slice_.vertical).tolist()
    x_name, y_name = (label.split(",")[0] for label in (x_label, y_label))
    cell = min(
        (_WIDTH - _LEFT - _RIGHT) / len(columns), (_TALLEST - _TOP) / len(rows), _LARGEST_CELL
    )
    right, bottom = _LEFT + cell * len(columns), _TOP + cell * len(rows)
    # Each cell has its place in the middle.
    x = Scale(min(columns), max(columns), _LEFT + cell / 2, right - cell / 2)
    y = Scale(min(rows), max(rows), bottom - cell / 2, _TOP + cell / 2)
    drawn = [
        svg.element(
            "rect", x=_LEFT, y=_TOP, width=right - _LEFT, height=bottom - _TOP, class_="track"
        )
    ]
    for i, j in np.ndindex(values.shape):
        value = float(values[i, j])
        if value >= 0:
            words = (
                _words(value)
                if value
                else NOT_REACHED + (f" by {missing(i, j)}" if missing is not None else "")
            )
            there = (
                f"{x_name} {words_of(round(columns[j], 3))}, {y_name} {words_of(round(rows[i], 3))}"
            )
            drawn += _cell(value, x.at(columns[j]), y.at(rows[i]), cell, f"{there}: {words}")
    drawn += _axes(x, y, right, bottom, x_label, y_label)
    for spot in spots:
        drawn += _spot(
            spot,
            float(np.clip(x.at(x_factor * spot.point[slice_.across]), _LEFT, right)),
            float(np.clip(y.at(y_factor * spot.point[slice_.up]), _TOP, bottom)),
            right,
        )
    return svg.picture(
        drawn, max(right + _RIGHT, 190.0), bottom + _BELOW, title, _said(values, slice_)
    )


def _cell(value: float, x: float, y: float, cell: float, words: str) -> list[str]:
    level = int(palette.level_of_score(round(value))) if value else -1
    style = f"level{level}" if level >= 0 else "missed"
    size = {"x": x - cell / 2, "y": y - cell / 2, "width": cell + 0.3, "height": cell + 0.3}
    drawn = [svg.element("rect", svg.tooltip(words), **size, class_=style)]
    label = _words(value) if value else ""
    if label and cell >= (13 if len(label) == 1 else 17):
        ink = palette.ink_of_level(level)
        drawn.append(svg.text(label, x, y + 3.5, class_="middle cell", style=f"fill:{ink}"))
    return drawn


def _words(value: float) -> str:
    return f"{value:z.1f}".removesuffix(".0")


def _axes(x: Scale, y: Scale, right: float, bottom: float, x_label: str, y_label: str) -> list[str]:
    drawn = [
        svg.element("line", x1=_LEFT, x2=right, y1=bottom, y2=bottom, class_="axis"),
        svg.element("line", x1=_LEFT, x2=_LEFT, y1=_TOP, y2=bottom, class_="axis"),
    ]
    wide = max(2, int((right - _LEFT) / 48))
    for tick in x.ticks(wide):
        at = x.at(tick)
        drawn.append(svg.element("line", x1=at, x2=at, y1=bottom, y2=bottom + 4, class_="axis"))
        drawn.append(svg.text(words_of(tick), at, bottom + 18, class_="tick middle"))
    for tick in y.ticks(max(2, int((bottom - _TOP) / 34))):
        at = y.at(tick)
        drawn.append(svg.element("line", x1=_LEFT - 4, x2=_LEFT, y1=at, y2=at, class_="axis"))
        drawn.append(svg.text(words_of(tick), _LEFT - 8, at + 4, class_="tick end"))
    drawn.append(
        svg.text(
            x_label,
            max((_LEFT + right) / 2, 14 + width_of(x_label) / 2),
            bottom + 38,
            class_="label middle",
        )
    )
    turned = f"rotate(-90 14 {svg.number((_TOP + bottom) / 2)})"
    drawn.append(
        svg.text(y_label, 14, (_TOP + bottom) / 2, class_="label middle", transform=turned)
    )
    return drawn


def _spot(spot: Spot, x: float, y: float, right: float) -> list[str]:
    to_the_left = x + 12 + width_of(spot.name) > right + _RIGHT
    side = (
        {"at": x - 10, "class_": "strong end halo"}
        if to_the_left
        else {"at": x + 10, "class_": "strong halo"}
    )
    return [
        svg.element("circle", cx=x, cy=y, r=6, class_=spot.style),
        *(
            [svg.text(spot.name, float(side["at"]), y - 8, class_=side["class_"])]
            if spot.name
            else []
        ),
    ]


def _said(values: NDArray[np.float64], slice_: Slice) -> str:
    scored = values[values > 0]
    what = f"{AXES[slice_.across][0]}; {AXES[slice_.up][0]}"
    if not scored.size:
        return f"Over {what}: no place is reached."
    share = 100 * scored.size / max(1, int((values >= 0).sum()))
    return (
        f"Over {what}: scores {_words(scored.min())} to {_words(scored.max())}, {share:.0f} % of"
        " the places reached."
    )
