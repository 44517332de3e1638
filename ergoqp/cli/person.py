"""The commands about a person: run, optimise, score."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ergoqp.cli.app import (
    At,
    Mapping,
    Person,
    ProblemName,
    Side,
    Unit,
    UpAxis,
    app,
    out_option,
    pair,
    refuse_with,
)
from ergoqp.errors import InputError

_ABOUT_RUN = """Run the closed loop of a problem with a simulated person who follows the object.

Prints a table and writes report.html, run.json and run.npz.

\b
Examples:
  ergoqp run screwing                                at an awkward place, drawn with the seed
  ergoqp run screwing --from take.bvh                at the worst-scored frame of a recording
  ergoqp run my_task.toml --from take.bvh --at 3.2   your own problem, at 3.2 s
  ergoqp run overhead --guide best                   drawn to the best place, past a worse one
  ergoqp run screwing --robot lag=0.1                with a robot that lags, undeclared
  ergoqp run screwing --bias-deg right_knee_flexion=-4   with a knee that reads wrong
"""

_ABOUT_OPTIMISE = """Find the best place of the object, offline, for a person who rests in comfort.

Prints a table, with what would be possible if the posture could be chosen too, and writes
optimum.json. Finished starts are kept in the folder: a run that was killed goes on from them.

\b
Examples:
  ergoqp optimise screwing
  ergoqp optimise screwing --from take.bvh --jobs 2   for the person of a recording
  ergoqp optimise my_task.toml --starts 200 --scheduler tcp://10.0.0.5:8786
  ergoqp optimise desk --group 1.55,1.65,1.75,1.85    one fixed place for all of them
  ergoqp optimise screwing --population 1.5,1.7,1.9 --hands right,both   everybody's own
"""

_ABOUT_SCORE = """Score every frame of a recording by REBA.

Prints a table and writes scores.csv, scores.json and report.html. What joint angles cannot tell
is given by options.

\b
Examples:
  ergoqp score take.bvh
  ergoqp score take.bvh --load-kg 6 --coupling 1
  ergoqp score take.bvh --seated --unit-to-m 0.01 --up y
"""


@app.command(
    "run", help=_ABOUT_RUN, short_help="Close the loop of a problem with a simulated person."
)
def _run(
    problem: ProblemName,
    recording: Annotated[
        Path | None,
        typer.Option(
            "--from",
            metavar="RECORDING",
            help="Start in a posture of a recording, with its person's body.",
        ),
    ] = None,
    at: At = None,
    out: Annotated[Path | None, out_option("PROBLEM")] = None,
    seed: Annotated[
        int,
        typer.Option(
            "--seed", metavar="N", help="Of the person, the noise, and where the object starts."
        ),
    ] = 0,
    duration: Annotated[
        float, typer.Option("--duration", metavar="SECONDS", help="Of the closed loop.")
    ] = 20.0,
    person: Person = None,
    unit_to_m: Unit = None,
    up: UpAxis = None,
    mapping: Mapping = None,
    guide: Annotated[
        str | None,
        typer.Option(
            "--guide",
            metavar="best|FILE",
            help="A place to be drawn to: looked for, or an optimum.json [none].",
        ),
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option(
            "--robot",
            metavar="NAME=VALUE,...",
            help="What the simulated robot does, such as lag=0.1,gain=1.02 [declared].",
        ),
    ] = None,
    bias_deg: Annotated[
        str | None,
        typer.Option(
            "--bias-deg",
            metavar="JOINT=DEG,...",
            help="Angles that the sensors read wrong all the time [none].",
        ),
    ] = None,
) -> None:
    from ergoqp.cli.commands.common import RecordingOptions
    from ergoqp.cli.commands.run import Simulated, run

    simulated = Simulated(robot, bias_deg)
    run(
        problem,
        recording,
        at,
        out,
        seed,
        duration,
        RecordingOptions(person, unit_to_m, up and up.value, mapping),
        guide,
        simulated,
    )


@app.command(
    "optimise", help=_ABOUT_OPTIMISE, short_help="Look for the best place of the object, offline."
)
def _optimise(
    problem: ProblemName,
    recording: Annotated[
        Path | None,
        typer.Option(
            "--from", metavar="RECORDING", help="For the posture and the person of a recording."
        ),
    ] = None,
    at: At = None,
    group: Annotated[
        str | None,
        typer.Option(
            "--group",
            metavar="M,...|N",
            help="One place for people of these statures, or for N drawn ones.",
        ),
    ] = None,
    population: Annotated[
        str | None,
        typer.Option(
            "--population", metavar="M,...", help="Everybody's own best place, for these statures."
        ),
    ] = None,
    objective: Annotated[
        str | None,
        typer.Option(
            "--objective",
            metavar="NAME",
            help="Of a group: minimax or mean of the exact scores [minimax].",
        ),
    ] = None,
    hands: Annotated[
        str | None,
        typer.Option(
            "--hands",
            metavar="NAME",
            help="Of a group or population: right, left, both [the problem's].",
        ),
    ] = None,
    load_kg: Annotated[
        str | None,
        typer.Option(
            "--load-kg", metavar="KG", help="Tool of a group or population [the problem's]."
        ),
    ] = None,
    starts: Annotated[
        int | None,
        typer.Option("--starts", metavar="N", help="Places to begin at [32; a group's 4]."),
    ] = None,
    jobs: Annotated[int, typer.Option("--jobs", metavar="N", help="Processes to use.")] = 1,
    seed: Annotated[int, typer.Option("--seed", metavar="N", help="Of the starts.")] = 0,
    mode: Annotated[
        str | None,
        typer.Option(
            "--mode",
            metavar="NAME",
            help="stackelberg; or cooperative: the posture is chosen too [stackelberg].",
        ),
    ] = None,
    solver: Annotated[
        str | None,
        typer.Option("--solver", metavar="NAME", help="ipopt, fatrop or sqpmethod [ipopt]."),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            "--scheduler",
            metavar="ADDRESS",
            help="A Dask cluster that solves the starts [this machine].",
        ),
    ] = None,
    out: Annotated[
        Path | None, out_option("optimise-PROBLEM", "group-PROBLEM", "population-PROBLEM")
    ] = None,
    person: Person = None,
    unit_to_m: Unit = None,
    up: UpAxis = None,
    mapping: Mapping = None,
) -> None:
    from ergoqp.cli.commands.common import RecordingOptions
    from ergoqp.cli.commands.optimise import optimise_command

    of_recording: dict[str, object] = {
        "--from": recording,
        "--at": at,
        "--person": person,
        "--unit-to-m": unit_to_m,
        "--up": up,
    }
    of_recording["--mapping"] = mapping
    if group is not None:
        from ergoqp.cli.commands.group import group as one_place

        alone = {
            "--population": population,
            "--scheduler": scheduler,
            "--mode": mode,
            "--solver": solver,
        }
        refuse_with("--group", of_recording | alone)
        task = {"hands": hands, "load_kg": load_kg}
        one_place(
            problem,
            group,
            "minimax" if objective is None else objective,
            out,
            **task,
            starts=starts,
            seed=seed,
            jobs=jobs,
        )
        return
    if objective is not None:
        raise InputError(f"--objective: got {objective!r}, allowed with --group")
    settings = {
        "starts": 32 if starts is None else starts,
        "jobs": jobs,
        "seed": seed,
        "mode": "stackelberg" if mode is None else mode,
        "solver": "ipopt" if solver is None else solver,
        "scheduler": scheduler,
    }
    if population is not None:
        from ergoqp.cli.commands.population import population_study

        refuse_with("--population", of_recording)
        population_study(problem, population, out, hands=hands, loads_kg=load_kg, settings=settings)
        return
    if hands is not None or load_kg is not None:
        raise InputError(
            "--hands, --load-kg: allowed with --group or --population; a single person's are in the"
            " problem file"
        )
    options = RecordingOptions(person, unit_to_m, up and up.value, mapping)
    optimise_command(problem, recording, at, out, options, settings)


@app.command("score", help=_ABOUT_SCORE)
def _score(
    recording: Annotated[
        Path,
        typer.Argument(
            metavar="RECORDING", help="A motion-capture file (.bvh).", show_default=False
        ),
    ],
    out: Annotated[Path | None, out_option("RECORDING")] = None,
    load_kg: Annotated[float, typer.Option("--load-kg", metavar="KG", help="Mass handled.")] = 0.0,
    shock: Annotated[
        bool, typer.Option("--shock", help="Shock or a rapid build-up of force.")
    ] = False,
    coupling: Annotated[
        int,
        typer.Option(
            "--coupling", metavar="0-3", help="Grip: 0 good, 1 fair, 2 poor, 3 unacceptable."
        ),
    ] = 0,
    activity: Annotated[
        int,
        typer.Option(
            "--activity",
            metavar="0-3",
            help="One for each of: static, repeated, rapid large changes.",
        ),
    ] = 0,
    seated: Annotated[bool, typer.Option("--seated", help="Knees are not counted.")] = False,
    one_leg: Annotated[
        bool, typer.Option("--one-leg", help="Weight on one leg, or an unstable stance.")
    ] = False,
    arm_supported: Annotated[
        Side | None,
        typer.Option(
            "--arm-supported", help="Arm supported or gravity assisted.", show_default=False
        ),
    ] = None,
    shoulder_raised: Annotated[
        Side | None, typer.Option("--shoulder-raised", help="Raised shoulder.", show_default=False)
    ] = None,
    person: Person = None,
    unit_to_m: Unit = None,
    up: UpAxis = None,
    mapping: Mapping = None,
) -> None:
    from ergoqp.cli.commands.common import RecordingOptions
    from ergoqp.cli.commands.score import score
    from ergoqp.sheets.task import TaskOptions

    task = TaskOptions(
        load_kg=load_kg,
        shock=shock,
        coupling=coupling,
        activity=activity,
        seated=seated,
        one_leg=one_leg,
        arm_supported=pair(arm_supported),
        shoulder_raised=pair(shoulder_raised),
    )
    score(recording, out, task, RecordingOptions(person, unit_to_m, up and up.value, mapping))
