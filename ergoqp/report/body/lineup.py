"""Several people side by side on one floor, in one scale, at the same height of the object."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ergoqp.human import Body
from ergoqp.report import palette
from ergoqp.report.body.figure import Drawing
from ergoqp.report.charts import svg
from ergoqp.report.charts.frame import WIDTH, width_of

_SCALE: Final = 132.0  # [px/m]
_GAP: Final = 6.0
_WORDS: Final = 58.0  # room for the margin and two lines of text below the floor


@dataclass(frozen=True, eq=False)
class Standing:
    """One person of the row.

    Attributes:
        body: the person.
        posture: shape (32,) [rad].
        base_pose: pelvis in the world, shape (4, 4).
        segments: segment -> score.
        label: name of the person.
        score: final score.
        contact: contact frame of the object, shape (4, 4).
    """

    body: Body
    posture: NDArray[np.float64]
    base_pose: NDArray[np.float64]
    segments: Mapping[str, int]
    label: str
    score: int
    contact: NDArray[np.float64]


def lineup(people: Sequence[Standing], title: str, *, width: float = WIDTH) -> str:
    """Draw a row of people, in more than one row if it is too long.

    Args:
        people: the people, from the left.
        title: title of the picture.
        width: largest width of the picture [px].
    """
    drawings = [Drawing(p.body, p.posture, p.base_pose, p.segments, p.contact) for p in people]
    top = max(drawing.vertical[1] for drawing in drawings)
    bottom = min(0.0, *(drawing.vertical[0] for drawing in drawings))
    height = (top - bottom) * _SCALE + _WORDS
    widths = [
        max(
            (d.horizontal[1] - d.horizontal[0]) * _SCALE,
            width_of(p.label) + 8,
            width_of(_words(p)) + 20,
        )
        for d, p in zip(drawings, people, strict=True)
    ]
    rows = _rows(widths, width)
    length = max(sum(widths[i] + _GAP for i in row) for row in rows)
    drawn: list[str] = []
    for number, row in enumerate(rows):
        floor = number * height + top * _SCALE
        end = sum(widths[i] + _GAP for i in row)
        drawn.append(svg.element("line", x1=0, x2=end, y1=floor, y2=floor, class_="axis"))
        held = floor - float(people[row[0]].contact[2, 3]) * _SCALE
        drawn.append(svg.element("line", x1=0, x2=end, y1=held, y2=held, class_="mark"))
        x = 0.0
        for i in row:
            drawn += _one(people[i], drawings[i], x, widths[i], floor, floor - bottom * _SCALE)
            x += widths[i] + _GAP
    said = "; ".join(f"{person.label}: REBA {person.score}" for person in people)
    return svg.picture(
        drawn,
        length,
        len(rows) * height,
        title,
        f"{said}. The dashed line is the height of the object.",
    )


def _one(
    person: Standing, drawing: Drawing, x: float, width: float, floor: float, below: float
) -> list[str]:
    low, high = drawing.horizontal
    middle = x + width / 2
    level = int(palette.level_of_score(person.score))
    words = _words(person)
    chip = width_of(words) + 18
    return [
        *drawing.elements(_SCALE, middle - (low + high) / 2 * _SCALE, floor),
        svg.text(person.label, middle, below + 20, class_="small middle"),
        svg.element(
            "rect",
            x=middle - chip / 2,
            y=below + 28,
            width=chip,
            height=19,
            rx=9,
            class_=f"level{level} edge",
        ),
        svg.text(
            words,
            middle,
            below + 42,
            class_="strong middle",
            style=f"fill:{palette.ink_of_level(level)}",
        ),
    ]


def _words(person: Standing) -> str:
    return f"REBA {person.score}"


def _rows(widths: Sequence[float], most: float) -> list[list[int]]:
    """Return the people of each row: as few rows as possible, with about equally many in each."""
    total = sum(width + _GAP for width in widths)
    count = max(1, int(np.ceil(total / most)))
    while True:
        rows = [part.tolist() for part in np.array_split(np.arange(len(widths)), count)]
        if count >= len(widths) or all(sum(widths[i] + _GAP for i in row) <= most for row in rows):
            return rows
        count += 1
