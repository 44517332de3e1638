"""``ergoqp population``: the best place of each person, over statures, hands and loads."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from rich.table import Table
from rich.text import Text

from ergoqp.cli.common import (
    console,
    counted,
    load_person_problem,
    make_folder,
    print_assumptions,
    working,
    writing,
)
from ergoqp.cli.options import ProblemName, SearchOptions, grouped, option, out_option
from ergoqp.errors import InputError
from ergoqp.files.atomic import atomic_write
from ergoqp.lab.population import Found, best_of_population, population
from ergoqp.report.page import plain
from ergoqp.report.tables import table_of

ABOUT = """Find everybody's own best place, over statures, hands and loads.

Prints a row for each person and writes population.csv.

\b
Examples:
  ergoqp population screwing --statures 1.5,1.7,1.9
  ergoqp population screwing --statures 1.5,1.7,1.9 --hands right,both --loads-kg 0.5,6
"""

COLUMNS = (
    "person",
    "reba_before",
    "reba_best",
    "x_m",
    "y_m",
    "z_m",
    "cost",
    "kkt_residual",
    "starts_at_best",
    "starts",
)
"""Columns of ``population.csv``. The cells of a person without a place are empty."""


@grouped(search=SearchOptions)
def command(
    name: ProblemName,
    statures: Annotated[str, option("M,...", "Statures in metres.")],
    hands: Annotated[str | None, option("NAME,...", "right, left, both [the problem's].")] = None,
    loads_kg: Annotated[str | None, option("KG,...", "Masses of the tool [the problem's].")] = None,
    out: Annotated[Path | None, out_option("population-PROBLEM")] = None,
    scheduler: Annotated[
        str | None,
        option("ADDRESS", "A Dask cluster whose workers take the people [this machine]."),
    ] = None,
    *,
    search: SearchOptions,
) -> None:
    """Find the best place of each person, print the table and write ``population.csv``.

    Raises:
        ErgoqpError: if an argument cannot be used.
    """
    problem = load_person_problem(name)
    search.check()
    loads = None if loads_kg is None else numbers_of("--loads-kg", loads_kg, "kilograms")
    sides = None if hands is None else [side.strip() for side in hands.split(",")]
    people = list(
        population(problem, numbers_of("--statures", statures, "statures in metres"), sides, loads)
    )
    folder = make_folder(out, f"population-{problem.name}")
    effort = (
        f"{counted(len(people), 'person', 'people')},"
        f" {counted(search.starts, 'start', 'starts')} each"
    )
    with writing(folder), working(effort) as done:
        found = best_of_population(people, scheduler=scheduler, progress=done, **asdict(search))
        _write(found, folder / "population.csv")
    screen = console()
    print_assumptions(
        screen, ["Everybody starts at an awkward place of their own, drawn with the seed."]
    )
    screen.print(population_table(problem.title or problem.name, found))
    screen.print(Text(f"{'population.csv':<12} {folder / 'population.csv'}"), soft_wrap=True)


def population_table(title: str, found: Sequence[Found]) -> Table:
    """Return the best place of each person as a table for the terminal."""
    rows = []
    for each in found:
        best = each.optimum
        if best is None:
            rows.append((Text(each.label), "–", "–", Text(each.note)))
            continue
        scores = (str(best.reba_before), str(best.reba_after))
        place = [f"{value:z.2f}" for value in best.pose[:3, 3]]
        at_best = f"{each.starts_at_best} of {len(best.trials)}"
        rows.append((Text(each.label), *scores, *place, plain(best.kkt_residual, 1), at_best))
    head = ("person", "before", "best", "x, m", "y, m", "z, m", "residual", "starts at best")
    return table_of(Text(title), head, rows)


def numbers_of(option: str, text: str, what: str, other: str = "") -> list[float]:
    """Return numbers from a text, separated by commas.

    Raises:
        InputError: if the text is something else.
    """
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        also = f", {other}" if other else ""
        raise InputError(
            f"{option}: got {text!r}, allowed {what} with commas between{also}"
        ) from None


def _write(found: Sequence[Found], path: Path) -> None:
    with atomic_write(path) as scratch, scratch.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for each in found:
            best = each.optimum
            if best is None:
                writer.writerow([each.label, *[""] * (len(COLUMNS) - 1)])
                continue
            place = [f"{value:z.4f}" for value in best.pose[:3, 3]]
            rest = [
                f"{best.cost_after:.4f}",
                f"{best.kkt_residual:.2e}",
                each.starts_at_best,
                len(best.trials),
            ]
            writer.writerow([each.label, best.reba_before, best.reba_after, *place, *rest])
