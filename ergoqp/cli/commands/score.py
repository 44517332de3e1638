"""``ergoqp score``: score every frame of a recording."""

from __future__ import annotations

from pathlib import Path

from ergoqp.cli.commands.common import (
    RecordingOptions,
    make_folder,
    write_report,
    writing,
)
from ergoqp.cli.commands.save_person import save_person
from ergoqp.cli.commands.screen import console, print_assumptions, working
from ergoqp.errors import RecordingError, UnknownNamesError
from ergoqp.mocap.markers.landmarks import LANDMARKS
from ergoqp.mocap.names import template
from ergoqp.mocap.naming import CENTRES
from ergoqp.progress import part_of
from ergoqp.report.score_page import write_score_page
from ergoqp.report.scores import write_angles, write_scores
from ergoqp.report.tables import score_table
from ergoqp.sheets.options import TaskOptions
from ergoqp.sheets.reba import Method, assess


def score(
    recording_path: Path,
    out: Path | None,
    task: TaskOptions,
    options: RecordingOptions,
    method: Method,
    person_path: Path | None = None,
) -> None:
    """Score a recording, print the table, and write its files and ``report.html``.

    If joints follow no known naming scheme, a mapping file with the nearest guesses is
    written.

    Args:
        recording_path: path of the recording.
        out: folder for the results.
        task: task options that joint angles cannot tell.
        options: how to read the recording.
        method: how the sheet is read.
        person_path: path of the person file to write, or None.

    Raises:
        ErgoqpError: if an argument cannot be used.
    """
    try:
        with working(f"reading {recording_path.name}") as done:
            recording = options.load(recording_path, done)
    except UnknownNamesError as unknown:
        folder = make_folder(out, recording_path.stem)
        with writing(folder):
            mapping = folder / "mapping.toml"
            mapping.write_text(template(unknown.names, (*CENTRES, *LANDMARKS)), encoding="utf-8")
        raise RecordingError(
            f"{unknown}; a file with the nearest guesses, to be looked through, is {mapping}"
        ) from None
    notes = []
    if person_path is not None:
        notes = save_person(person_path, recording, options.person is not None)
    assessment = assess(recording.scored_postures, method, **task)
    folder = make_folder(out, recording_path.stem)
    screen = console()
    with working("writing scores and angles") as done, writing(folder):
        write_scores(recording, assessment, folder, part_of(done, 0.0, 0.5))
        write_angles(recording, folder, part_of(done, 0.5, 1.0))
    print_assumptions(screen, recording.assumptions)
    print_assumptions(screen, notes, f"written to {person_path}")
    screen.print(score_table(recording, assessment))
    write_report(
        screen,
        folder,
        ("scores.csv", "scores.json", "angles.csv", "angles.mot"),
        lambda path: write_score_page(
            recording, assessment, path, _words(task, method), recording_path.name
        ),
    )


def _words(task: TaskOptions, method: Method) -> list[tuple[str, str]]:
    """Return the options of the scoring as text."""
    words = [("upper arm scored by", method.upper_arm)]
    for name, value in task.items():
        if isinstance(value, tuple):
            text = (
                " and ".join(
                    side for side, there in zip(("right", "left"), value, strict=True) if there
                )
                or "no"
            )
        elif isinstance(value, bool):
            text = "yes" if value else "no"
        else:
            text = f"{value:g}{' kg' if name.endswith('_kg') else ''}"
        words.append((name.removesuffix("_kg").replace("_", " "), text))
    return words
