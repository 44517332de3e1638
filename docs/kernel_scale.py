"""Draw the time of a step against the number of support vectors.

Run ``python docs/kernel_scale.py FIGURES.json``.

The figures are those that ``python -m benchmarks.kernel_scale --full --json FIGURES.json`` wrote.
"""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

PICTURE = Path(__file__).resolve().parent / "images" / "kernel_scale.png"
LINES = (
    ("us", "#0072b2", "o-", "whole control step, median"),
    ("cost_us", "#e69f00", "s-", "value and gradient alone"),
    ("sklearn_us", "#6e6e6e", "^:", "scikit-learn, value alone"),
)


def draw(figures: dict[str, float], path: Path) -> None:
    """Write the picture."""
    figure = Figure(figsize=(7.0, 4.0), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for name, colour, style, label in LINES:
        points = sorted(
            (int(found[1]), value)
            for key, value in figures.items()
            if (found := re.fullmatch(rf"{name}_(\d+)", key))
        )
        axes.plot(
            *zip(*points, strict=True),
            style,
            color=colour,
            label=label,
            linewidth=1.6,
            markersize=4.5,
        )
    smooth = figures["us_smooth_reba"]
    axes.axhline(
        smooth,
        color="#009e73",
        linewidth=1.2,
        linestyle="--",
        label="whole step, smooth score of the sheet",
    )
    axes.set(xscale="log", yscale="log", xlabel="support vectors (20 joints)", ylabel="time, µs")
    axes.grid(color="#e3e3e3", linewidth=0.7)
    axes.set_axisbelow(True)
    axes.legend(frameon=False)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    figure.savefig(path, metadata={"Software": None})


if __name__ == "__main__":
    draw(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")), PICTURE)
