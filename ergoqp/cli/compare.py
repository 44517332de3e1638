"""``ergoqp compare``: QP solvers on the QPs of a problem's control steps."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
from rich.table import Table
from rich.text import Text

from ergoqp.cli.common import console, make_folder, working, writing
from ergoqp.cli.options import AnyProblem, option, out_option
from ergoqp.comparison.compare import Comparison, check, compare
from ergoqp.errors import MissingExtraError, install_command
from ergoqp.problem.load import load_problem
from ergoqp.report.tables import table_of
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
        str | None, option("A,B", "Solvers by name [all that are installed].")
    ] = None,
    steps: Annotated[int, option("N", "Control steps to record.")] = 300,
    seed: Annotated[int, option("N", "Seed of the closed loops.")] = 0,
    accuracy: Annotated[float, option("A", "Accuracy that the solvers are set to.")] = 1e-6,
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
    rows = [
        (one.name, str(len(one)), *map(str, one.size), "yes" if one.feasible else "no")
        for one in found.sequences
    ]
    title = f"{found.problem}: the QPs of {found.steps} control steps, seed {found.seed}"
    head = ("sequence", "QPs", "unknowns", "rows", "has answers")
    return table_of(title, head, rows, overflow="fold")


def _exactness(found: Comparison) -> Table:
    rows = []
    for name, one in _sorted(found):
        shares = [_share(one[f"success_{tidy(level)}"]) for level in TOLERANCES]
        wrong = one["wrong_solved"] + one["solved_infeasible"], one["wrong_infeasible"]
        counts = [f"{count:.0f}" for count in wrong]
        named = _share(one["infeasible_named"]) if "infeasible_named" in one else "-"
        rows.append((name, solver_named(name).method, *shares, *counts, named))
    accuracy = np.format_float_positional(found.accuracy, trim="-")
    title = f"answers, judged apart; solvers set to {accuracy}"
    head = ("solver", "method", "within 0.001", "0.000001", "0.000000001")
    head += ("wrong: solved", "wrong: infeasible", "infeasible named")
    table = table_of(title, head, rows, words=(0, 1), overflow="fold")
    table.columns[0].no_wrap = True
    return table


def _times(found: Comparison) -> Table:
    columns = (
        ("mean", "sgm_us", 0),
        ("best = 1", "sgm_time", 1),
        ("median", "p50_us", 0),
        ("95 %", "p95_us", 0),
        ("99 %", "p99_us", 0),
        ("longest", "max_us", 0),
        ("iterations", "iterations", 1),
        ("warm", "warm_us", 0),
        ("warm / cold", "warm_ratio", 2),
        ("iterations", "warm_iterations_ratio", 2),
    )
    rows = [
        (name, *(f"{one[key]:.{n}f}" if key in one else "-" for _, key, n in columns))
        for name, one in _sorted(found)
    ]
    title = "time of a QP, µs; best = 1 for the mean"
    head = ("solver", *(name for name, _, _ in columns))
    table = table_of(title, head, rows, overflow="fold")
    table.columns[0].no_wrap = True
    return table


def _share(value: float) -> str:
    # 99.98 % must not be shown as 100 %.
    return "100 %" if value == 1 else f"{min(100 * value, 99.9):.1f} %"


def _sorted(found: Comparison) -> list[tuple[str, dict[str, float]]]:
    return sorted(found.figures.items(), key=lambda item: item[1]["sgm_us"])
