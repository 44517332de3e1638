"""What all notebooks share: how big they are, how they look, and the box plots of the EPFL report.

The environment variable ``ERGOQP_NOTEBOOK_SIZE=small`` makes every notebook a quick trial of
itself: same code, fewer points, no files written.
"""

from __future__ import annotations

import io
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

import matplotlib as mpl
import numpy as np
from cycler import cycler
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray
from PIL import Image

FULL = os.environ.get("ERGOQP_NOTEBOOK_SIZE", "full") != "small"
"""The notebook runs at full size."""

FIGURES = Path(__file__).resolve().parent / "figures"
"""Where figures are kept as files."""

BLUE, ORANGE, GREEN, RED = "#0072b2", "#e69f00", "#009e73", "#d55e00"
PURPLE, SKY, GREY = "#cc79a7", "#56b4e9", "#6e6e6e"
"""Okabe and Ito's colours, which the colour-blind tell apart, and a grey."""

Size = TypeVar("Size")

STYLE: dict[Any, Any] = {
    "figure.dpi": 90,
    "savefig.dpi": 90,
    "figure.constrained_layout.use": True,
    "font.size": 10,
    "axes.titlesize": 10.5,
    "axes.titlelocation": "left",
    "axes.prop_cycle": cycler(color=[BLUE, ORANGE, GREEN, RED, PURPLE, SKY, GREY]),
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e3e3e3",
    "grid.linewidth": 0.7,
    "lines.linewidth": 1.7,
    "legend.frameon": False,
    "legend.fontsize": 9,
}
"""One look for all figures."""


def size(small: Size, full: Size) -> Size:
    """Return what fits the size of this run."""
    return full if FULL else small


def save(figure: Figure, name: str) -> None:
    """Keep a figure as ``figures/NAME.png`` (at full size only).

    A notebook also shows it below the cell.

    Args:
        figure: to keep.
        name: of the file, for example ``"fig03_gmr_cosine"``.
    """
    if FULL:
        FIGURES.mkdir(exist_ok=True)
        picture = io.BytesIO()
        figure.savefig(picture, format="png", metadata={"Software": None})
        (FIGURES / f"{name}.png").write_bytes(few_colours(picture.getvalue()))
    if not _in_notebook():
        plt.close(figure)


def few_colours(picture: bytes) -> bytes:
    """Return a PNG with a palette of 128 colours: enough for plots, in a third of the room."""
    kept = io.BytesIO()
    Image.open(io.BytesIO(picture)).convert("RGB").quantize(128).save(kept, "png", optimize=True)
    return kept.getvalue()


def boxes(
    axes: Axes,
    groups: Sequence[ArrayLike],
    positions: ArrayLike,
    *,
    colour: str = BLUE,
    width: float = 0.6,
    label: str | None = None,
) -> None:
    """Draw one box per group: the middle half, the median, whiskers and outliers.

    Whiskers reach to 1.5 box lengths, outliers are red dots.

    Args:
        axes: to draw in.
        groups: values of each group.
        positions: of the boxes, one per group.
        colour: of the boxes.
        width: of a box.
        label: in the legend.
    """
    drawn = axes.boxplot(
        [np.asarray(group, dtype=float) for group in groups],
        positions=np.asarray(positions, dtype=float),
        widths=width,
        patch_artist=True,
        manage_ticks=False,
        boxprops={"facecolor": to_rgba(colour, 0.22), "edgecolor": colour},
        medianprops={"color": colour, "linewidth": 2.4},
        whiskerprops={"color": colour},
        capprops={"color": colour},
        flierprops={
            "marker": ".",
            "markersize": 4,
            "markerfacecolor": RED,
            "markeredgecolor": "none",
            "alpha": 0.55,
        },
    )
    if label is not None:
        drawn["boxes"][0].set_label(label)


def boxes_by_score(
    axes: Axes,
    scores: NDArray,
    values: NDArray,
    *,
    colour: str = BLUE,
    line: str | None = None,
    xlabel: str = "score of the start",
    ylabel: str = "score at the end",
) -> None:
    """Draw the values of the points of each score as one box.

    They are predictions, or where descents from there ended.

    Args:
        axes: to draw in.
        scores: of the points (n,): what they are grouped by.
        values: of the points (n,).
        colour: of the boxes.
        line: name in the legend of a black line "value = score"; None: no line.
        xlabel: name of the axis of scores.
        ylabel: name of the axis of values.
    """
    classes = np.unique(scores)
    if line is not None:
        axes.plot(
            classes[[0, -1]], classes[[0, -1]], color="black", linewidth=1.1, label=line, zorder=1
        )
        axes.legend(loc="upper left")
    boxes(axes, [values[scores == score] for score in classes], classes, colour=colour)
    axes.set_xticks(classes)
    axes.set_xlabel(xlabel)
    axes.set_ylabel(ylabel)


def table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Print a table with aligned columns; numbers with a decimal point get two decimals."""
    texts = [
        [f"{cell:.2f}" if isinstance(cell, (float, np.floating)) else str(cell) for cell in row]
        for row in rows
    ]
    widths = [max(len(row[i]) for row in [list(header), *texts]) for i in range(len(header))]
    for row in [list(header), ["-" * width for width in widths], *texts]:
        first, *rest = (
            cell.ljust(width) if i == 0 else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        print("  ".join([first, *rest]).rstrip())


def _in_notebook() -> bool:
    try:
        return get_ipython() is not None  # type: ignore[name-defined]
    except NameError:
        return False


if not _in_notebook():
    mpl.use("Agg")  # a script shows nothing
mpl.rcParams.update(STYLE)
