"""From a motion-capture file to postures: read, name, place, fit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from numbers import Real
from pathlib import Path
from typing import Final

import numpy as np

from ergoqp.arguments import path_of
from ergoqp.errors import InputError, RecordingError
from ergoqp.human import Body
from ergoqp.joints import spoken
from ergoqp.recordings.fitting.axes import find_unit, find_up, to_world
from ergoqp.recordings.fitting.head import rest_lean, straighten_head
from ergoqp.recordings.fitting.person import (
    given_person,
    measured_lengths,
    measured_person,
    suggested_stature,
)
from ergoqp.recordings.fitting.posture_fit import fit
from ergoqp.recordings.naming import NamedCentres, named_centres, read_mapping
from ergoqp.recordings.readers import read_motion
from ergoqp.recordings.recording import Recording
from ergoqp.recordings.remarks import remarks

_UPRIGHT: Final = math.radians(2)  # a neck that leans less at rest is not worth a sentence


def load_recording(
    path: str | Path,
    person: float | str | Path | None = None,
    unit_to_m: float | None = None,
    up: str | None = None,
    *,
    mapping: str | Path | None = None,
) -> Recording:
    """Read a motion-capture file and fit the body to it.

    Args:
        path: the recording; its ending tells the format (see `ergoqp.recordings.readers`).
        person: stature [m], path of a person file (see `ergoqp.recordings.fitting.person`), or None
            to measure the segment lengths in the recording itself.
        unit_to_m: size of the file's unit of length [m]; None finds the one that yields the stature
            of an adult.
        up: the file's vertical axis, ``"y"`` or ``"z"``; None finds it.
        mapping: TOML file with lines ``our_centre = "their joint"`` for skeletons of no known
            naming (see `ergoqp.recordings.naming.CENTRES`); None tries the known namings.

    Returns:
        Postures, pelvis poses, what was observed, how well the body fits, and every assumption
        made.

    Raises:
        RecordingError: the file is not a readable recording, or its skeleton, unit or axes are not
            known.
        InputError: another argument is not usable.
    """
    path = path_of("recording", path)
    _check_arguments(unit_to_m, up)
    naming = None if mapping is None else read_mapping(Path(mapping))
    body = None if person is None else given_person(person)
    motion = read_motion(path)
    named = named_centres(motion, naming, path.name)
    centres = named.paths
    assumptions = [f"The joints are named as in the {named.title} skeleton.", *motion.notes]

    lengths = measured_lengths(centres)
    stature = suggested_stature(lengths)
    unit = unit_to_m
    if unit is None:
        if stature is None:
            raise RecordingError(
                f"{path.name}: no limb is complete enough to tell the unit of length; state"
                " unit_to_m"
            )
        unit = find_unit(stature, path.name)
        assumptions.append(
            f"The unit of length is taken as {unit:g} m, the only common one that gives a stature"
            " of 1.4 to 2.1 m."
        )
    up = _vertical(path, centres, up, assumptions)
    if body is None:
        body = _measured_body(path, lengths, stature, unit, assumptions)

    world = _placed(named, unit, up, assumptions)
    result = fit(body, world, motion.time)
    assumptions.extend(remarks(motion.time, world, result))
    return Recording(
        time=motion.time,
        postures=result.postures,
        base_poses=_poses(result.pelvis),
        observed=result.observed,
        fit_error=result.error,
        object_poses=None,
        assumptions=tuple(assumptions),
        person=body,
        errors=result.errors,
        not_scored=result.not_scored,
    )


def _check_arguments(unit_to_m: float | None, up: str | None) -> None:
    if unit_to_m is not None and not (
        isinstance(unit_to_m, Real) and math.isfinite(unit_to_m) and unit_to_m > 0
    ):
        raise InputError(f"unit_to_m: got {unit_to_m!r}, allowed a length in metres above 0")
    if up not in (None, "y", "z"):
        raise InputError(f"up: got {up!r}, allowed 'y', 'z' or None")


def _vertical(
    path: Path, centres: Mapping[str, np.ndarray], stated: str | None, assumptions: list[str]
) -> str:
    """Return the stated vertical axis, else the one found."""
    found = find_up(centres)
    if stated is None:
        if found is None:
            raise RecordingError(
                f"{path.name}: the head is above the feet along neither y nor z; state the vertical"
                " axis (up)"
            )
        assumptions.append(
            f"The vertical axis is taken as {found}, along which the head is above the feet."
        )
        return found
    if found is not None and found != stated:
        assumptions.append(
            f"The vertical axis is {stated} as stated, although the head is above the feet along"
            f" {found}."
        )
    return stated


def _measured_body(
    path: Path,
    lengths: Mapping[str, float],
    stature: float | None,
    unit: float,
    assumptions: list[str],
) -> Body:
    if stature is None:
        raise RecordingError(
            f"{path.name}: no trunk, arm or leg is complete enough to measure the person; state"
            " person"
        )
    try:
        body, average = measured_person(
            {name: unit * length for name, length in lengths.items()}, unit * stature
        )
    except InputError as error:
        raise RecordingError(
            f"{path.name}: with a unit of {unit:g} m, {error}; check unit_to_m"
        ) from None
    assumptions.append(
        "The segment lengths are measured between the recording's joints; they suggest a stature"
        f" of {body.stature:.2f} m."
    )
    if average:
        assumptions.append(
            f"Average lengths are taken for {', '.join(map(spoken, average))}: no person has those"
            " of the recording."
        )
    return body


def _placed(
    named: NamedCentres, unit: float, up: str, assumptions: list[str]
) -> dict[str, np.ndarray]:
    """Return the fit's targets: centre -> positions (n, 3) in our axes [m], the head upright."""
    world = {centre: to_world(path, unit, up) for centre, path in named.paths.items()}
    lean = rest_lean({centre: to_world(place, unit, up) for centre, place in named.rest.items()})
    if abs(lean) > _UPRIGHT:
        world = straighten_head(world, lean)
        angle = f"{math.degrees(lean):.0f} deg"
        assumptions.append(
            f"The skeleton's neck leans forward by {angle} at rest; that is taken as looking"
            " straight ahead."
        )
    return world


def _poses(base: np.ndarray) -> np.ndarray:
    """Return upright poses (n, 4, 4) from positions [m] and headings [rad], shape (n, 4)."""
    poses = np.tile(np.eye(4), (len(base), 1, 1))
    poses[:, :3, 3] = base[:, :3]
    cos, sin = np.cos(base[:, 3]), np.sin(base[:, 3])
    poses[:, 0, 0] = poses[:, 1, 1] = cos
    poses[:, 1, 0] = sin
    poses[:, 0, 1] = -sin
    return poses
