"""``ergoqp group``: the best fixed place for several people, and what each one pays."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, cast, get_args

import numpy as np
from rich.console import Group as Stack
from rich.console import RenderableType
from rich.text import Text

from ergoqp.arguments import check_whole, check_word
from ergoqp.cli.common import (
    console,
    counted,
    load_person_problem,
    make_folder,
    print_assumptions,
    working,
    write_report,
    writing,
)
from ergoqp.cli.options import Jobs, ProblemName, Starts, option, out_option
from ergoqp.cli.population import numbers_of
from ergoqp.lab.group import MOST_STARTS, GroupOptimum, best_for_group
from ergoqp.lab.group_search import GroupPerson, Objective, drawn_people, read_people
from ergoqp.lab.population import variant
from ergoqp.problem.problem import Problem
from ergoqp.report import palette
from ergoqp.report.group_page import write_group_page
from ergoqp.report.tables import table_of

ABOUT = """Find the one fixed place of the object that is best for several people.

Prints how much worse it is than everybody's own best place and what an adjustable place would
save. Writes group.json, group.npz and report.html.

\b
Examples:
  ergoqp group desk --people 1.55,1.65,1.75,1.85      people of these statures
  ergoqp group desk --people 12 --seed 3              twelve random people
  ergoqp group overhead --people 1.6,1.9 --objective mean --hands both --load-kg 2
"""

FREE = {"none": "nothing", "x": "distance", "y": "side", "z": "height", "tilt": "tilt"}
"""Names of the axes of a grid in tables."""


def command(
    name: ProblemName,
    people: Annotated[
        str, option("M,...|N", "Statures in metres, or the number of people to draw.")
    ],
    objective: Annotated[str, option("NAME", "minimax or mean of the exact scores.")] = "minimax",
    hands: Annotated[str | None, option("NAME", "right, left or both [the problem's].")] = None,
    load_kg: Annotated[float | None, option("KG", "Mass of the tool [the problem's].")] = None,
    starts: Starts = 4,
    jobs: Jobs = 1,
    seed: Annotated[int, option("N", "Seed of the first person that is drawn.")] = 0,
    out: Annotated[Path | None, out_option("group-PROBLEM")] = None,
) -> None:
    """Find the place, print the tables; write ``group.json``, ``group.npz``, ``report.html``.

    Raises:
        ErgoqpError: if an argument cannot be used.
    """
    check_word("--objective", objective, get_args(Objective))
    check_whole("starts", starts, 1, MOST_STARTS)
    check_whole("seed", seed, 0)
    check_whole("jobs", jobs, 1)
    problem = variant(load_person_problem(name), hands=hands, load_kg=load_kg)
    crew = _people(problem, people, seed)
    folder = make_folder(out, f"group-{problem.name}")
    with working(f"one place for {counted(len(crew), 'person', 'people')}") as done:
        found = best_for_group(
            problem,
            crew,
            cast(Objective, objective),
            starts=starts,
            jobs=jobs,
            progress=done,
        )
    with writing(folder):
        found.save(folder)
    screen = console()
    print_assumptions(screen, found.assumptions)
    screen.print(group_table(found))
    write_report(
        screen,
        folder,
        ("group.json", "group.npz"),
        lambda path: write_group_page(found, problem, crew, path, jobs=jobs),
    )


def group_table(found: GroupOptimum) -> RenderableType:
    """Return the result for the terminal: everybody at the place, and gains of adjustable axes."""
    x, y, z = np.round(found.pose[:3, 3], 2) + 0.0
    title = Text(
        f"{found.title}: object at x {x:z.2f}, y {y:z.2f}, z {z:z.2f} m ({found.objective})"
    )
    people = [
        (Text(m.label), str(m.reba), str(m.own_reba), str(m.pays), palette.risk_of_score(m.reba))
        for m in found.members
    ]
    means = [f"{mean:.2f}" for mean in (found.mean, found.own_mean, found.mean - found.own_mean)]
    people += [("highest", str(found.maximum)), ("mean", *means)]
    free = [
        (FREE[axis], str(highest), f"{mean:.2f}") for axis, (highest, mean) in found.free.items()
    ]
    return Stack(
        title,
        table_of(None, ("person", "REBA", "alone", "pays", "risk"), people, words=(0, 4)),
        Text(""),
        table_of(None, ("adjustable", "highest", "mean"), free),
    )


def _people(problem: Problem, people: str, seed: int) -> tuple[GroupPerson, ...]:
    if people.strip().isdecimal():
        return drawn_people(problem, int(people), seed)
    return read_people(
        problem, numbers_of("--people", people, "statures in metres", "or how many people to draw")
    )
