"""The command ``ergoqp``: which commands and options there are, and what becomes of mistakes and faults."""

from __future__ import annotations

import io
import os
import sys
import traceback
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from ergoqp import __version__
from ergoqp.errors import ErgoqpError, InputError

DONE, FAULT, MISTAKE, INTERRUPTED = 0, 1, 2, 130
"""Exit statuses."""


class Up(StrEnum):
    """Vertical axes that a recording can have."""

    y = "y"
    z = "z"


class Side(StrEnum):
    """Which arm an option is about."""

    right = "right"
    left = "left"
    both = "both"


class Joints(StrEnum):
    """Which joints drawn postures have."""

    report = "report"
    scored = "scored"


app = typer.Typer(
    name="ergoqp",
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)

# Lines after \b stay as they are, down to the next empty one.
_ABOUT = """Move the object so that the person's posture gets better.

\b
Examples:
  ergoqp run screwing
  ergoqp run screwing --from recording.bvh
  ergoqp optimise screwing
  ergoqp score recording.bvh --load-kg 4
  ergoqp fit svr
  ergoqp compare screwing

Exit status: 0 done, 2 for a mistake in what was given, 1 for a fault of the program.
"""
_ABOUT_RUN = """Run the closed loop of a problem with a simulated person who follows the object.

Prints a table and writes report.html, run.json and run.npz.

\b
Examples:
  ergoqp run screwing                                at an awkward place, drawn with the seed
  ergoqp run screwing --from take.bvh                at the worst-scored frame of a recording
  ergoqp run my_task.toml --from take.bvh --at 3.2   your own problem, at 3.2 s
  ergoqp run overhead --guide best                   drawn to the best place where descent alone stays at a worse one
"""
_ABOUT_SCORE = """Score every frame of a recording by REBA.

Prints a table and writes scores.csv, scores.json and report.html. What joint angles cannot tell is given by options.

\b
Examples:
  ergoqp score take.bvh
  ergoqp score take.bvh --load-kg 6 --coupling 1
  ergoqp score take.bvh --seated --unit-to-m 0.01 --up y
"""

_ABOUT_FIT = """Learn a cost from labelled postures, test it on postures that it has not seen, and keep it.

Prints a table and writes COST.npz (for [cost.learned] in a problem file, or ergoqp.load_cost) and COST.png.

\b
Examples:
  ergoqp fit svr                                     10 000 random postures, scored by the sheet
  ergoqp fit gmr --set components=30 --folds 3
  ergoqp fit svr --data forearm                      elbow and wrist of the right arm
  ergoqp fit quadratic --data my_postures.csv        columns trunk_flexion_deg ..., score
  ergoqp fit boundary --joints scored                where there were data, for [limits.one_class_boundary]
"""

_ABOUT_EXPORT = """Write the control step of a problem as C99: sources, header, CMake file, the QP solver's library, examples.

\b
Examples:
  ergoqp export screwing --out step
  cmake -S step -B step/build && cmake --build step/build && step/build/main
"""

_ABOUT_OPTIMISE = """Look for the best place of the object, offline, for a person who comes to rest by their own comfort.

Prints a table, with what would be possible if the posture could be chosen too, and writes optimum.json. Finished
starts are kept in the folder: a run that was killed goes on from them.

\b
Examples:
  ergoqp optimise screwing
  ergoqp optimise screwing --from take.bvh --jobs 2   for the person of a recording
  ergoqp optimise my_task.toml --starts 200 --scheduler tcp://10.0.0.5:8786
  ergoqp optimise desk --group 1.55,1.65,1.75,1.85    one fixed place for all of them
  ergoqp optimise screwing --population 1.5,1.7,1.9 --hands right,both   everybody's own
"""

_ABOUT_COMPARE = """Compare QP solvers on the QPs that a problem's own control steps solve.

Records closed loops, derives harder QPs, judges every answer apart, prints tables, and writes compare.json, compare.png and
the QPs as a test set for qpbenchmark.

\b
Examples:
  ergoqp compare screwing
  ergoqp compare low_bin --solvers daqp,piqp --steps 1000
"""

_Out = Annotated[Path | None, typer.Option("--out", metavar="DIR", help="Folder for the results [ergoqp-out/NAME].")]
_Unit = Annotated[
    float | None, typer.Option("--unit-to-m", metavar="M", help="Size of the recording's unit of length in metres [found].")
]
_Up = Annotated[Up | None, typer.Option("--up", help="The recording's vertical axis [found].", show_default=False)]
_Person = Annotated[
    str | None,
    typer.Option("--person", metavar="M|FILE", help="Stature in metres, or a person file (TOML) [measured in the recording]."),
]
_Mapping = Annotated[
    Path | None,
    typer.Option("--mapping", metavar="FILE", help="TOML file that names the recording's joints [known namings]."),
]


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"ergoqp {__version__}")
        raise typer.Exit


@app.callback(invoke_without_command=True, help=_ABOUT)
def _root(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and end.")
    ] = False,
) -> None:
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


@app.command("run", help=_ABOUT_RUN, short_help="Close the loop of a problem with a simulated person.")
def _run(
    problem: Annotated[
        str,
        typer.Argument(
            metavar="PROBLEM",
            help="dentist, desk, low_bin, overhead, screwing, screwing_learned, or the path of a TOML file.",
            show_default=False,
        ),
    ],
    recording: Annotated[
        Path | None,
        typer.Option("--from", metavar="RECORDING", help="Start in a posture of a recording, with its person's body."),
    ] = None,
    at: Annotated[
        float | None, typer.Option("--at", metavar="SECONDS", help="When in the recording [its worst-scored frame].")
    ] = None,
    out: _Out = None,
    seed: Annotated[
        int, typer.Option("--seed", metavar="N", help="Of the person, the noise, and where the object starts.")
    ] = 0,
    duration: Annotated[float, typer.Option("--duration", metavar="SECONDS", help="Of the closed loop.")] = 20.0,
    person: _Person = None,
    unit_to_m: _Unit = None,
    up: _Up = None,
    mapping: _Mapping = None,
    guide: Annotated[
        str | None,
        typer.Option("--guide", metavar="best|FILE", help="A place to be drawn to: looked for, or an optimum.json [none]."),
    ] = None,
) -> None:
    from ergoqp.commands.common import RecordingOptions
    from ergoqp.commands.run import run

    run(problem, recording, at, out, seed, duration, RecordingOptions(person, unit_to_m, up and up.value, mapping), guide)


@app.command("optimise", help=_ABOUT_OPTIMISE, short_help="Look for the best place of the object, offline.")
def _optimise(
    problem: Annotated[
        str,
        typer.Argument(
            metavar="PROBLEM",
            help="dentist, desk, low_bin, overhead, screwing, screwing_learned, or the path of a TOML file.",
            show_default=False,
        ),
    ],
    recording: Annotated[
        Path | None,
        typer.Option("--from", metavar="RECORDING", help="For the posture and the person of a recording."),
    ] = None,
    at: Annotated[
        float | None, typer.Option("--at", metavar="SECONDS", help="When in the recording [its worst-scored frame].")
    ] = None,
    group: Annotated[
        str | None,
        typer.Option("--group", metavar="M,...|N", help="One place for people of these statures, or for N drawn ones."),
    ] = None,
    population: Annotated[
        str | None, typer.Option("--population", metavar="M,...", help="Everybody's own best place, for these statures.")
    ] = None,
    objective: Annotated[
        str, typer.Option("--objective", metavar="NAME", help="Of a group: minimax or mean of the exact scores.")
    ] = "minimax",
    hands: Annotated[
        str | None, typer.Option("--hands", metavar="NAME", help="Of a group or population: right, left, both [the problem's].")
    ] = None,
    load_kg: Annotated[
        str | None, typer.Option("--load-kg", metavar="KG", help="Tool of a group or population [the problem's].")
    ] = None,
    starts: Annotated[int | None, typer.Option("--starts", metavar="N", help="Places to begin at [32; a group's 4].")] = None,
    jobs: Annotated[int, typer.Option("--jobs", metavar="N", help="Processes to use.")] = 1,
    seed: Annotated[int, typer.Option("--seed", metavar="N", help="Of the starts.")] = 0,
    mode: Annotated[
        str, typer.Option("--mode", metavar="NAME", help="stackelberg; or cooperative: the posture is chosen too.")
    ] = "stackelberg",
    solver: Annotated[str, typer.Option("--solver", metavar="NAME", help="ipopt, fatrop or sqpmethod.")] = "ipopt",
    scheduler: Annotated[
        str | None, typer.Option("--scheduler", metavar="ADDRESS", help="A Dask cluster that solves the starts [this machine].")
    ] = None,
    out: _Out = None,
    person: _Person = None,
    unit_to_m: _Unit = None,
    up: _Up = None,
    mapping: _Mapping = None,
) -> None:
    from ergoqp.commands.common import RecordingOptions
    from ergoqp.commands.optimise import optimise_command

    if group is not None:
        from ergoqp.commands.group import group as one_place

        alone = {"--from": recording, "--at": at, "--person": person, "--population": population, "--scheduler": scheduler}
        _refuse_with("--group", alone)
        task = {"hands": hands, "load_kg": load_kg}
        one_place(problem, group, objective, out, **task, starts=starts, seed=seed, jobs=jobs)
        return
    settings = {
        "starts": 32 if starts is None else starts,
        "jobs": jobs,
        "seed": seed,
        "mode": mode,
        "solver": solver,
        "scheduler": scheduler,
    }
    if population is not None:
        from ergoqp.commands.population import population_study

        _refuse_with("--population", {"--from": recording, "--at": at, "--person": person})
        population_study(problem, population, out, hands=hands, loads_kg=load_kg, settings=settings)
        return
    if hands is not None or load_kg is not None:
        raise InputError("--hands, --load-kg: allowed with --group or --population; a single person's are in the problem file")
    options = RecordingOptions(person, unit_to_m, up and up.value, mapping)
    optimise_command(problem, recording, at, out, options, settings)


@app.command("score", help=_ABOUT_SCORE)
def _score(
    recording: Annotated[Path, typer.Argument(metavar="RECORDING", help="A motion-capture file (.bvh).", show_default=False)],
    out: _Out = None,
    load_kg: Annotated[float, typer.Option("--load-kg", metavar="KG", help="Mass handled.")] = 0.0,
    shock: Annotated[bool, typer.Option("--shock", help="Shock or a rapid build-up of force.")] = False,
    coupling: Annotated[
        int, typer.Option("--coupling", metavar="0-3", help="Grip: 0 good, 1 fair, 2 poor, 3 unacceptable.")
    ] = 0,
    activity: Annotated[
        int, typer.Option("--activity", metavar="0-3", help="One for each of: static, repeated, rapid large changes.")
    ] = 0,
    seated: Annotated[bool, typer.Option("--seated", help="Knees are not counted.")] = False,
    one_leg: Annotated[bool, typer.Option("--one-leg", help="Weight on one leg, or an unstable stance.")] = False,
    arm_supported: Annotated[
        Side | None, typer.Option("--arm-supported", help="Arm supported or gravity assisted.", show_default=False)
    ] = None,
    shoulder_raised: Annotated[
        Side | None, typer.Option("--shoulder-raised", help="Raised shoulder.", show_default=False)
    ] = None,
    person: _Person = None,
    unit_to_m: _Unit = None,
    up: _Up = None,
    mapping: _Mapping = None,
) -> None:
    from ergoqp.commands.common import RecordingOptions
    from ergoqp.commands.score import score
    from ergoqp.sheets.task import TaskOptions

    task = TaskOptions(
        load_kg=load_kg,
        shock=shock,
        coupling=coupling,
        activity=activity,
        seated=seated,
        one_leg=one_leg,
        arm_supported=_pair(arm_supported),
        shoulder_raised=_pair(shoulder_raised),
    )
    score(recording, out, task, RecordingOptions(person, unit_to_m, up and up.value, mapping))


@app.command("fit", help=_ABOUT_FIT, short_help="Learn a cost from labelled postures.")
def _fit(
    cost: Annotated[
        str,
        typer.Argument(metavar="COST", help="quadratic, gmr, svr, one_class_ladder, neural; or boundary.", show_default=False),
    ],
    data: Annotated[
        str, typer.Option("--data", metavar="NAME|FILE", help="sheet, interval, forearm, or a CSV file of your own.")
    ] = "sheet",
    joints: Annotated[
        Joints, typer.Option("--joints", help="The 20 joints of the EPFL report, or all 22 that the sheet reads.")
    ] = Joints.report,
    per_score: Annotated[
        int, typer.Option("--per-score", metavar="N", help="Postures of each score, where data are drawn.")
    ] = 1000,
    seed: Annotated[int, typer.Option("--seed", metavar="N", help="Of data, folds and fit.")] = 0,
    folds: Annotated[int, typer.Option("--folds", metavar="N", help="Of the cross-validation.")] = 5,
    settings: Annotated[
        list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help="An option of the cost's own fit; may be repeated.")
    ] = None,
    out: _Out = None,
) -> None:
    if cost == "boundary":
        from ergoqp.commands.fit_boundary import fit_boundary

        fit_boundary(data, joints.value, per_score, seed, folds, settings or [], out)
        return
    from ergoqp.commands.fit import fit

    fit(cost, data, joints.value, per_score, seed, folds, settings or [], out)


@app.command("export", help=_ABOUT_EXPORT, short_help="Write the control step of a problem as C99.")
def _export(
    problem: Annotated[str, typer.Argument(metavar="PROBLEM", help="Name or problem file.", show_default=False)],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for the sources.", show_default=False)],
    dt: Annotated[float | None, typer.Option("--dt", metavar="S", help="Control period [the problem's].")] = None,
) -> None:
    from ergoqp.commands.export import export

    export(problem, out, dt)


@app.command("compare", help=_ABOUT_COMPARE, short_help="Compare QP solvers on a problem's own QPs.")
def _compare(
    problem: Annotated[
        str, typer.Argument(metavar="PROBLEM", help="A name, as for run, or the path of a TOML file.", show_default=False)
    ],
    solvers: Annotated[
        str | None, typer.Option("--solvers", metavar="A,B", help="Solvers by name [all that are installed].")
    ] = None,
    steps: Annotated[int, typer.Option("--steps", metavar="N", help="Control steps to record.")] = 300,
    seed: Annotated[int, typer.Option("--seed", metavar="N", help="Of the closed loops.")] = 0,
    accuracy: Annotated[float, typer.Option("--accuracy", metavar="A", help="That the solvers are set to.")] = 1e-6,
    out: _Out = None,
) -> None:
    from ergoqp.commands.compare import run_compare

    run_compare(problem, solvers, steps, seed, accuracy, out)


def _refuse_with(option: str, others: dict[str, object]) -> None:
    if given := [name for name, value in others.items() if value is not None]:
        raise InputError(f"{', '.join(given)}: not allowed with {option}")


def _pair(side: Side | None) -> tuple[bool, bool]:
    return side in (Side.right, Side.both), side in (Side.left, Side.both)


def execute(arguments: Sequence[str]) -> int:
    """Run a command line (without the program's name) and return the exit status; mistakes and faults go to standard error."""
    try:
        status = app(args=list(arguments), prog_name="ergoqp", standalone_mode=False)
    except ErgoqpError as mistake:
        return _complain(str(mistake), MISTAKE)
    except (KeyboardInterrupt, typer.Abort):
        return _complain("interrupted", INTERRUPTED)
    except BrokenPipeError:
        # Who reads has gone, for example `| head`: nothing more to say, and nothing to flush at the end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAULT
    except Exception as error:
        # A usage error of the command line's own library, whichever version of it carries the class.
        if hasattr(error, "format_message"):
            words = " ".join(error.format_message().split())  # type: ignore[attr-defined]
            return _complain(f"{words.rstrip('.')}; see `ergoqp --help`", MISTAKE)
        if os.environ.get("ERGOQP_DEBUG") == "1":
            traceback.print_exc()
        kind = type(error).__name__
        return _complain(f"internal fault, {kind}: {error}; set ERGOQP_DEBUG=1 to see where, and please report it", FAULT)
    return status if isinstance(status, int) else DONE


def _complain(words: str, status: int) -> int:
    print(f"ergoqp: {words}", file=sys.stderr)
    return status


def main() -> None:
    """Run the command line of this process."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        # A terminal or pipe that cannot show a letter gets its code, not an error.
        sys.stdout.reconfigure(errors="backslashreplace")
    sys.exit(execute(sys.argv[1:]))
