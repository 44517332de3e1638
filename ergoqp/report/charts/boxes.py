"""Box plots of the predicted or reached values for each true score.

The results of the EPFL report are shown in the same way.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ergoqp.errors import MissingExtraError
from ergoqp.files.whole import whole


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
    axes.plot(
        classes[[0, -1]], classes[[0, -1]], color="black", linewidth=1.2, label="perfect", zorder=3
    )
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
    with whole(path) as scratch:
        figure.savefig(scratch)
