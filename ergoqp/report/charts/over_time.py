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
from ergoqp.report.between import around
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
    ends: tuple[NDArray[np.int64], NDArray[np.int64]] | None = None,
    width: float = WIDTH,
) -> str:
    """Draw the score over time on the bands of its action levels.

    Args:
        time: shape (n,) [s].
        final: score by the sheet, 0 without a score; shape (n,).
        cost: smooth cost, shape (n,), or None.
        marks: time [s], score and name of each mark.
        ends: lowest and highest score, shape (n,) each, if `final` is the likeliest.
        width: width of the chart [px].
    """
    top = final if ends is None else ends[1]
    highest = max(8, int(top.max(initial=1)) + 1)
    if cost is not None and np.isfinite(cost).any():
        highest = max(highest, min(16, int(np.ceil(np.nanmax(cost)))))
    legend = [("score", "REBA")]
    if ends is not None:
        legend = [("score", "REBA, likeliest posture"), ("span", "lowest to highest")]
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
    if ends is not None:
        plot.area(time, *ends, "span")
    if cost is not None:
        plot.line(time, cost, "cost")
    held = np.where(final > 0, final, np.nan).astype(float)
    # Only changes are drawn, and the last sample ends the line.
    kept = np.unique(np.append(changes(final), len(final) - 1))
    plot.line(time[kept], held[kept], "score", steps=True)
    for at, score, name in marks:
        x, y, words = plot.x.at(at), plot.y.at(score), str(score)
        if ends is not None:
            low, high = (int(end[np.searchsorted(time, at)]) for end in ends)
            words = around(score, low, high)
        plot.add(*named_dot(x, y, 4.5, "dot", f"{name} {words}", plot.right))
    scored = final[final > 0]
    said = (
        f"From {scored[0]} to {scored[-1]}, highest {scored.max()}, lowest {scored.min()}."
        if scored.size
        else "No score."
    )
    if ends is not None and scored.size:
        said += f" It may be {ends[0][final > 0].min()} to {ends[1].max()}."
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
    title: str,
    bars: Mapping[str, Mapping[str, float]],
    levels: Sequence[int],
    *,
    width: float = WIDTH,
) -> str:
    """Draw shares of time as one bar, or as several below their names.

    Args:
        title: title of the chart.
        bars: name of the bar -> name -> share, 0 to 1; a single bar's name is not shown.
        levels: colour level of each share, -1 for no score.
        width: width of the chart [px].
    """
    drawn: list[str] = []
    several = len(bars) > 1
    y = 0.0
    for bar, shares in bars.items():
        if several:
            drawn.append(svg.text(bar, 0, y + 14, class_="small"))
            y += 18
        drawn += _bar(shares, levels, y + 4, width)
        y += 46 if several else 42
    x, y = 0.0, y + (14 if several else 26)
    for name, level in zip(next(iter(bars.values())), levels, strict=True):
        percents = [f"{100 * shares[name]:.1f} %" for shares in bars.values()]
        label = name if several else f"{name}, {percents[0]}"
        if x + 24 + width_of(label) > width:
            x, y = 0.0, y + 22
        drawn.append(svg.rect(x, y - 10, 14, 12, class_=f"{_style(level)} edge"))
        drawn.append(svg.text(label, x + 20, y, class_="small"))
        x += 40 + width_of(label)
    said = [
        "; ".join(f"{name} {100 * share:.1f} %" for name, share in shares.items())
        for shares in bars.values()
    ]
    words = [f"{bar}: {each}." for bar, each in zip(bars, said, strict=True)]
    return svg.picture(drawn, width, y + 10, title, " ".join(words) if several else f"{said[0]}.")


def _bar(shares: Mapping[str, float], levels: Sequence[int], y: float, width: float) -> list[str]:
    """Return shares as stretches of a bar at a height [px]."""
    drawn, x = [], 0.0
    for (name, share), level in zip(shares.items(), levels, strict=True):
        length, words = share * width, f"{100 * share:.0f} %"
        if length > 0:
            what = svg.tooltip(f"{name}: {words}")
            drawn.append(svg.rect(x, y, length, 36, what, class_=f"{_style(level)} edge"))
        if length > width_of(words) + 8:
            ink = f"fill:{palette.ink_of_level(level)}"
            drawn.append(svg.text(words, x + length / 2, y + 23, class_="middle strong", style=ink))
        x += length
    return drawn


def _style(level: int) -> str:
    return f"level{level}" if level >= 0 else "unscored"


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
