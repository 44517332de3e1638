"""``ergoqp optimise``: the best place of the object for a person and a task, offline."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated

import numpy as np
from rich.table import Table
from rich.text import Text

from ergoqp.cli.common import (
    console,
    counted,
    load_person_problem,
    make_folder,
    print_assumptions,
    score_words,
    working,
    write_report,
    writing,
)
from ergoqp.cli.options import (
    At,
    ProblemName,
    RecordingOptions,
    SearchOptions,
    grouped,
    option,
    out_option,
)
from ergoqp.cli.run import frame_of_recording
from ergoqp.human import Body
from ergoqp.placing.optimise import follower_of, optimise
from ergoqp.placing.optimum import Optimum
from ergoqp.problem.problem import Problem
from ergoqp.report.optimum_page import write_optimum_page
from ergoqp.report.page import plain
from ergoqp.report.tables import table_of

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
        Path | None, option("RECORDING", "Start with posture and person of a recording.", "--from")
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
    posture, body, notes = _who(problem, recording, at, read)
    folder = make_folder(out, f"optimise-{problem.name}")
    person = follower_of(problem, body)

    def found_by(search: SearchOptions, posture: np.ndarray | None) -> Optimum:
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
        found = [found_by(search, posture)]
        if search.mode == "stackelberg":
            bound = replace(search, mode="cooperative")
            found.append(found_by(bound, found[0].posture_before))
        found[0].save(folder)
    print_assumptions(screen, list(found[0].assumptions))
    screen.print(optimum_table(problem, found))
    bound = found[1] if len(found) > 1 else None
    write_report(
        screen,
        folder,
        ("optimum.json",),
        lambda path: write_optimum_page(
            found[0], problem, path, cooperative=bound, person=person, jobs=search.jobs
        ),
    )


def _who(
    problem: Problem, recording_path: Path | None, at: float | None, read: RecordingOptions
) -> tuple[np.ndarray | None, Body | None, list[str]]:
    """Return the posture, the body of the person, and the assumptions."""
    if recording_path is None:
        read.refuse_without_recording(at)
        return None, read.body, []
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
    postures = [first.posture_before, *(optimum.posture for optimum in found)]
    costs = [first.cost_before, *(optimum.cost_after for optimum in found)]
    poses = [first.pose_before, *(optimum.pose for optimum in found)]
    ends = [[trial.reba for trial in optimum.trials] for optimum in found]
    at_best = [
        f"{scores.count(optimum.reba_after)} of {len(scores)}"
        for scores, optimum in zip(ends, found, strict=True)
    ]
    rows = [
        ("REBA", *(score_words(problem, posture) for posture in postures)),
        ("smooth cost, points", *(f"{cost:.2f}" for cost in costs)),
        ("object x, y, z, m", *(_vector(pose[:3, 3]) for pose in poses)),
        ("tool axis", *(_vector(pose[:3, 0]) for pose in poses)),
        ("optimality residual", "", *(plain(each.kkt_residual, 1) for each in found)),
        ("starts that end at this score", "", *at_best),
    ]
    head = ("", "now", *(NAMES[optimum.mode] for optimum in found))
    return table_of(Text(first.title), head, rows, framed=True)


def _vector(values: np.ndarray) -> str:
    return ", ".join(f"{value:z.2f}" for value in values)
