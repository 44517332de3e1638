"""``ergoqp score --save-person``: write the person of a recording, if it shows enough of them."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from ergoqp.arguments import shown
from ergoqp.errors import InputError
from ergoqp.human import FRACTIONS
from ergoqp.human.person_file import write_person
from ergoqp.joints import SIDES, spoken
from ergoqp.mocap import Recording
from ergoqp.mocap.fitting.person import side_measured
from ergoqp.mocap.formats.text import some

_LEAST: Final = 20
"""Least number of scored frames to measure a person."""
_FAR: Final = 0.025
"""A marker with a larger residual is not fixed to its place (RMS) [m]."""


def save_person(path: Path, recording: Recording, given: bool) -> list[str]:
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
