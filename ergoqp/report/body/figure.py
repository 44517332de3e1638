"""Flat figures of people: one in a posture, or several side by side on one floor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ergoqp.expressions import matrix_of
from ergoqp.human import Body
from ergoqp.report import palette
from ergoqp.report.body.person import parts_of, place
from ergoqp.report.charts import svg
from ergoqp.report.charts.axes import WIDTH, width_of

_HEIGHT: Final = 300.0  # height of an upright person with some margin [px]
MARGIN: Final = 0.13
"""Room around the axes of the shapes [m]."""
_VIEW_DEG: Final = 35.0  # from the right side towards the front
_OWN_COLOUR: Final = "#4b4f57"  # hair and shoes


_Shape = tuple[NDArray[np.float64], float, float]
"""A capsule in the world: axis ends (2, 3) [m], radius [m] and nearness to the viewer [m]."""


class Drawing:
    """A posture as shapes in the plane of a picture, seen from the front right of the person.

    Args:
        body: the person.
        posture: shape (32,) [rad], finite.
        base_pose: pelvis in the world, shape (4, 4).
        segments: segment -> score, less than 1 without one.
        contact: contact frame of the held object in the world, shape (4, 4), None without an
            object.

    Attributes:
        contact: as given.
        horizontal: leftmost and rightmost coordinate of the axes of all shapes, with a margin
            [m].
        vertical: lowest and highest coordinate, with a margin [m].
    """

    def __init__(
        self,
        body: Body,
        posture: NDArray[np.float64],
        base_pose: NDArray[np.float64],
        segments: Mapping[str, int],
        contact: NDArray[np.float64] | None = None,
    ) -> None:
        """Compute the positions of the shapes."""
        placement = place(body, posture[None], base_pose[None])
        turn = np.radians(_VIEW_DEG)
        forward, left = base_pose[:3, 0], base_pose[:3, 1]
        self._across = np.cos(turn) * forward + np.sin(turn) * left  # to the right in the picture
        towards = np.sin(turn) * forward - np.cos(turn) * left  # toward the viewer
        self.contact = contact
        self._groups: dict[tuple[str, str], list[_Shape]] = {}
        for part in parts_of(body):
            position, quaternion = (values[0] for values in placement.of(part.owner))
            rotation = matrix_of(quaternion)
            centre, axis = position + rotation @ part.position, rotation @ part.rotation[:, 2]
            # An ellipsoid is drawn as the capsule through its longest axis.
            radius = float(part.size[0] if part.capsule else part.size[:2].mean())
            half = float(part.size[1] if part.capsule else max(part.size[2] - radius, 0.0))
            level = int(palette.level_of_points(segments.get(part.segment or "", 0)))
            colour = _OWN_COLOUR if part.segment is None else palette.colour_of_level(level)
            ends = np.stack([centre - half * axis, centre + half * axis])
            shape = ends, radius, float(centre @ towards)
            self._groups.setdefault((part.owner, colour), []).append(shape)
        everything = np.concatenate([ends for group in self._groups.values() for ends, *_ in group])
        if contact is not None:
            everything = np.concatenate([everything, contact[None, :3, 3]])
        self.horizontal = self._ends(everything @ self._across)
        self.vertical = self._ends(everything[:, 2])

    def elements(self, scale: float, left: float, floor: float) -> list[str]:
        """Return the shapes, back to front.

        Args:
            scale: scale of the picture [px/m].
            left: position of 0 of the horizontal axis [px].
            floor: position of height 0 [px].
        """

        def at(point: NDArray[np.float64]) -> tuple[float, float]:
            return left + float(point @ self._across) * scale, floor - float(point[2]) * scale

        drawn: list[str] = []
        # Shapes of one body and colour share one outline, so that the trunk is not cut into
        # rings.
        for (_, colour), group in sorted(
            self._groups.items(), key=lambda item: max(depth for *_, depth in item[1])
        ):
            lines = []
            for ends, radius, _ in group:
                (x1, y1), (x2, y2) = map(at, ends)
                # In some browsers a line of zero length has no round ends.
                line = {"x1": x1, "y1": y1, "x2": x2 + 0.01, "y2": y2, "stroke_linecap": "round"}
                lines.append((line, 2 * radius * scale))
            drawn += [
                svg.element("line", **line, stroke_width=width + 2, class_="outline")
                for line, width in lines
            ]
            drawn += [
                svg.element("line", **line, stroke_width=width, stroke=colour)
                for line, width in lines
            ]
        if self.contact is not None:
            x, y = at(self.contact[:3, 3])
            tip_x, tip_y = at(self.contact[:3, 3] + 0.14 * self.contact[:3, 0])
            drawn += [svg.line(x, y, tip_x, tip_y, "tool"), svg.circle(x, y, 4, "dot")]
        return drawn

    @staticmethod
    def _ends(values: NDArray[np.float64]) -> tuple[float, float]:
        return float(values.min()) - MARGIN, float(values.max()) + MARGIN


def posture_figure(
    body: Body,
    posture: NDArray[np.float64],
    base_pose: NDArray[np.float64],
    segments: Mapping[str, int],
    title: str,
    contact: NDArray[np.float64] | None = None,
) -> str:
    """Draw a posture, each segment in the colour of its score, seen from the front right.

    Args:
        body: the person.
        posture: shape (32,) [rad], finite.
        base_pose: pelvis in the world, shape (4, 4).
        segments: segment -> score.
        title: title of the picture.
        contact: contact frame of the held object in the world, shape (4, 4), None without an
            object.
    """
    drawing = Drawing(body, posture, base_pose, segments, contact)
    (left, right), (low, high) = drawing.horizontal, drawing.vertical
    scale = _HEIGHT / max(high - low, body.stature + 2 * MARGIN)
    drawn = drawing.elements(scale, -left * scale, high * scale)
    said = f"Seen from the front right. Scores: {said_of(segments)}."
    return svg.picture(drawn, max((right - left) * scale, 120.0), (high - low) * scale, title, said)


def said_of(segments: Mapping[str, int]) -> str:
    """Return the scores of the segments in words."""
    return ", ".join(
        f"{name.replace('_', ' ')} {segments[name] if segments[name] > 0 else 'not seen'}"
        for name in palette.SEGMENTS
        if name in segments
    )


_SCALE: Final = 132.0  # [px/m]
_GAP: Final = 6.0
_WORDS: Final = 58.0  # room for the margin and two lines of text below the floor


class Standing(NamedTuple):
    """One person of the row.

    Attributes:
        label: name of the person.
        score: final score.
        drawing: the person with the object.
    """

    label: str
    score: int
    drawing: Drawing


def lineup(people: Sequence[Standing], title: str, *, width: float = WIDTH) -> str:
    """Draw a row of people, in more than one row if it is too long.

    Args:
        people: the people, from the left.
        title: title of the picture.
        width: largest width of the picture [px].
    """
    top = max(person.drawing.vertical[1] for person in people)
    bottom = min(0.0, *(person.drawing.vertical[0] for person in people))
    height = (top - bottom) * _SCALE + _WORDS
    widths = []
    for person in people:
        left, right = person.drawing.horizontal
        words = max(width_of(person.label) + 8, width_of(f"REBA {person.score}") + 20)
        widths.append(max((right - left) * _SCALE, words))
    rows = _rows(widths, width)
    length = max(sum(widths[i] + _GAP for i in row) for row in rows)
    drawn: list[str] = []
    for number, row in enumerate(rows):
        floor = number * height + top * _SCALE
        end = sum(widths[i] + _GAP for i in row)
        drawn.append(svg.line(0, floor, end, floor, "axis"))
        contact = people[row[0]].drawing.contact
        if contact is not None:
            held = floor - float(contact[2, 3]) * _SCALE
            drawn.append(svg.line(0, held, end, held, "mark"))
        x = 0.0
        for i in row:
            drawn += _one(people[i], x + widths[i] / 2, floor, floor - bottom * _SCALE)
            x += widths[i] + _GAP
    said = "; ".join(f"{person.label}: REBA {person.score}" for person in people)
    return svg.picture(
        drawn,
        length,
        len(rows) * height,
        title,
        f"{said}. The dashed line is the height of the object.",
    )


def _one(person: Standing, middle: float, floor: float, below: float) -> list[str]:
    low, high = person.drawing.horizontal
    level = int(palette.level_of_score(person.score))
    words, ink = f"REBA {person.score}", f"fill:{palette.ink_of_level(level)}"
    chip = width_of(words) + 18
    return [
        *person.drawing.elements(_SCALE, middle - (low + high) / 2 * _SCALE, floor),
        svg.text(person.label, middle, below + 20, class_="small middle"),
        svg.rect(middle - chip / 2, below + 28, chip, 19, rx=9, class_=f"level{level} edge"),
        svg.text(words, middle, below + 42, class_="strong middle", style=ink),
    ]


def _rows(widths: Sequence[float], most: float) -> list[list[int]]:
    """Return the people of each row: as few rows as possible, with about equally many in each."""
    total = sum(width + _GAP for width in widths)
    count = max(1, int(np.ceil(total / most)))
    while True:
        rows = [part.tolist() for part in np.array_split(np.arange(len(widths)), count)]
        if count >= len(widths) or all(sum(widths[i] + _GAP for i in row) <= most for row in rows):
            return rows
        count += 1
