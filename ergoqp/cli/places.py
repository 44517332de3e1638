"""The commands that search for the best place of the object: optimise, group, population."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ergoqp.cli.app import (
    At,
    Columns,
    Mapping,
    Neutral,
    Person,
    ProblemName,
    Rate,
    Subject,
    Thing,
    Unit,
    UpAxis,
    Window,
    app,
    out_option,
)

_ABOUT_OPTIMISE = """Find the best place of the object for one person, offline.

Prints a table and writes optimum.json and report.html. The bound is what would be possible if the
person also chose the posture. Finished starts are kept: the same command continues a killed run.

\b
Examples:
  ergoqp optimise screwing
  ergoqp optimise screwing --from take.bvh --jobs 2   for the person of a recording
  ergoqp optimise my_task.toml --starts 200 --scheduler tcp://10.0.0.5:8786
"""

_ABOUT_GROUP = """Find the one fixed place of the object that is best for several people.

Prints how much worse it is than everybody's own best place and what an adjustable place would
save. Writes group.json, group.npz and report.html.

\b
Examples:
  ergoqp group desk --people 1.55,1.65,1.75,1.85      people of these statures
  ergoqp group desk --people 12 --seed 3              twelve random people
  ergoqp group overhead --people 1.6,1.9 --objective mean --hands both --load-kg 2
"""

_ABOUT_POPULATION = """Find everybody's own best place, over statures, hands and loads.

Prints a row for each person and writes population.csv. Finished starts are kept: the same command
continues a killed study.

\b
Examples:
  ergoqp population screwing --statures 1.5,1.7,1.9
  ergoqp population screwing --statures 1.5,1.7,1.9 --hands right,both --loads-kg 0.5,6
"""

_Starts = Annotated[int, typer.Option("--starts", metavar="N", help="Number of starts.")]
_Jobs = Annotated[int, typer.Option("--jobs", metavar="N", help="Number of processes.")]
_Seed = Annotated[int, typer.Option("--seed", metavar="N", help="Seed of the starts.")]
_Mode = Annotated[
    str,
    typer.Option(
        "--mode", metavar="NAME", help="stackelberg; or cooperative: the posture is chosen too."
    ),
]
_Solver = Annotated[
    str, typer.Option("--solver", metavar="NAME", help="ipopt, fatrop or sqpmethod.")
]
_Scheduler = Annotated[
    str | None,
    typer.Option(
        "--scheduler",
        metavar="ADDRESS",
        help="A Dask cluster that solves the starts [this machine].",
    ),
]


@app.command(
    "optimise", help=_ABOUT_OPTIMISE, short_help="Look for the best place of the object, offline."
)
def _optimise(
    problem: ProblemName,
    recording: Annotated[
        Path | None,
        typer.Option(
            "--from", metavar="RECORDING", help="Start with posture and person of a recording."
        ),
    ] = None,
    at: At = None,
    starts: _Starts = 32,
    jobs: _Jobs = 1,
    seed: _Seed = 0,
    mode: _Mode = "stackelberg",
    solver: _Solver = "ipopt",
    scheduler: _Scheduler = None,
    out: Annotated[Path | None, out_option("optimise-PROBLEM")] = None,
    person: Person = None,
    unit_to_m: Unit = None,
    up: UpAxis = None,
    mapping: Mapping = None,
    neutral: Neutral = None,
    window: Window = None,
    subject: Subject = None,
    thing: Thing = None,
    columns: Columns = None,
    rate: Rate = None,
) -> None:
    from ergoqp.cli.commands.common import RecordingOptions, SearchOptions
    from ergoqp.cli.commands.optimise import optimise_command

    optimise_command(
        problem,
        recording,
        at,
        out,
        RecordingOptions(
            person,
            unit_to_m,
            up and up.value,
            mapping,
            neutral,
            window,
            subject,
            thing,
            columns,
            rate,
        ),
        SearchOptions(starts, jobs, seed, mode, solver, scheduler),
    )


@app.command("group", help=_ABOUT_GROUP, short_help="Look for one best place for several people.")
def _group(
    problem: ProblemName,
    people: Annotated[
        str,
        typer.Option(
            "--people",
            metavar="M,...|N",
            help="Statures in metres, or the number of people to draw.",
            show_default=False,
        ),
    ],
    objective: Annotated[
        str,
        typer.Option("--objective", metavar="NAME", help="minimax or mean of the exact scores."),
    ] = "minimax",
    hands: Annotated[
        str | None,
        typer.Option("--hands", metavar="NAME", help="right, left or both [the problem's]."),
    ] = None,
    load_kg: Annotated[
        float | None,
        typer.Option("--load-kg", metavar="KG", help="Mass of the tool [the problem's]."),
    ] = None,
    starts: _Starts = 4,
    jobs: _Jobs = 1,
    seed: Annotated[
        int, typer.Option("--seed", metavar="N", help="Seed of the first person that is drawn.")
    ] = 0,
    out: Annotated[Path | None, out_option("group-PROBLEM")] = None,
) -> None:
    from ergoqp.cli.commands.group import group

    group(
        problem,
        people,
        objective,
        out,
        hands=hands,
        load_kg=load_kg,
        starts=starts,
        seed=seed,
        jobs=jobs,
    )


@app.command(
    "population", help=_ABOUT_POPULATION, short_help="Look for everybody's own best place."
)
def _population(
    problem: ProblemName,
    statures: Annotated[
        str,
        typer.Option("--statures", metavar="M,...", help="Statures in metres.", show_default=False),
    ],
    hands: Annotated[
        str | None,
        typer.Option("--hands", metavar="NAME,...", help="right, left, both [the problem's]."),
    ] = None,
    loads_kg: Annotated[
        str | None,
        typer.Option("--loads-kg", metavar="KG,...", help="Masses of the tool [the problem's]."),
    ] = None,
    starts: _Starts = 32,
    jobs: _Jobs = 1,
    seed: _Seed = 0,
    mode: _Mode = "stackelberg",
    solver: _Solver = "ipopt",
    scheduler: _Scheduler = None,
    out: Annotated[Path | None, out_option("population-PROBLEM")] = None,
) -> None:
    from ergoqp.cli.commands.common import SearchOptions
    from ergoqp.cli.commands.population import population_study

    population_study(
        problem,
        statures,
        out,
        hands=hands,
        loads_kg=loads_kg,
        search=SearchOptions(starts, jobs, seed, mode, solver, scheduler),
    )
