"""``ergoqp optimise``: the best place of the object for a person and a task, offline."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.table import Table
from rich.text import Text

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
from ergoqp.cli.options import At, ProblemName, RecordingOptions, SearchOptions, grouped, out_option
from ergoqp.cli.run import frame_of_recording
from ergoqp.human import Body
from ergoqp.human.person_file import given_person
from ergoqp.placing.optimise import optimise
from ergoqp.placing.optimum import Optimum
from ergoqp.problem.problem import Problem
from ergoqp.report.optimum_page import write_optimum_page
from ergoqp.report.page import plain
from ergoqp.sheets.reba import ACTION_LEVELS

ABOUT = """Find the best place of the object for one person, offline.

Prints a table and writes optimum.json and report.html. The bound is what would be possible if the
person also chose the posture.

\b
Examples:
  ergoqp optimise screwing
  ergoqp optimise screwing --from take.bvh --jobs 2   for the person of a recording
  ergoqp optimise my_task.toml --starts 200 --jobs 4
"""

NAMES = {"stackelberg": "the person comes to rest", "cooperative": "the posture chosen too"}
"""Names of the modes in the table."""


@grouped(search=SearchOptions, read=RecordingOptions)
def command(
    name: ProblemName,
    recording: Annotated[
        Path | None,
        typer.Option(
            "--from", metavar="RECORDING", help="Start with posture and person of a recording."
        ),
    ] = None,
    at: At = None,
    out: Annotated[Path | None, out_option("optimise-PROBLEM")] = None,
    *,
    search: SearchOptions,
    read: RecordingOptions,
) -> None:
    """Find the best place, print the table, and write ``optimum.json`` and the page.

    Raises:
        ErgoqpError: if an argument cannot be used.
    """
    problem = load_person_problem(name)
    search.check()
    posture, person, notes = _who(problem, recording, at, read)
    folder = make_folder(out, f"optimise-{problem.name}")

    def found_by(search: SearchOptions) -> Optimum:
        effort = f"{counted(search.starts, 'start', 'starts')}, {NAMES[search.mode]}"
        with working(effort) as done:
            return optimise(
                problem,
                posture,
                person=person,
                assumptions=notes,
                progress=done,
                **asdict(search),
            )

    screen = console()
    with writing(folder):
        found = [found_by(search)]
        if search.mode == "stackelberg":
            found.append(found_by(replace(search, mode="cooperative")))
        found[0].save(folder)
    print_assumptions(screen, list(found[0].assumptions))
    screen.print(optimum_table(problem, found))
    bound = found[1] if len(found) > 1 else None
    write_report(
        screen,
        folder,
        ("optimum.json",),
        lambda path: write_optimum_page(
            found[0], problem, path, cooperative=bound, jobs=search.jobs
        ),
    )


def _who(
    problem: Problem, recording_path: Path | None, at: float | None, read: RecordingOptions
) -> tuple[np.ndarray | None, Body | None, list[str]]:
    """Return the posture, the body of the person, and the assumptions."""
    if recording_path is None:
        read.refuse_without_recording(at)
        return (
            None,
            None if read.person_value is None else given_person(read.person_value),
            [],
        )
    with working(f"reading {recording_path.name}"):
        recording = read.load(recording_path)
    frame = frame_of_recording(problem, recording, at)
    time = float(recording.time[frame])
    which = "the worst-scored frame" if at is None else "frame"
    note = (
        f"The posture now is that of {which}, {frame}, at {time:.2f} s, of {recording_path.name};"
        " the body is the one in it."
    )
    return recording.postures[frame], recording.person, [*recording.assumptions, note]


def optimum_table(problem: Problem, found: list[Optimum]) -> Table:
    """Return the optima of one or more modes side by side.

    Args:
        problem: the task.
        found: optima of the same problem and person; the first also gives the start.
    """
    first = found[0]
    table = Table(title=Text(first.title), title_justify="left")
    for name in ("", "now", *(NAMES[optimum.mode] for optimum in found)):
        table.add_column(name, justify="right" if name else "left")
    postures = [first.posture_before, *(optimum.posture for optimum in found)]
    table.add_row("REBA", *(_level(problem, posture) for posture in postures))
    table.add_row(
        "smooth cost, points",
        f"{first.cost_before:.2f}",
        *(f"{optimum.cost_after:.2f}" for optimum in found),
    )
    poses = [first.pose_before, *(optimum.pose for optimum in found)]
    table.add_row(
        "object x, y, z, m",
        *(", ".join(f"{value:z.2f}" for value in pose[:3, 3]) for pose in poses),
    )
    table.add_row(
        "tool axis", *(", ".join(f"{value:z.2f}" for value in pose[:3, 0]) for pose in poses)
    )
    table.add_row("optimality residual", "", *(plain(each.kkt_residual, 1) for each in found))
    reached = [
        sum(trial.reba == optimum.reba_after for trial in optimum.trials) for optimum in found
    ]
    starts = [
        f"{count} of {len(optimum.trials)}" for count, optimum in zip(reached, found, strict=True)
    ]
    table.add_row("starts that end at this score", "", *starts)
    return table


def _level(problem: Problem, posture: np.ndarray) -> str:
    """Return the score of a posture with its action level in words."""
    assessment = problem.assess(posture)
    return f"{assessment.final[0]}, {ACTION_LEVELS[assessment.band[0]]} risk"
