"""The commands on the method itself: fit, compare, export."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from ergoqp.cli.app import AnyProblem, Guide, app, folder_of, out_option

_ABOUT_FIT = """Learn a cost from labelled postures, test it on unseen ones, and keep it.

Prints a table and writes COST.npz (for [cost.learned] in a problem file, or ergoqp.load_cost) and
COST.png.

\b
Examples:
  ergoqp fit svr                                     10 000 random postures, scored by the sheet
  ergoqp fit gmr --set components=30 --folds 3
  ergoqp fit svr --data forearm                      elbow and wrist of the right arm
  ergoqp fit quadratic --data my_postures.csv        columns trunk_flexion_deg ..., score
  ergoqp fit boundary --joints scored                for [limits.one_class_boundary]
"""

_ABOUT_COMPARE = """Compare QP solvers on the QPs of a problem's control steps.

Records closed loops, derives harder QPs and checks every answer independently. Prints tables and
writes compare.json, compare.png and the QPs as a test set for qpbenchmark.

\b
Examples:
  ergoqp compare screwing
  ergoqp compare low_bin --solvers daqp,piqp --steps 1000
"""

_ABOUT_EXPORT = """Write the control step of a problem as C99.

The folder holds sources, header, CMake file, the QP solver's library and examples.

\b
Examples:
  ergoqp export screwing --out step
  cmake -S step -B step/build && cmake --build step/build && step/build/main
"""


class Joints(StrEnum):
    """The joints of drawn postures."""

    report = "report"
    scored = "scored"


@app.command("fit", help=_ABOUT_FIT, short_help="Learn a cost from labelled postures.")
def _fit(
    cost: Annotated[
        str,
        typer.Argument(
            metavar="COST",
            help="quadratic, gmr, svr, one_class_ladder, neural; or boundary.",
            show_default=False,
        ),
    ],
    data: Annotated[
        str,
        typer.Option(
            "--data",
            metavar="NAME|FILE",
            help="sheet, interval, forearm, or a CSV file of your own.",
        ),
    ] = "sheet",
    joints: Annotated[
        Joints,
        typer.Option(
            "--joints", help="The 20 joints of the EPFL report, or all 22 that the sheet reads."
        ),
    ] = Joints.report,
    per_score: Annotated[
        int,
        typer.Option(
            "--per-score", metavar="N", help="Postures of each score, where data are drawn."
        ),
    ] = 1000,
    seed: Annotated[
        int, typer.Option("--seed", metavar="N", help="Seed of data, folds and fit.")
    ] = 0,
    folds: Annotated[
        int, typer.Option("--folds", metavar="N", help="Folds of the cross-validation.")
    ] = 5,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="NAME=VALUE", help="An option of the cost's own fit; may be repeated."
        ),
    ] = None,
    out: Annotated[Path | None, out_option("fit-COST")] = None,
) -> None:
    if cost == "boundary":
        from ergoqp.cli.commands.fit_boundary import fit_boundary

        fit_boundary(data, joints.value, per_score, seed, folds, settings or [], out)
        return
    from ergoqp.cli.commands.fit import fit

    fit(cost, data, joints.value, per_score, seed, folds, settings or [], out)


@app.command(
    "compare", help=_ABOUT_COMPARE, short_help="Compare QP solvers on the QPs of a problem."
)
def _compare(
    problem: AnyProblem,
    solvers: Annotated[
        str | None,
        typer.Option("--solvers", metavar="A,B", help="Solvers by name [all that are installed]."),
    ] = None,
    steps: Annotated[
        int, typer.Option("--steps", metavar="N", help="Control steps to record.")
    ] = 300,
    seed: Annotated[int, typer.Option("--seed", metavar="N", help="Seed of the closed loops.")] = 0,
    accuracy: Annotated[
        float, typer.Option("--accuracy", metavar="A", help="Accuracy that the solvers are set to.")
    ] = 1e-6,
    out: Annotated[Path | None, out_option("compare-PROBLEM")] = None,
) -> None:
    from ergoqp.cli.commands.compare import run_compare

    run_compare(problem, solvers, steps, seed, accuracy, out)


@app.command("export", help=_ABOUT_EXPORT, short_help="Write the control step of a problem as C99.")
def _export(
    problem: AnyProblem,
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            metavar="DIR",
            parser=folder_of,
            help="Folder for the sources.",
            show_default=False,
        ),
    ],
    dt: Annotated[
        float | None, typer.Option("--dt", metavar="S", help="Control period [the problem's].")
    ] = None,
    guide: Guide = None,
) -> None:
    from ergoqp.cli.commands.export import export

    export(problem, out, dt, guide)
