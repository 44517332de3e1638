"""Picture of a comparison: the times of each solver and the accuracy of its answers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ergoqp.comparison.trial import SolverTrial
from ergoqp.errors import MissingExtraError
from ergoqp.files.atomic import whole
from ergoqp.solvers import solver_named
from ergoqp.solvers.session import TOLERANCES

_COLD, _WARM, _LATE = "#2f5d8c", "#dd6b20", "#b9bec6"
_LEAST = 1e-16


def comparison_picture(
    title: str, names: Sequence[str], trials: Sequence[SolverTrial], accuracy: float, path: Path
) -> None:
    """Draw the picture of a comparison, and write it (PNG or SVG).

    Left: the times of the recorded QPs, a dot each, cold above warm, with the median as a line; QPs
    not solved to the accuracy are crosses. Right: the share of all QPs with an answer whose largest
    residual is at most the value on the axis.

    Args:
        title: title of the picture.
        names: names of the solvers, from top to bottom.
        trials: every solver on every sequence.
        accuracy: accuracy that the solvers were set to.
        path: path of the file.

    Raises:
        MissingExtraError: if matplotlib is not installed.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        raise MissingExtraError("the picture of a comparison", "solvers", "matplotlib") from None
    figure = Figure(figsize=(11.0, 1.6 + 0.42 * len(names)), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    times, residuals = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
    _draw_times(times, names, trials, accuracy)
    _draw_residuals(residuals, names, trials)
    for axes in (times, residuals):
        axes.grid(axis="x", color="#e3e3e3", linewidth=0.8)
        axes.set_axisbelow(True)
        for side in ("top", "right"):
            axes.spines[side].set_visible(False)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    with whole(path) as scratch:
        figure.savefig(scratch)


def _draw_times(
    axes: Any, names: Sequence[str], trials: Sequence[SolverTrial], accuracy: float
) -> None:
    rng = np.random.default_rng(0)
    for place, name in enumerate(names):
        kinds = (
            ((False, _COLD, 0.18), (True, _WARM, -0.18))
            if solver_named(name).warm
            else ((False, _COLD, 0.0),)
        )
        for warm, colour, above in kinds:
            its = [
                one
                for one in trials
                if one.solver == name and one.warm == warm and one.sequence.follows
            ]
            micros = 1e6 * np.concatenate([one.seconds for one in its])
            good = np.concatenate([one.success(accuracy) for one in its])
            height = -place + above + rng.uniform(-0.11, 0.11, len(micros))
            axes.scatter(
                micros[good],
                height[good],
                s=4,
                color=colour,
                alpha=0.35,
                linewidths=0,
                rasterized=True,
            )
            axes.scatter(
                micros[~good],
                height[~good],
                s=8,
                color=_LATE,
                marker="x",
                linewidths=0.7,
                rasterized=True,
            )
            median = np.median(micros)
            axes.plot(
                [median, median],
                [-place + above - 0.15, -place + above + 0.15],
                color=colour,
                linewidth=2.4,
            )
    for colour, label in ((_COLD, "cold"), (_WARM, "warm")):
        axes.plot([], [], color=colour, linewidth=2.4, label=label)
    axes.scatter([], [], s=14, color=_LATE, marker="x", label="not solved")
    axes.set_xscale("log")
    axes.set_yticks([-place for place in range(len(names))], names)
    axes.set_ylim(-len(names) + 0.4, 0.6)
    axes.set_xlabel("time of a recorded QP, µs (lines: medians)")
    axes.legend(
        frameon=False,
        ncols=3,
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        fontsize=9,
        handletextpad=0.4,
    )


def _draw_residuals(axes: Any, names: Sequence[str], trials: Sequence[SolverTrial]) -> None:
    from matplotlib import colormaps

    colour: Callable[[int], Any] = colormaps["tab10"]
    for place, name in enumerate(names):
        its = [one for one in trials if one.solver == name and one.sequence.feasible]
        worst = np.sort(np.concatenate([np.maximum(one.worst, _LEAST) for one in its]))
        share = np.arange(1, len(worst) + 1) / len(worst)
        there = np.isfinite(worst)
        x = np.concatenate([worst[there], [1e3]])
        y = np.concatenate([share[there], [share[there][-1] if there.any() else 0.0]])
        style = ("-", "--")[place % 2]
        axes.step(
            x, 100 * y, style, where="post", color=colour(place % 10), linewidth=1.6, label=name
        )
    for tolerance in TOLERANCES:
        axes.axvline(tolerance, color="#8a8a8a", linewidth=0.8, linestyle=(0, (2, 3)))
    axes.set_xscale("log")
    axes.set_xlim(_LEAST, 1.0)
    axes.set_ylim(0, 101)
    axes.set_xlabel("largest residual of an answer")
    axes.set_ylabel("QPs that have an answer, %")
    axes.legend(frameon=False, fontsize=8.5, loc="center left", bbox_to_anchor=(1.0, 0.5))
