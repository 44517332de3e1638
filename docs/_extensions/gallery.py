"""The gallery's pictures, drawn anew by each build of the site."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from sphinx.application import Sphinx

import ergoqp
from ergoqp import reba
from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.joints import INDEX, JOINTS
from ergoqp.rest.best_place import awkward_start
from ergoqp.simulation.people import person_of_kind

TEAL, ORANGE, GREY = "#0f766e", "#c2410c", "#6b7280"


def smooth_score(axes: Any) -> None:
    """Draw the sheet's score and its smooth readings while the trunk bends."""
    angles = np.linspace(-30, 100, 600)
    postures = np.zeros((len(angles), len(JOINTS)))
    postures[:, INDEX["trunk_flexion"]] = np.radians(angles)
    axes.step(angles, reba.assess(postures).final, color=GREY, where="mid", label="the sheet")
    for tau, colour in ((1.5, TEAL), (12.0, ORANGE)):
        cost = SmoothReba(taus_deg=(tau,), weights=(1.0,))
        axes.plot(angles, cost(postures), color=colour, label=f"smooth, tau {tau:g} deg")
    axes.set(xlabel="trunk flexion [deg]", ylabel="REBA score")
    axes.legend(frameon=False)


def closed_loop(axes: Any) -> None:
    """Draw a person's score with the object moved, and left where it was."""
    problem = ergoqp.load_problem("screwing")
    person = person_of_kind("alike", problem, 0)
    start = awkward_start(problem, person, 0)
    run = ergoqp.simulate(problem, start, 12.0, 0)
    axes.step(run.time, run.reba, color=TEAL, where="post", label="the object moves")
    still = run.reba_standing_still
    axes.axhline(still, color=GREY, linestyle="--", label="had the object stayed")
    axes.set(xlabel="time [s]", ylabel="REBA score", ylim=(0, None))
    axes.legend(frameon=False)


def stopping_speed(axes: Any) -> None:
    """Draw the largest speed from which the object stops within a distance, and the naive one."""
    dt, a = 0.01, 0.6
    distance = np.linspace(0, 0.0006, 400)
    knee = a * dt**2
    # As `ergoqp.limits.twist_and_stopping.Braking.fastest`.
    exact = (
        np.sqrt(a * (2 * np.maximum(distance, knee) - knee)) + np.minimum(distance - knee, 0) / dt
    )
    axes.plot(1e3 * distance, 1e3 * np.sqrt(2 * a * distance), color=GREY, label="sqrt(2 a d)")
    axes.plot(1e3 * distance, 1e3 * exact, color=TEAL, label="with periods of 10 ms")
    axes.set(xlabel="distance to a limit [mm]", ylabel="largest speed [mm/s]")
    axes.legend(frameon=False)


PICTURES = {
    "smooth_score": smooth_score,
    "closed_loop": closed_loop,
    "stopping_speed": stopping_speed,
}


def draw(app: Sphinx) -> None:
    """Draw all pictures into ``out/gallery``, beside the sources."""
    folder = Path(app.srcdir).parent / "out" / "gallery"
    folder.mkdir(parents=True, exist_ok=True)
    for name, picture in PICTURES.items():
        figure, axes = plt.subplots(figsize=(7, 3.6), layout="constrained")
        axes.spines[["top", "right"]].set_visible(False)
        picture(axes)
        figure.savefig(folder / f"{name}.svg", metadata={"Date": None})
        plt.close(figure)


def setup(app: Sphinx) -> dict[str, Any]:
    """Draw before anything is read."""
    app.connect("builder-inited", draw)
    return {"parallel_read_safe": True}
