"""``ergoqp score``: score every frame of a recording, and write its person."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Final

from ergoqp.arguments import part_of, shown
from ergoqp.cli.common import (
    console,
    make_folder,
    print_assumptions,
    working,
    write_report,
    writing,
)
from ergoqp.cli.options import RecordingOptions, argument, grouped, option, out_option
from ergoqp.errors import InputError, NothingScoredError, RecordingError, UnknownNamesError
from ergoqp.human import FRACTIONS
from ergoqp.human.person_file import write_person
from ergoqp.joints import SIDES, spoken
from ergoqp.mocap import Recording
from ergoqp.mocap.assumptions import side_measured
from ergoqp.mocap.formats.text import some
from ergoqp.mocap.name_words import template
from ergoqp.mocap.naming import CENTRES, LANDMARKS
from ergoqp.report.score_page import write_score_page
from ergoqp.report.scores import write_angles, write_scores
from ergoqp.report.tables import score_table
from ergoqp.sheets.assessment import assess_rows
from ergoqp.sheets.options import Method, TaskOptions, read_task, sheet_of
from ergoqp.simulation.description import in_words

ABOUT = """Score every frame of a recording by REBA.

Reads BVH, C3D, TRC, OpenSim MOT, MVNX, Motive and Nexus CSV, tables of joints, ROS bags and records
of ergoqp serve.

Prints a table and writes scores.csv, scores.json, angles.csv, angles.mot and report.html. Load,
grip and support are stated by options. Where a part of the body is not seen, a score has a lowest
and a highest value. Frames without a trunk are listed and not scored; if there is no other frame,
the exit status is 3.

\b
Examples:
  ergoqp score take.bvh
  ergoqp score take.bvh --load-kg 6 --coupling 1
  ergoqp score take.bvh --seated --unit-to-m 0.01 --up y
  ergoqp score take.bvh --upper-arm elevation
  ergoqp score trial.c3d --neutral static.c3d
  ergoqp score table.csv --rate 30 --columns neck,pelvis,right_shoulder,right_elbow,right_wrist
"""

_LEAST: Final = 20
"""Least number of scored frames to measure a person."""
_FAR: Final = 0.025
"""A marker with a larger residual is not fixed to its place (RMS) [m]."""


UpperArm = StrEnum("UpperArm", {"flexion": "flexion", "elevation": "elevation"})
"""What the bands of the upper arm read."""

Side = StrEnum("Side", ["right", "left", "both"])
"""The arm that an option refers to."""


@grouped(read=RecordingOptions)
def command(
    path: Annotated[
        Path, argument("RECORDING", "A motion-capture file (C3D, BVH, MVNX, CSV ...).")
    ],
    out: Annotated[Path | None, out_option("RECORDING")] = None,
    load_kg: Annotated[float, option("KG", "Mass handled.")] = 0.0,
    shock: Annotated[bool, option(None, "Shock or a rapid build-up of force.", "--shock")] = False,
    coupling: Annotated[int, option("0-3", "Grip: 0 good, 1 fair, 2 poor, 3 unacceptable.")] = 0,
    activity: Annotated[
        int, option("0-3", "One for each of: static, repeated, rapid large changes.")
    ] = 0,
    seated: Annotated[bool, option(None, "Knees are not counted.", "--seated")] = False,
    one_leg: Annotated[
        bool, option(None, "Weight on one leg, or an unstable stance.", "--one-leg")
    ] = False,
    arm_supported: Annotated[
        Side | None, option(None, "Arm supported or gravity assisted.")
    ] = None,
    shoulder_raised: Annotated[Side | None, option(None, "Raised shoulder.")] = None,
    upper_arm: Annotated[
        UpperArm, option(None, "Score its flexion, or its elevation (its angle to the trunk).")
    ] = UpperArm.flexion,
    save_person: Annotated[
        Path | None,
        option("FILE", "Write a person file for --person: measured lengths and marker places."),
    ] = None,
    *,
    read: RecordingOptions,
) -> None:
    """Score a recording, print the table, and write its files and ``report.html``.

    If joints follow no known naming scheme, or those that place pelvis or upper trunk do not, a
    mapping file with the nearest guesses is written; not over the one that was read.

    Raises:
        NothingScoredError: if no frame shows a trunk, after the files are written.
        ErgoqpError: if an argument cannot be used.
    """
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
    method = Method(upper_arm=upper_arm.value)
    try:
        with working(f"reading {path.name}") as done:
            recording = read.load(path, done)
    except UnknownNamesError as unknown:
        folder = make_folder(out, path.stem)
        mapping = folder / "mapping.toml"
        if read.mapping is not None and mapping.exists() and mapping.samefile(read.mapping):
            raise
        with writing(folder):
            mapping.write_text(template(unknown.names, (*CENTRES, *LANDMARKS)), encoding="utf-8")
        raise RecordingError(
            f"{unknown}; a file with the nearest guesses, to be looked through, is {mapping}"
        ) from None
    notes = []
    if save_person is not None:
        notes = _write_person(save_person, recording, read.person is not None)
    # As `reba.assess` of the recording, without 330 MB of copies of an hour.
    count, sheet = len(recording.time), sheet_of(method)
    assessment = assess_rows(
        recording.postures, method, read_task(sheet, count, task), recording.ends, recording.scored
    )
    folder = make_folder(out, path.stem)
    screen = console()
    with working("writing scores and angles") as done, writing(folder):
        write_scores(recording, assessment, folder, part_of(done, 0.0, 0.5))
        write_angles(recording, folder, part_of(done, 0.5, 1.0))
    options = [("upper arm scored by", method.upper_arm), *in_words(task)]
    print_assumptions(screen, recording.assumptions)
    print_assumptions(screen, notes, f"written to {save_person}")
    screen.print(score_table(recording, assessment))
    write_report(
        screen,
        folder,
        ("scores.csv", "scores.json", "angles.csv", "angles.mot"),
        lambda page: write_score_page(recording, assessment, page, options, path.name),
    )
    if not assessment.valid.any():
        causes = ", ".join(recording.not_scored)
        raise NothingScoredError(
            f"{path.name}: no frame shows a trunk ({causes}), so that none is scored; check the"
            " names of hips, shoulders and neck (--mapping), the vertical axis (--up) and the part"
            " that is read (--window)"
        )


def _pair(side: Side | None) -> tuple[bool, bool]:
    """Return whether the right and whether the left arm is selected."""
    return side in (Side.right, Side.both), side in (Side.left, Side.both)


def _write_person(path: Path, recording: Recording, given: bool) -> list[str]:
    """Write a person file, and return the notes on it, which are also in the file.

    Args:
        path: path of the file.
        recording: recording of the person.
        given: whether the person was stated, not measured.

    Raises:
        InputError: if the recording shows too little of the person, or the file cannot be
            written.
    """
    _check(recording, given)
    far = {name: marker.residual for name, marker in recording.markers.items()}
    far = {name: residual for name, residual in far.items() if residual > _FAR}
    near = {name: marker for name, marker in recording.markers.items() if name not in far}
    notes = _lengths(recording, given)
    if far:
        markers = some([f"{name} by {1000 * residual:.0f}" for name, residual in far.items()])
        notes.append(
            f"Markers that move by more than {1000 * _FAR:.0f} mm against their segment are left"
            f" out: {markers} mm."
        )
    try:
        write_person(path, recording.person, near, notes)
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise InputError(
            f"--save-person: got {shown(str(path), 80)}: {why}, allowed the path of a file"
        ) from None
    return notes


def _check(recording: Recording, given: bool) -> None:
    """Raise an error if the recording does not show enough of the person."""
    count = int(recording.scored.sum())
    if count < _LEAST:
        frames = {0: "no scored frame", 1: "1 scored frame"}.get(count, f"{count} scored frames")
        raise InputError(
            f"--save-person: got a recording with {frames}, allowed one with {_LEAST} or more"
        )
    if recording.measured or recording.markers:
        return
    if given:
        raise InputError(
            "--save-person: got a person who is stated (--person) and a recording without markers,"
            " allowed a recording that measures the person"
        )
    raise InputError(
        "--save-person: got joint angles, which measure nobody, allowed a recording of joint"
        " centres or markers"
    )


def _lengths(recording: Recording, given: bool) -> list[str]:
    """Return sentences on lengths that are not measured, or measured on one side only."""
    if given:
        return ["The lengths are those that were stated (--person), and not measured."]
    notes = []
    if average := [name for name in FRACTIONS if name not in recording.measured]:
        notes.append(
            "Not measured, and as long as those of an average person of"
            f" {recording.person.stature:.2f} m: {', '.join(map(spoken, average))}."
        )
    only = {name: side_measured(name, recording.errors) for name in recording.measured}
    for side in SIDES:
        if names := [spoken(name) for name, alone in only.items() if alone == side]:
            notes.append(f"Measured on the {side} side only: {', '.join(names)}.")
    return notes
