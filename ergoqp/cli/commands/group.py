"""``ergoqp group``: the best fixed place for several people, and what each one pays."""

from __future__ import annotations

from pathlib import Path
from typing import cast, get_args

import numpy as np
from rich.console import Group as Stack
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from ergoqp.arguments import MOST_WHOLE, check_whole
from ergoqp.cli.commands.common import (
    counted,
    load_person_problem,
    make_folder,
    write_report,
    writing,
)
from ergoqp.cli.commands.population import numbers_of
from ergoqp.cli.commands.screen import console, print_assumptions, working
from ergoqp.errors import InputError
from ergoqp.lab.group import MOST_STARTS, GroupOptimum, best_for_group
from ergoqp.lab.group_search import GroupPerson, Objective, drawn_people, read_people
from ergoqp.lab.population import variant
from ergoqp.problem.problem import Problem
from ergoqp.report import palette

FREE = {"none": "nothing", "x": "distance", "y": "side", "z": "height", "tilt": "tilt"}
"""Names of the axes of a grid in tables."""


def group(
    problem_name: str,
    people: str,
    objective: str,
    out: Path | None,
    *,
    hands: str | None,
    load_kg: float | None,
    starts: int,
    seed: int,
    jobs: int,
) -> None:
    """Find the place, print the tables; write ``group.json``, ``group.npz``, ``report.html``.

    Args:
        problem_name: name or path of the problem.
        people: statures [m] separated by commas, or a whole number of people to draw with
            seeds from `seed` on.
        objective: ``"minimax"`` or ``"mean"``.
        out: folder of the results.
        hands: right, left or both; None: as in the problem.
        load_kg: mass of the tool [kg]; None: as in the problem.
        starts: number of places of the grid from which the search continues.
        seed: seed of the people who are drawn.
        jobs: number of processes.

    Raises:
        ErgoqpError: if an argument cannot be used.
    """
    if objective not in get_args(Objective):
        raise InputError(
            f"--objective: got {objective!r}, allowed {', '.join(get_args(Objective))}"
        )
    for name, number, least, most in (
        ("starts", starts, 1, MOST_STARTS),
        ("seed", seed, 0, MOST_WHOLE),
        ("jobs", jobs, 1, MOST_WHOLE),
    ):
        check_whole(name, number, least, most)
    problem = variant(load_person_problem(problem_name), hands=hands, load_kg=load_kg)
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
        lambda path: _write_page(found, problem, crew, path, jobs),
    )


def group_table(found: GroupOptimum) -> RenderableType:
    """Return the result for the terminal: everybody at the place, and gains of adjustable axes."""
    x, y, z = np.round(found.pose[:3, 3], 2) + 0.0
    title = Text(
        f"{found.title}: object at x {x:z.2f}, y {y:z.2f}, z {z:z.2f} m ({found.objective})"
    )
    people = Table(box=None, pad_edge=False)
    for name in ("person", "REBA", "alone", "pays", "risk"):
        people.add_column(name, justify="left" if name in ("person", "risk") else "right")
    for member in found.members:
        level = int(palette.level_of_score(member.reba))
        row = (
            str(member.reba),
            str(member.own_reba),
            str(member.pays),
            palette.risk_of_level(level),
        )
        people.add_row(Text(member.label), *row)
    people.add_row("highest", str(found.maximum), "", "", "")
    people.add_row(
        "mean",
        f"{found.mean:.2f}",
        f"{found.own_mean:.2f}",
        f"{found.mean - found.own_mean:.2f}",
        "",
    )
    free = Table(box=None, pad_edge=False)
    free.add_column("adjustable")
    for name in ("highest", "mean"):
        free.add_column(name, justify="right")
    for axis, (highest, mean) in found.free.items():
        free.add_row(FREE[axis], str(highest), f"{mean:.2f}")
    return Stack(title, people, Text(""), free)


def _people(problem: Problem, people: str, seed: int) -> tuple[GroupPerson, ...]:
    if people.strip().isdecimal():
        return drawn_people(problem, int(people), seed)
    return read_people(
        problem, numbers_of("--people", people, "statures in metres", "or how many people to draw")
    )


def _write_page(
    found: GroupOptimum, problem: Problem, people: tuple[GroupPerson, ...], path: Path, jobs: int
) -> None:
    from ergoqp.report.group_page import write_group_page

    write_group_page(found, problem, people, path, jobs=jobs)
