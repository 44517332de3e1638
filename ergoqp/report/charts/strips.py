"""Charts with one row per item, and a map of scores over two coordinates.

A map of scores over two coordinates of the object's place. Each cell has a number and the colour of
its action level.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ergoqp.placing.place import Slice
from ergoqp.report import palette
from ergoqp.report.charts import svg
from ergoqp.report.charts.axes import (
    WIDTH,
    Scale,
    highest_per_column,
    named_dot,
    time_axis,
    upright_label,
    width_of,
    words_of,
)
from ergoqp.sheets.reba import ACTION_LEVELS

_ROW: Final = 26.0
_WORDS: Final = 14.0  # room for the text above a row [px]
_LONGEST_LABEL: Final = 30  # characters
_LINE: Final = 5.0  # height of the thin line of a row [px]
_THINNEST: Final = 2.4  # of a stretch, so that a single step is visible [px]


@dataclass(frozen=True, eq=False)
class Strip:
    """One row of a chart over time.

    Attributes:
        name: name of the row.
        values: shape (n,); 0 draws nothing, any other value draws the class in `styles`.
        styles: value -> class and words.
        note: text at the end of the row.
        most: values of a thin line at the lower end, drawn likewise; None without it.
    """

    name: str
    values: NDArray[np.integer]
    styles: Mapping[int, tuple[str, str]]
    note: str
    most: NDArray[np.integer] | None = None


def strips_chart(
    title: str,
    time: NDArray[np.float64],
    strips: Sequence[Strip],
    *,
    width: float = WIDTH,
) -> str:
    """Draw rows of coloured stretches over time. A stretch shorter than a pixel is still drawn.

    Args:
        title: title of the chart.
        time: shape (n,) [s].
        strips: the rows, from the top.
        width: width of the chart [px]; on a narrow one the text is above its row.
    """
    over = width < WIDTH
    names = max((width_of(_short(strip.name)) for strip in strips), default=0)
    notes = max((width_of(strip.note) for strip in strips), default=0)
    left, right = (8.0, width - 12) if over else (14 + names, width - 14 - notes)
    row, words = (_ROW + _WORDS, _WORDS) if over else (_ROW, 0.0)
    high = float(time[-1]) if time[-1] > time[0] else float(time[0]) + 1
    scale = Scale(float(time[0]), high, left, right)
    top, bottom = 6.0, 6.0 + row * len(strips)
    drawn = time_axis(scale, top, bottom, "time, s")
    for i, strip in enumerate(strips):
        y = top + row * i + words
        drawn.append(svg.rect(left, y + 4, right - left, _ROW - 8, class_="track"))
        short = _short(strip.name)
        full = svg.tooltip(strip.name) if short != strip.name else ""
        if over:
            label = svg.text(short, left, y, class_="small halo")
            note = svg.text(strip.note, right, y, class_="small end halo")
        else:
            label = svg.text(short, left - 8, y + _ROW / 2 + 4, class_="small end")
            note = svg.text(strip.note, right + 8, y + _ROW / 2 + 4, class_="small")
        drawn.append(svg.element("g", [full, label]))
        drawn += _stretches(strip, strip.values, "", time, scale, y + 4, _ROW - 8)
        if strip.most is not None:
            place = y + _ROW - 4 - _LINE
            drawn += _stretches(strip, strip.most, "at most ", time, scale, place, _LINE)
        drawn.append(note)
    said = "; ".join(f"{strip.name} {strip.note}" for strip in strips)
    return svg.picture(drawn, width, bottom + 42, title, f"{said}.")


def _stretches(
    strip: Strip,
    values: NDArray[np.integer],
    before: str,
    time: NDArray[np.float64],
    scale: Scale,
    y: float,
    height: float,
) -> list[str]:
    """Return the coloured stretches of a row.

    Args:
        strip: the row.
        values: its values (n,).
        before: words before those of each value.
        time: shape (n,) [s].
        scale: scale of the time.
        y: upper end of the stretches [px].
        height: their height [px].
    """
    drawn = []
    for start, end, value in highest_per_column(time, values, int(scale.end - scale.start)):
        if value:
            style, said = strip.styles[value]
            x = scale.at(start)
            length = max(scale.at(end) - x, _THINNEST)
            what = svg.tooltip(f"{strip.name}: {before}{said}, {start:.2f} to {end:.2f} s")
            drawn.append(svg.rect(x, y, length, height, what, class_=style))
    return drawn


def segments_strips(
    time: NDArray[np.float64],
    segments: Mapping[str, NDArray[np.integer]],
    most: Mapping[str, NDArray[np.integer]] | None = None,
    notes: Mapping[str, str] | None = None,
    *,
    width: float = WIDTH,
) -> str:
    """Draw the score of every segment over time, in the colours of the body.

    Args:
        time: shape (n,) [s].
        segments: name -> scores, 0 without a score, -1 where it is not seen; shape (n,) each.
        most: name -> highest score that it may have, 0 where it has no range; shape (n,) each.
        notes: name -> text at the end of its row; None: the mean of its scores.
        width: width of the chart [px].
    """
    strips = []
    for name in palette.SEGMENTS:
        scores = segments[name]
        styles = {
            score: (f"level{palette.level_of_points(score)}", f"{score}") for score in range(1, 10)
        }
        styles[-1] = ("unscored", "not seen")
        scored, note = scores[scores > 0], "not scored"
        if notes is not None:
            note = notes[name]
        elif scored.size:
            note = f"mean {scored.mean():.1f} of {palette.segment_highest(name)}"
        line = None if most is None or not most[name].any() else most[name]
        strips.append(Strip(name.replace("_", " "), scores, styles, note, line))
    return strips_chart("Segment scores over time", time, strips, width=width)


def segments_chart(
    before: Mapping[str, int], after: Mapping[str, int], *, width: float = WIDTH
) -> str:
    """Draw the score of each segment before and after, over its range on the sheet.

    Args:
        before: segment -> score.
        after: segment -> score.
        width: width of the chart [px].
    """
    over = width < WIDTH
    top, row, left = 62.0 if over else 44.0, 30.0, 118.0 if over else 130.0
    highest = max(palette.segment_highest(name) for name in palette.SEGMENTS)
    words_at = width - (90 if over else 96)
    scale = Scale(1, highest, left + 16, words_at - 24)
    bottom = top + row * len(palette.SEGMENTS)
    drawn = _key(8.0 if over else left + 16, over)
    for points in range(1, highest + 1):
        x = scale.at(points)
        drawn.append(svg.line(x, top - 6, x, bottom, "grid"))
        drawn.append(svg.text(str(points), x, bottom + 16, class_="tick middle"))
    middle = (scale.start + scale.end) / 2
    drawn.append(svg.text("points of the segment", middle, bottom + 36, class_="label middle"))
    for i, name in enumerate(palette.SEGMENTS):
        y = top + row * (i + 0.5)
        first, last = scale.at(before[name]), scale.at(after[name])
        drawn.append(svg.text(name.replace("_", " "), left - 2, y + 4, class_="small end"))
        end = scale.at(palette.segment_highest(name))
        drawn.append(svg.line(scale.start, y, end, y, "rail"))
        drawn.append(svg.line(first, y, last, y, "link"))
        drawn.append(svg.circle(first, y, 10, "hollow"))
        level = int(palette.level_of_points(after[name]))
        style = f"level{level} edge" if level >= 0 else "unscored edge"
        drawn.append(svg.circle(last, y, 7, style))
        words, style = f"{before[name]} → {after[name]}", "strong"
        if before[name] == after[name]:
            words, style = f"{after[name]}, unchanged", "small"
        drawn.append(svg.text(words, words_at, y + 4, class_=style))
    said = "; ".join(
        f"{name.replace('_', ' ')} {before[name]} to {after[name]}" for name in palette.SEGMENTS
    )
    return svg.picture(drawn, width, bottom + 44, "Segment scores before and after", f"{said}.")


def _key(x: float, over: bool) -> list[str]:
    """Return the legend of the dots, in one line or in two."""
    after, y = x + 90, 14.0
    words = ["after, coloured by its points", "the track is the sheet's range"]
    lines = words if over else ["; ".join(words)]
    return [
        svg.circle(x, y, 7, "hollow"),
        svg.text("before", x + 14, y + 4, class_="small"),
        svg.circle(after, y, 7, "level0 edge"),
        *(
            svg.text(line, after + 14, y + 4 + 18 * i, class_="small")
            for i, line in enumerate(lines)
        ),
    ]


def _short(name: str) -> str:
    return name if len(name) <= _LONGEST_LABEL else name[: _LONGEST_LABEL - 1] + "…"


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
        point: place of the object (5,), see `ergoqp.placing.place.PoseParametrization`.
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
    drawn = [svg.rect(_LEFT, _TOP, right - _LEFT, bottom - _TOP, class_="track")]
    for i, j in np.ndindex(values.shape):
        value = float(values[i, j])
        if value >= 0:
            words = _words(value) if value else NOT_REACHED
            if not value and missing is not None:
                words += f" by {missing(i, j)}"
            x_words, y_words = (words_of(round(each, 3)) for each in (columns[j], rows[i]))
            there = f"{x_name} {x_words}, {y_name} {y_words}"
            drawn += _cell(value, x.at(columns[j]), y.at(rows[i]), cell, f"{there}: {words}")
    drawn += _axes(x, y, right, bottom, x_label, y_label)
    for spot in spots:
        along = float(np.clip(x.at(x_factor * spot.point[slice_.across]), _LEFT, right))
        down = float(np.clip(y.at(y_factor * spot.point[slice_.up]), _TOP, bottom))
        drawn += named_dot(along, down, 6, spot.style, spot.name, right + _RIGHT)
    said = _said(values, slice_)
    return svg.picture(drawn, max(right + _RIGHT, 190.0), bottom + _BELOW, title, said)


def _cell(value: float, x: float, y: float, cell: float, words: str) -> list[str]:
    level = int(palette.level_of_score(round(value))) if value else -1
    style = f"level{level}" if level >= 0 else "missed"
    size, what = cell + 0.3, svg.tooltip(words)
    drawn = [svg.rect(x - cell / 2, y - cell / 2, size, size, what, class_=style)]
    label = _words(value) if value else ""
    if label and cell >= (13 if len(label) == 1 else 17):
        ink = palette.ink_of_level(level)
        drawn.append(svg.text(label, x, y + 3.5, class_="middle cell", style=f"fill:{ink}"))
    return drawn


def _words(value: float) -> str:
    return f"{value:z.1f}".removesuffix(".0")


def _axes(x: Scale, y: Scale, right: float, bottom: float, x_label: str, y_label: str) -> list[str]:
    drawn = [
        svg.line(_LEFT, bottom, right, bottom, "axis"),
        svg.line(_LEFT, _TOP, _LEFT, bottom, "axis"),
    ]
    for tick in x.ticks(max(2, int((right - _LEFT) / 48))):
        at = x.at(tick)
        drawn.append(svg.line(at, bottom, at, bottom + 4, "axis"))
        drawn.append(svg.text(words_of(tick), at, bottom + 18, class_="tick middle"))
    for tick in y.ticks(max(2, int((bottom - _TOP) / 34))):
        at = y.at(tick)
        drawn.append(svg.line(_LEFT - 4, at, _LEFT, at, "axis"))
        drawn.append(svg.text(words_of(tick), _LEFT - 8, at + 4, class_="tick end"))
    middle = max((_LEFT + right) / 2, 14 + width_of(x_label) / 2)
    drawn.append(svg.text(x_label, middle, bottom + 38, class_="label middle"))
    return [*drawn, upright_label(y_label, (_TOP + bottom) / 2)]


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
