"""``ergoqp compare``: QP solvers on the QPs of a problem's control steps."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.table import Table
from rich.text import Text

from ergoqp.cli.common import console, make_folder, working, writing
from ergoqp.cli.options import AnyProblem, out_option
from ergoqp.comparison.compare import Comparison, check, compare
from ergoqp.errors import MissingExtraError, install_command
from ergoqp.problem.load import load_problem
from ergoqp.solvers import solver_named
from ergoqp.solvers.session import TOLERANCES, tidy

ABOUT = """Compare QP solvers on the QPs of a problem's control steps.

Records closed loops, derives harder QPs and checks every answer independently. Prints tables and
writes compare.json, compare.png and the QPs as a test set for qpbenchmark.

\b
Examples:
  ergoqp compare screwing
  ergoqp compare low_bin --solvers daqp,piqp --steps 1000
"""


def command(
    name: AnyProblem,
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
    """Record, solve, print the tables; write ``compare.json``, ``compare.png`` and the sequences.

    Raises:
        ErgoqpError: if an argument cannot be used.
    """
    names = (
        None if solvers is None else [name.strip() for name in solvers.split(",") if name.strip()]
    )
    check(names, steps, seed, accuracy)
    problem = load_problem(name)
    screen = console()
    with working(f"recording {steps} steps and solving their QPs") as done:
        found = compare(problem, names, steps, seed, accuracy=accuracy, progress=done)
    folder = make_folder(out, f"compare-{problem.name}")
    note = ""
    with writing(folder):
        try:
            found.save(folder)
        except MissingExtraError as missing:
            note = f"compare.png was not written: {missing}"
    screen.print(_sequences(found))
    screen.print(_exactness(found))
    screen.print(_times(found))
    for name in found.figures:
        faults = [one.fault for one in found.trials if one.solver == name and one.fault]
        if faults:
            words = f"{name} failed {len(faults)} sequences by itself, first with {faults[0]}"
            screen.print(Text(words), soft_wrap=True)
    for name in found.missing:
        command = install_command("solvers")
        screen.print(Text(f"{name} is not installed: `{command}`"), soft_wrap=True)
    if note:
        screen.print(Text(note), soft_wrap=True)
    for name in ("compare.json", "compare.png", "sequences", "ergoqp_sequences.py"):
        if (folder / name).exists():
            screen.print(Text(f"{name:<20} {folder / name}"), soft_wrap=True)


def _sequences(found: Comparison) -> Table:
    table = Table(
        title=f"{found.problem}: the QPs of {found.steps} control steps, seed {found.seed}",
        title_justify="left",
        box=None,
        pad_edge=False,
    )
    table.add_column("sequence")
    for name in ("QPs", "unknowns", "rows", "has answers"):
        table.add_column(name, justify="right", overflow="fold")
    for one in found.sequences:
        table.add_row(
            one.name,
            str(len(one)),
            str(one.size[0]),
            str(one.size[1]),
            "yes" if one.feasible else "no",
        )
    return table


def _exactness(found: Comparison) -> Table:
    table = Table(
        title=f"answers, judged apart; solvers set to {_accuracy(found.accuracy)}",
        title_justify="left",
        box=None,
        pad_edge=False,
    )
    table.add_column("solver", no_wrap=True)
    table.add_column("method")
    columns = (
        "within 0.001",
        "0.000001",
        "0.000000001",
        "wrong: solved",
        "wrong: infeasible",
        "infeasible named",
    )
    for name in columns:
        table.add_column(name, justify="right", overflow="fold")
    for name, one in _sorted(found):
        shares = [_share(one[f"success_{tidy(level)}"]) for level in TOLERANCES]
        wrong = [
            f"{one['wrong_solved'] + one['solved_infeasible']:.0f}",
            f"{one['wrong_infeasible']:.0f}",
        ]
        named = _share(one["infeasible_named"]) if "infeasible_named" in one else "-"
        table.add_row(name, solver_named(name).method, *shares, *wrong, named)
    return table


def _times(found: Comparison) -> Table:
    table = Table(
        title="time of a QP, µs; best = 1 for the mean",
        title_justify="left",
        box=None,
        pad_edge=False,
    )
    table.add_column("solver", no_wrap=True)
    for name in (
        "mean",
        "best = 1",
        "median",
        "95 %",
        "99 %",
        "longest",
        "iterations",
        "warm",
        "warm / cold",
        "iterations",
    ):
        table.add_column(name, justify="right", overflow="fold")
    for name, one in _sorted(found):
        times = [f"{one[key]:.0f}" for key in ("p50_us", "p95_us", "p99_us", "max_us")]
        warm = (
            [f"{one['warm_us']:.0f}", f"{one['warm_ratio']:.2f}"]
            if "warm_us" in one
            else ["-", "-"]
        )
        ratio = f"{one['warm_iterations_ratio']:.2f}" if "warm_iterations_ratio" in one else "-"
        count = f"{one['iterations']:.1f}" if "iterations" in one else "-"
        table.add_row(
            name, f"{one['sgm_us']:.0f}", f"{one['sgm_time']:.1f}", *times, count, *warm, ratio
        )
    return table


def _accuracy(value: float) -> str:
    return np.format_float_positional(value, trim="-")


def _share(value: float) -> str:
    # 99.98 % must not be shown as 100 %.
    return "100 %" if value == 1 else f"{min(100 * value, 99.9):.1f} %"


def _sorted(found: Comparison) -> list[tuple[str, dict[str, float]]]:
    return sorted(found.figures.items(), key=lambda item: item[1]["sgm_us"])
