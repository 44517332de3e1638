"""Charts of values over time and of distributions.

Box plots of the predicted or reached values for each true score. The results of the EPFL report are
shown in the same way.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ergoqp.errors import MissingExtraError
from ergoqp.files.atomic import atomic_write
from ergoqp.report import palette
from ergoqp.report.charts import svg
from ergoqp.report.charts.axes import (
    WIDTH,
    Plot,
    changes,
    named_dot,
    padded,
    width_of,
    words_of,
)
from ergoqp.report.page import microseconds

SERIES = ("s0", "s1", "s2", "s3")
"""Classes of lines that differ in their dashes, so they can be distinguished without colour."""


def score_chart(
    time: NDArray[np.float64],
    final: NDArray[np.int64],
    cost: NDArray[np.float64] | None = None,
    marks: Sequence[tuple[float, int, str]] = (),
    *,
    width: float = WIDTH,
) -> str:
    """Draw the score over time on the bands of its action levels.

    Args:
        time: shape (n,) [s].
        final: exact score, 0 without a score; shape (n,).
        cost: smooth cost, shape (n,), or None.
        marks: time [s], score and name of each mark.
        width: width of the chart [px].
    """
    highest = max(8, int(final.max(initial=1)) + 1)
    if cost is not None and np.isfinite(cost).any():
        highest = max(highest, min(16, int(np.ceil(np.nanmax(cost)))))
    legend = [("score", "REBA, exact")]
    if cost is not None:
        legend.append(("cost", "smooth cost of the measured posture"))
    plot = Plot(
        _interval(time),
        (0.5, highest + 0.5),
        "time, s",
        "REBA score",
        legend=legend,
        right=78,
        height=230,
        y_ticks=range(1, highest + 1),
        width=width,
    )
    starts = [*palette.LEVEL_STARTS, highest + 1]
    for level, (low, high) in enumerate(pairwise(starts)):
        if low <= highest:
            risk, top = palette.risk_of_level(level), min(high, highest + 1) - 0.5
            plot.shade(low - 0.5, top, risk, class_=f"level{level} band")
    if cost is not None:
        plot.line(time, cost, "cost")
    held = np.where(final > 0, final, np.nan).astype(float)
    # Only changes are drawn, and the last sample ends the line.
    kept = np.unique(np.append(changes(final), len(final) - 1))
    plot.line(time[kept], held[kept], "score", steps=True)
    for at, score, name in marks:
        x, y = plot.x.at(at), plot.y.at(score)
        plot.add(*named_dot(x, y, 4.5, "dot", f"{name} {score}", plot.right))
    scored = final[final > 0]
    said = (
        f"From {scored[0]} to {scored[-1]}, highest {scored.max()}, lowest {scored.min()}."
        if scored.size
        else "No score."
    )
    return plot.picture("Score over time", said)


def lines_chart(
    title: str,
    time: NDArray[np.float64],
    series: Mapping[str, NDArray[np.float64]],
    y_label: str,
    *,
    from_zero: bool = False,
    width: float = WIDTH,
) -> str:
    """Draw a few series over time.

    Args:
        title: title of the chart.
        time: shape (n,) [s].
        series: name -> values, shape (n,); at most four.
        y_label: label with the unit.
        from_zero: whether the vertical axis starts at zero.
        width: width of the chart [px].
    """
    low, high = padded(np.concatenate(list(series.values())), least=1e-3)
    legend = list(zip(SERIES, series, strict=False)) if len(series) > 1 else []
    ends = (0.0 if from_zero else low, high)
    plot = Plot(_interval(time), ends, "time, s", y_label, legend=legend, width=width)
    for style, values in zip(SERIES, series.values(), strict=False):
        plot.line(time, values, style)
    spans = [f"{name} {_span(values)}" for name, values in series.items()]
    return plot.picture(title, f"{y_label}: {'; '.join(spans)}.")


def timing_chart(step_time: NDArray[np.float64], period: float, *, width: float = WIDTH) -> str:
    """Draw the durations of the control steps as a histogram over a logarithmic axis.

    Args:
        step_time: duration of each step [s], shape (n,).
        period: control period [s].
        width: width of the chart [px].
    """
    lasted = 1e6 * step_time[np.isfinite(step_time) & (step_time > 0)]
    if not lasted.size:
        lasted = np.array([1.0])
    low, high = float(lasted.min()), max(float(lasted.max()), 1e6 * period)
    edges = np.geomspace(low / 1.3, high * 1.3, 61)
    share = 100 * np.histogram(lasted, edges)[0] / lasted.size
    plot = Plot(
        (edges[0], edges[-1]),
        (0.0, 1.25 * float(share.max())),
        "duration of a step, µs",
        "share of steps, %",
        logarithmic=True,
        width=width,
    )
    for (left, right), value in zip(pairwise(plot.x(edges)), share.tolist(), strict=True):
        if value > 0:
            # A single slow step must stay visible.
            height = max(plot.bottom - plot.y.at(value), 1.5)
            broad = right - left - 1
            plot.add(svg.rect(left + 0.5, plot.bottom - height, broad, height, class_="bar"))
    median, p99 = float(np.median(lasted)), float(np.percentile(lasted, 99))
    marks = [("median", median), ("p99", p99), ("max", float(lasted.max()))]
    marks.append(("period", 1e6 * period))
    plot.add(*_vertical_marks(plot, marks))
    said = ", ".join(f"{name} {microseconds(value)}" for name, value in marks)
    return plot.picture("Duration of the control steps", f"{said[0].upper()}{said[1:]}.")


def shares_chart(
    title: str, shares: Mapping[str, float], levels: Sequence[int], *, width: float = WIDTH
) -> str:
    """Draw shares of time as one bar.

    Args:
        title: title of the chart.
        shares: name -> share, 0 to 1.
        levels: colour level of each, -1 for no score.
        width: width of the chart [px].
    """
    drawn: list[str] = []
    x, legend_x, legend_y = 0.0, 0.0, 68.0
    for (name, share), level in zip(shares.items(), levels, strict=True):
        length, words = share * width, f"{100 * share:.0f} %"
        style = f"level{level}" if level >= 0 else "unscored"
        if length > 0:
            what = svg.tooltip(f"{name}: {words}")
            drawn.append(svg.rect(x, 4, length, 36, what, class_=f"{style} edge"))
        if length > width_of(words) + 8:
            ink = f"fill:{palette.ink_of_level(level)}"
            drawn.append(svg.text(words, x + length / 2, 27, class_="middle strong", style=ink))
        x += length
        label = f"{name}, {100 * share:.1f} %"
        if legend_x + 24 + width_of(label) > width:
            legend_x, legend_y = 0.0, legend_y + 22
        drawn.append(svg.rect(legend_x, legend_y - 10, 14, 12, class_=f"{style} edge"))
        drawn.append(svg.text(label, legend_x + 20, legend_y, class_="small"))
        legend_x += 40 + width_of(label)
    said = "; ".join(f"{name} {100 * share:.1f} %" for name, share in shares.items())
    return svg.picture(drawn, width, legend_y + 10, title, f"{said}.")


def _interval(time: NDArray[np.float64]) -> tuple[float, float]:
    low, high = float(time[0]), float(time[-1])
    return (low, high) if high > low else (low - 0.5, low + 0.5)


def _span(values: NDArray[np.float64]) -> str:
    finite = values[np.isfinite(values)]
    if not finite.size:
        return "without values"
    return f"{words_of(finite.min())} to {words_of(finite.max())}"


def _vertical_marks(plot: Plot, marks: Sequence[tuple[str, float]]) -> list[str]:
    """Return vertical lines with their names. A name that would touch an earlier one is lower."""
    lines: list[str] = []
    names: list[str] = []  # in front of all lines, with a halo
    ends: list[float] = []
    for name, value in sorted(marks, key=lambda mark: mark[1]):
        x, words = plot.x.at(value), f"{name} {microseconds(value)}"
        width = width_of(words)
        start = x + 5 if x + 5 + width < plot.right else x - 5 - width
        row = next((i for i, end in enumerate(ends) if start > end + 6), len(ends))
        ends[row:] = [start + width, *ends[row + 1 :]]
        lines.append(svg.line(x, plot.top, x, plot.bottom, "mark"))
        names.append(svg.text(words, start, plot.top + 12 + 16 * row, class_="small halo"))
    return lines + names


def prediction_picture(
    values: NDArray[np.float64], scores: NDArray, title: str, path: Path
) -> None:
    """Write a picture (PNG or SVG) of the predicted values (n,) of the postures of each score (n,).

    The black line is the perfect prediction. Boxes contain the middle half, whiskers reach 1.5
    box lengths, and dots are beyond.

    Raises:
        MissingExtraError: if matplotlib is not installed.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        raise MissingExtraError("the picture of a fit", "learn", "matplotlib") from None
    classes = np.unique(np.round(scores)).astype(int)
    groups = [values[np.round(scores) == score] for score in classes]
    figure = Figure(figsize=(7.0, 4.2), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    ends = classes[[0, -1]]
    axes.plot(ends, ends, color="black", linewidth=1.2, label="perfect", zorder=3)
    axes.boxplot(
        groups,
        positions=classes,
        widths=0.6,
        patch_artist=True,
        manage_ticks=False,
        boxprops={"facecolor": "#cfe0f3", "edgecolor": "#2f5d8c"},
        medianprops={"color": "#b3541e", "linewidth": 1.8},
        whiskerprops={"color": "#2f5d8c"},
        capprops={"color": "#2f5d8c"},
        flierprops={
            "marker": ".",
            "markersize": 3,
            "markerfacecolor": "#8a8a8a",
            "markeredgecolor": "none",
            "alpha": 0.5,
        },
    )
    axes.set_xticks(classes)
    axes.set_xlabel("score of the sheet")
    axes.set_ylabel("predicted, points")
    axes.set_title(title, loc="left", fontsize=11)
    axes.grid(axis="y", color="#e3e3e3", linewidth=0.8)
    axes.set_axisbelow(True)
    axes.legend(frameon=False, loc="upper left")
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    with atomic_write(path) as scratch:
        figure.savefig(scratch)
