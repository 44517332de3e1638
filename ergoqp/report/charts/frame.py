"""The frame of all charts over time: axes with units, grid, legend."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ergoqp.report.charts import svg
from ergoqp.report.charts.scales import Scale, thinned, words_of

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
        legend: class and name of each line, in order.
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
        bottom, top = (
            self.y.at(float(np.clip(value, self.y.low, self.y.high))) for value in (low, high)
        )
        if bottom - top < 1:
            return
        self._back.append(
            svg.element(
                "rect",
                x=self.left,
                y=top,
                width=self.right - self.left,
                height=bottom - top,
                **attributes,
            )
        )
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
        self._front.append(
            svg.element(
                "path", d=svg.path(self.x(x), self.y(y), steps=steps), class_=f"line {style}"
            )
        )

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
            drawn.append(
                svg.element("line", x1=self.left, x2=self.right, y1=y, y2=y, class_="grid")
            )
            drawn.append(svg.text(words_of(tick), self.left - 8, y + 4, class_="tick end"))
        drawn += time_axis(self.x, self.top, self.bottom, x_label)
        turned = f"rotate(-90 14 {svg.number((self.top + self.bottom) / 2)})"
        drawn.append(
            svg.text(
                y_label, 14, (self.top + self.bottom) / 2, class_="label middle", transform=turned
            )
        )
        return drawn


def time_axis(scale: Scale, top: float, bottom: float, label: str) -> list[str]:
    """Return the horizontal axis below a rectangle: line, ticks, numbers, label with its unit."""
    drawn = [svg.element("line", x1=scale.start, x2=scale.end, y1=bottom, y2=bottom, class_="axis")]
    ends = -np.inf
    for tick in scale.ticks(max(3, min(8, int((scale.end - scale.start) / 60)))):
        x, half = scale.at(tick), width_of(words_of(tick)) / 2
        if x - half < ends + 6:
            continue  # its number would touch the one before
        ends = x + half
        drawn.append(svg.element("line", x1=x, x2=x, y1=top, y2=bottom, class_="grid"))
        drawn.append(svg.element("line", x1=x, x2=x, y1=bottom, y2=bottom + 4, class_="axis"))
        drawn.append(svg.text(words_of(tick), x, bottom + 18, class_="tick middle"))
    drawn.append(svg.text(label, (scale.start + scale.end) / 2, bottom + 36, class_="label middle"))
    return drawn


def _legend(entries: Sequence[tuple[str, str]], left: float, right: float) -> tuple[list[str], int]:
    """Return line samples with their names, wrapped into rows, and the number of rows."""
    drawn: list[str] = []
    x, row = left, 0
    for style, name in entries:
        width = 30 + width_of(name)
        if x > left and x + width > right:
            x, row = left, row + 1
        y = 12 + _LEGEND_ROW * row
        drawn.append(
            svg.element("path", d=f"M{x:.1f} {y:.1f}H{x + 20:.1f}", class_=f"line {style} sample")
        )
        drawn.append(svg.text(name, x + 26, y + 4, class_="small"))
        x += width + 16
    return drawn, row + 1 if entries else 0
