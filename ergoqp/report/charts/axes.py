"""The frame of all charts over time: axes with units, grid, legend, scales from data to pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ergoqp.report.charts import svg


@dataclass(frozen=True)
class Scale:
    """A mapping of an interval of data onto pixels.

    Attributes:
        low: data at `start`.
        high: data at `end`.
        start: pixel.
        end: pixel; less than `start` for an axis that points up.
        logarithmic: whether the scale is logarithmic; both ends are then positive.
    """

    low: float
    high: float
    start: float
    end: float
    logarithmic: bool = False

    def __call__(self, values: ArrayLike) -> NDArray[np.float64]:
        """Return the pixels of values; same shape."""
        data, low, high = np.asarray(values, dtype=float), self.low, self.high
        if self.logarithmic:
            data, low, high = np.log(data), np.log(low), np.log(high)
        return self.start + (data - low) / (high - low) * (self.end - self.start)

    def at(self, value: float) -> float:
        """Return the pixel of one value."""
        return float(self(value))

    def ticks(self, count: int = 6) -> list[float]:
        """Return about `count` round numbers within the interval."""
        if self.logarithmic:
            decades = np.arange(np.floor(np.log10(self.low)), np.ceil(np.log10(self.high)) + 1)
            steps = (1.0, 2.0, 5.0) if len(decades) <= 4 else (1.0,)
            low, high = self.low * (1 - 1e-9), self.high * (1 + 1e-9)
            candidates = [step * 10.0**decade for decade in decades for step in steps]
            return [value for value in candidates if low <= value <= high]
        return round_ticks(self.low, self.high, count)


def round_ticks(low: float, high: float, count: int = 6) -> list[float]:
    """Return about `count` multiples of 1, 2 or 5 times a power of ten within an interval."""
    raw = (high - low) / max(count, 1)
    power = 10.0 ** np.floor(np.log10(raw))
    steps = (multiple * power for multiple in (1.0, 2.0, 5.0, 10.0))
    step = next(step for step in steps if step >= raw * (1 - 1e-9))
    first, last = np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9)
    return [float(k * step) for k in np.arange(first, last + 1)]


def padded(
    values: NDArray[np.float64], *, share: float = 0.08, least: float = 1e-6
) -> tuple[float, float]:
    """Return an interval around finite values, with room at both ends.

    Args:
        values: any shape; values that are not finite are ignored.
        share: room at each end, relative to the width.
        least: smallest width, for values that are all equal.
    """
    finite = values[np.isfinite(values)]
    if not finite.size:
        return 0.0, 1.0
    low, high = float(finite.min()), float(finite.max())
    room = max(share * (high - low), (least - (high - low)) / 2)
    return low - room, high + room


def words_of(value: float) -> str:
    """Return the number of a tick as text without trailing zeros or rounding errors."""
    text = np.format_float_positional(value + 0.0, 6, unique=False, fractional=False, trim="-")
    return text.replace("-", "−")


def columns_of(x: NDArray[np.float64], columns: int) -> NDArray[np.int64]:
    """Return the column, 0 to `columns` - 1, of each ascending position x (n,)."""
    width = float(x[-1] - x[0]) if len(x) else 0.0
    if width <= 0:
        return np.zeros(len(x), dtype=np.int64)
    return np.minimum(((x - x[0]) / width * columns).astype(np.int64), columns - 1)


Line = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Positions (n,) and values (n,)."""


def thinned(x: NDArray[np.float64], y: NDArray[np.float64], columns: int = 700) -> Line:
    """Return at most four points per column: first, lowest, highest and last, so no peak is lost.

    Args:
        x: ascending, shape (n,).
        y: shape (n,); NaN for no value. A column without any number becomes one NaN, which
            interrupts a line.
        columns: number of columns, about one per pixel.
    """
    if len(x) <= 4 * columns:
        return x, y
    column = columns_of(x, columns)
    starts = np.flatnonzero(np.diff(column, prepend=-1))
    ends = np.append(starts[1:], len(x))
    kept: list[int] = []
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        piece = y[start:end]
        finite = np.flatnonzero(np.isfinite(piece))
        if finite.size:
            values = piece[finite]
            kept += (start + np.unique(finite[[0, values.argmin(), values.argmax(), -1]])).tolist()
        else:
            kept.append(start)
    return x[kept], y[kept]


def changes(values: NDArray[np.integer]) -> NDArray[np.int64]:
    """Return the positions at which a piecewise constant series changes its value.

    The first sample is one of them.
    """
    return np.flatnonzero(np.diff(values, prepend=values[:1] - 1))


def highest_per_column(
    x: NDArray[np.float64], values: NDArray[np.integer], columns: int = 700
) -> list[tuple[float, float, int]]:
    """Return stretches (from, to, value) of a piecewise constant series.

    Within a column the highest value wins.

    Args:
        x: ascending, shape (n,).
        values: shape (n,).
        columns: number of columns, about one per pixel.
    """
    if not len(x):
        return []
    if len(x) > columns:
        column = columns_of(x, columns)
        starts = np.flatnonzero(np.diff(column, prepend=-1))
        x, values = np.append(x[starts], x[-1]), np.maximum.reduceat(values, starts)
    else:
        x = np.append(x, x[-1])
    first = changes(values)
    last = np.append(first[1:], len(values))
    return [(float(x[i]), float(x[j]), int(values[i])) for i, j in zip(first, last, strict=True)]


WIDTH: Final = 800.0
"""Width of a chart on a page of full width [px]."""

NARROW: Final = 390.0
"""Width of a chart on a telephone [px]. The letters of a wide chart would be too small there."""

_CHARACTER: Final = 7.0  # average width of a character at 12 px, a little generous [px]
_LEGEND_ROW: Final = 20.0


def width_of(words: str) -> float:
    """Return the approximate width of a line of text at 12 px [px]."""
    return _CHARACTER * len(words)


class Plot:
    """A rectangle of data with axes around it. Lines and marks are added from back to front.

    Args:
        x: lowest and highest value of the horizontal axis.
        y: lowest and highest value of the vertical axis.
        x_label: label with its unit.
        y_label: label with its unit.
        legend: class and name of each line, in order; the class of an area is ``"span"``.
        height: height of the data's rectangle [px].
        right: room on its right side [px].
        y_ticks: positions of numbers; None: round ones.
        logarithmic: whether the horizontal axis is logarithmic.
        width: width of the chart [px].
    """

    def __init__(
        self,
        x: tuple[float, float],
        y: tuple[float, float],
        x_label: str,
        y_label: str,
        *,
        legend: Sequence[tuple[str, str]] = (),
        height: float = 180.0,
        right: float = 14.0,
        y_ticks: Sequence[float] | None = None,
        logarithmic: bool = False,
        width: float = WIDTH,
    ) -> None:
        """Compute the layout of the frame."""
        ticks = list(y_ticks) if y_ticks is not None else Scale(*y, 0, 1).ticks(5)
        self.left = 34.0 + max((width_of(words_of(tick)) for tick in ticks), default=0.0)
        self.width = width
        self._legend, rows = _legend(legend, self.left, width - right)
        self.top = 10.0 + _LEGEND_ROW * rows
        self.bottom = self.top + height
        self.right = width - right
        self.x = Scale(*x, self.left, self.right, logarithmic)
        self.y = Scale(*y, self.bottom, self.top)
        self._axes = self._draw_axes(ticks, x_label, y_label)
        self._back: list[str] = []
        self._front: list[str] = []

    def shade(self, low: float, high: float, words: str, **attributes: object) -> None:
        """Shade between two values of y, behind everything, with a name on the right."""
        bottom, top = self.y(np.clip([low, high], self.y.low, self.y.high)).tolist()
        if bottom - top < 1:
            return
        width = self.right - self.left
        self._back.append(svg.rect(self.left, top, width, bottom - top, **attributes))
        self._front.append(svg.text(words, self.right + 6, (top + bottom) / 2 + 4, class_="small"))

    def line(
        self, x: NDArray[np.float64], y: NDArray[np.float64], style: str, *, steps: bool = False
    ) -> None:
        """Draw a series, thinned to the visible resolution.

        Args:
            x: ascending, shape (n,).
            y: shape (n,); NaN interrupts the line.
            style: class of the line.
            steps: hold each value until the next.
        """
        x, y = thinned(x, y, int(self.right - self.left))
        drawn = svg.path(self.x(x), self.y(y), steps=steps)
        self._front.append(svg.element("path", d=drawn, class_=f"line {style}"))

    def area(
        self, x: NDArray[np.float64], low: NDArray[np.int64], high: NDArray[np.int64], style: str
    ) -> None:
        """Fill between two piecewise constant series, at the visible resolution.

        Within a column, the lowest and the highest value count.

        Args:
            x: ascending, shape (n,).
            low: shape (n,); 0 interrupts the area.
            high: shape (n,).
            style: class of the area.
        """
        columns = int(self.right - self.left)
        if len(x) > columns:
            starts = np.flatnonzero(np.diff(columns_of(x, columns), prepend=-1))
            most = np.iinfo(low.dtype).max
            low = np.minimum.reduceat(np.where(low > 0, low, most), starts)
            low = np.where(low == most, 0, low)
            x, high = np.append(x[starts], x[-1]), np.maximum.reduceat(high, starts)
            low, high = np.append(low, low[-1:]), np.append(high, high[-1:])
        kept = np.unique(np.concatenate([changes(low), changes(high), [len(x) - 1]]))
        ends = (np.where(low[kept] > 0, each[kept], np.nan) for each in (low, high))
        drawn = svg.area(self.x(x[kept]), *(self.y(each) for each in ends))
        self._front.append(svg.element("path", d=drawn, class_=style))

    def add(self, *elements: str) -> None:
        """Add elements in front, at pixel positions from the scales `x` and `y`."""
        self._front += elements

    def picture(self, title: str, description: str) -> str:
        """Return the finished chart."""
        content = [*self._back, *self._axes, *self._front, *self._legend]
        return svg.picture(content, self.width, self.bottom + 42, title, description)

    def _draw_axes(self, ticks: Sequence[float], x_label: str, y_label: str) -> list[str]:
        drawn = []
        for tick in ticks:
            y = self.y.at(tick)
            drawn.append(svg.line(self.left, y, self.right, y, "grid"))
            drawn.append(svg.text(words_of(tick), self.left - 8, y + 4, class_="tick end"))
        drawn += time_axis(self.x, self.top, self.bottom, x_label)
        return [*drawn, upright_label(y_label, (self.top + self.bottom) / 2)]


def upright_label(label: str, middle: float) -> str:
    """Return the label of a vertical axis, turned, with its middle at a height [px]."""
    turned = f"rotate(-90 14 {svg.number(middle)})"
    return svg.text(label, 14, middle, class_="label middle", transform=turned)


def named_dot(x: float, y: float, r: float, style: str, words: str, right: float) -> list[str]:
    """Return a dot with its name, on the side with room.

    Args:
        x: place of the dot [px].
        y: likewise.
        r: radius of the dot [px].
        style: class of the dot.
        words: the name; empty for none.
        right: the name must end before this [px].
    """
    dot = svg.circle(x, y, r, style)
    if not words:
        return [dot]
    if x + 12 + width_of(words) > right:
        return [dot, svg.text(words, x - 10, y - 8, class_="strong end halo")]
    return [dot, svg.text(words, x + 10, y - 8, class_="strong halo")]


def time_axis(scale: Scale, top: float, bottom: float, label: str) -> list[str]:
    """Return the horizontal axis below a rectangle: line, ticks, numbers, label with its unit."""
    drawn = [svg.line(scale.start, bottom, scale.end, bottom, "axis")]
    ends = -np.inf
    for tick in scale.ticks(max(3, min(8, int((scale.end - scale.start) / 60)))):
        x, half = scale.at(tick), width_of(words_of(tick)) / 2
        if x - half < ends + 6:
            continue  # its number would touch the one before
        ends = x + half
        drawn.append(svg.line(x, top, x, bottom, "grid"))
        drawn.append(svg.line(x, bottom, x, bottom + 4, "axis"))
        drawn.append(svg.text(words_of(tick), x, bottom + 18, class_="tick middle"))
    drawn.append(svg.text(label, (scale.start + scale.end) / 2, bottom + 36, class_="label middle"))
    return drawn


def _legend(entries: Sequence[tuple[str, str]], left: float, right: float) -> tuple[list[str], int]:
    """Return samples of lines and areas with their names, in rows, and the number of rows."""
    drawn: list[str] = []
    x, row = left, 0
    for style, name in entries:
        width = 30 + width_of(name)
        if x > left and x + width > right:
            x, row = left, row + 1
        y = 12 + _LEGEND_ROW * row
        if style == "span":
            drawn.append(svg.rect(x, y - 6, 20, 12, class_=style))
        else:
            sample = f"M{x:.1f} {y:.1f}H{x + 20:.1f}"
            drawn.append(svg.element("path", d=sample, class_=f"line {style} sample"))
        drawn.append(svg.text(name, x + 26, y + 4, class_="small"))
        x += width + 16
    return drawn, row + 1 if entries else 0
