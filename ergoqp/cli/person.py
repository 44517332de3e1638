"""The commands on the motion of one person: run, score."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ergoqp.cli.app import (
    At,
    Columns,
    Guide,
    Mapping,
    Neutral,
    Person,
    ProblemName,
    Rate,
    Side,
    Subject,
    Thing,
    Unit,
    UpAxis,
    UpperArm,
    Window,
    app,
    out_option,
    pair,
)

_ABOUT_RUN = """Run the closed loop of a problem with a simulated person who follows the object.

Prints a table and writes report.html, run.json and run.npz.

\b
Examples:
  ergoqp run screwing                                at an awkward place, drawn with the seed
  ergoqp run screwing --from take.bvh                at the worst-scored frame of a recording
  ergoqp run my_task.toml --from take.bvh --at 3.2   your own problem, at 3.2 s
  ergoqp run overhead --guide best                   with the best place as a guide
  ergoqp run screwing --seek --duration 60           tries places, ends at the best one
  ergoqp run screwing --follower looking             with a person who watches the work
  ergoqp run screwing --robot lag=0.1                with an undeclared lag of the robot
  ergoqp run screwing --bias-deg right_knee_flexion=-4   with a wrong knee angle
"""

_ABOUT_SCORE = """Score every frame of a recording by REBA.

Reads BVH, C3D, TRC, OpenSim MOT, MVNX, Motive and Nexus CSV, tables of joints, ROS bags
and folders of poses.

Prints a table and writes scores.csv, scores.json, angles.csv, angles.mot and report.html. Load,
grip and support are stated by options. Frames that show no posture are listed and not scored.

\b
Examples:
  ergoqp score take.bvh
  ergoqp score take.bvh --load-kg 6 --coupling 1
  ergoqp score take.bvh --seated --unit-to-m 0.01 --up y
  ergoqp score take.bvh --upper-arm elevation
  ergoqp score trial.c3d --neutral static.c3d
  ergoqp score table.csv --rate 30 --columns neck,pelvis,right_shoulder,right_elbow,right_wrist
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
        typer.Option("--seed", metavar="N", help="Seed of the person, the noise and the start."),
    ] = 0,
    duration: Annotated[
        float, typer.Option("--duration", metavar="SECONDS", help="Duration of the run.")
    ] = 20.0,
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
    guide: Guide = None,
    seek: Annotated[
        bool,
        typer.Option(
            "--seek",
            help="Try several places and end at the one with the lowest measured score; takes up to"
            " 60 s.",
        ),
    ] = False,
    robot: Annotated[
        str | None,
        typer.Option(
            "--robot",
            metavar="NAME=VALUE,...",
            help="Errors of the simulated robot, such as lag=0.1,gain=1.02 [as declared].",
        ),
    ] = None,
    bias_deg: Annotated[
        str | None,
        typer.Option(
            "--bias-deg",
            metavar="JOINT=DEG,...",
            help="Constant errors of measured angles, such as right_knee_flexion=5 [none].",
        ),
    ] = None,
    as_seen: Annotated[
        bool,
        typer.Option(
            "--as-seen", help="The controller sees only the joints that the recording determines."
        ),
    ] = False,
    follower: Annotated[
        str,
        typer.Option(
            "--follower",
            metavar="KIND",
            help="Kind of person: alike (like the controller's model), follower, dead_zone,"
            " stubborn, stepping, pushed, looking, trembling or mass.",
        ),
    ] = "alike",
) -> None:
    from ergoqp.cli.commands.common import RecordingOptions
    from ergoqp.cli.commands.run import Simulated, run

    simulated = Simulated(robot, bias_deg, follower, seek, as_seen)
    run(
        problem,
        recording,
        at,
        out,
        seed,
        duration,
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
        guide,
        simulated,
    )


@app.command("score", help=_ABOUT_SCORE)
def _score(
    recording: Annotated[
        Path,
        typer.Argument(
            metavar="RECORDING",
            help="A motion-capture file (C3D, BVH, MVNX, CSV ...).",
            show_default=False,
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
    upper_arm: Annotated[
        UpperArm,
        typer.Option(
            "--upper-arm",
            help="Score its flexion, or its elevation (its angle to the trunk).",
        ),
    ] = UpperArm.flexion,
    save_person: Annotated[
        Path | None,
        typer.Option(
            "--save-person",
            metavar="FILE",
            help="Write a person file for --person: measured lengths and marker places.",
        ),
    ] = None,
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
    from ergoqp.cli.commands.common import RecordingOptions
    from ergoqp.cli.commands.score import score
    from ergoqp.sheets.options import TaskOptions
    from ergoqp.sheets.reba import Method

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
    score(
        recording,
        out,
        task,
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
        Method(upper_arm=upper_arm.value),
        save_person,
    )
