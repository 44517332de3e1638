"""C3D files: markers of motion laboratories, with the joint angles that their programs computed.

The frames are read block by block, because an hour is too large for memory. Points that are not
markers (joint centres, forces, moments, powers of the laboratory's own model) are not taken as
markers. The angles of that model are returned.
"""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO, Final

import numpy as np

from ergoqp.progress import Progress
from ergoqp.recordings.formats.c3d_counts import frames_of
from ergoqp.recordings.formats.c3d_head import Head, fail, read_head
from ergoqp.recordings.formats.opening import binary, some
from ergoqp.recordings.formats.rows import Asked
from ergoqp.recordings.formats.stamps import repeated, seconds
from ergoqp.recordings.formats.trc import UNITS, UNITS_WORDS
from ergoqp.recordings.motion import JointMotion
from ergoqp.recordings.names import nameless

_BLOCK: Final = 4 << 20
"""Bytes that are read at once."""
_COMPUTED: Final = ("FORCES", "MOMENTS", "POWERS", "SCALARS", "REACTIONS", "MODELED_MARKERS")
"""Groups of points that are computed and are not markers."""
_FARTHEST: Final = 1e9
"""Largest number of a point or an angle; larger ones are bits with another meaning."""
_SUBJECT: Final = "PROCESSING"
"""Group in which Vicon's programs store the measures of the person."""


def read_c3d(path: Path, progress: Progress, asked: Asked) -> JointMotion:
    """Return the labelled markers of a file, and its joint angles.

    A point that no camera sees, or at the origin, is not seen.

    Args:
        path: the file.
        progress: is called with the share of the file that is read.
        asked: unused, because a file states its rate.

    Raises:
        RecordingError: if it is not a C3D file, is cut, or has no labelled marker.
    """
    with binary(path) as file:
        head = read_head(path, file)
        count, said = frames_of(path, file, head, path.stat().st_size)
        labels, notes = _labels(head)
        bent_ones, computed = _named(head, "ANGLES"), _named(head, *_COMPUTED)
        angles = {name: i for name, i in labels.items() if _is(name, bent_ones)}
        markers = {
            name: i for name, i in labels.items() if name not in angles and not _is(name, computed)
        }
        if not markers:
            fail(
                path,
                f"got no marker with a name among {head.points} points, allowed labelled markers;"
                " label them in the program that recorded them",
            )
        positions, bent = _frames(
            file, head, count, list(markers.values()), list(angles.values()), progress
        )
    time, _, uniform = seconds(path.name, np.arange(count) / head.rate, 1.0)
    if others := len(labels) - len(markers) - len(angles):
        notes.append(f"{others} points are computed (forces, moments, powers) and left out.")
    units = head.text("POINT", "UNITS")
    unit = UNITS.get(units, UNITS_WORDS.get(units))
    if not head.text("POINT", "ANGLE_UNITS").startswith("rad"):
        bent *= np.float32(np.pi / 180)
    return JointMotion(
        tuple(markers),
        positions,
        time,
        None,
        (*head.notes, *said, *notes, *uniform, *repeated(positions)),
        angles={
            f"{name} {axis}": bent[:, i, j]
            for i, name in enumerate(angles)
            for j, axis in enumerate("xyz")
        },
        markers=True,
        unit=unit,
        measures=_measures(head, unit),
    )


def _named(head: Head, *groups: str) -> frozenset[str]:
    """Return the names of the points in some groups."""
    return frozenset(name for group in groups for name in head.texts("POINT", group) if name)


def _is(name: str, named: frozenset[str]) -> bool:
    """Return whether a point is among those of a group, whose names may lack the prefix."""
    return name in named or name.rpartition(":")[2] in named


def _labels(head: Head) -> tuple[dict[str, int], list[str]]:
    """Return name -> index of its point, for the points that have a name, and sentences."""
    stated = head.texts("POINT", "LABELS")
    notes: list[str] = []
    labels: dict[str, int] = {}
    twice: dict[str, None] = {}
    if len(stated) > head.points and any(stated[head.points :]):
        notes.append(
            f"The file names {len(stated)} points and has {head.points}: the first names are used."
        )
    lost = max(head.points - len(stated), 0)
    for i, name in enumerate(stated[: head.points]):
        if nameless(name):
            lost += 1
        elif name in labels:
            twice[name] = None
        else:
            labels[name] = i
    if lost:
        notes.append(f"{lost} of {head.points} points have no label and are left out.")
    if twice:
        notes.append(f"{some(list(twice))}: in the file twice; the first is used.")
    return labels, notes


def _frames(
    file: BinaryIO,
    head: Head,
    count: int,
    markers: list[int],
    angles: list[int],
    progress: Progress,
) -> tuple[np.ndarray, np.ndarray]:
    """Return positions (n, m, 3) of markers and values (n, a, 3) of angles."""
    length = head.frame_bytes
    positions = np.empty((count, len(markers), 3), dtype=np.float32)
    bent = np.empty((count, len(angles), 3), dtype=np.float32)
    file.seek(head.start)
    many = max(_BLOCK // length, 1)
    for at in range(0, count, many):
        now = min(many, count - at)
        with np.errstate(invalid="ignore", over="ignore"):  # some bits are not numbers
            points = _points(file.read(now * length), head, now)
            lost = ~(points[:, :, 3] >= 0) | ~(np.abs(points[:, :, :3]) <= _FARTHEST).all(axis=2)
            points[lost, :3] = np.nan
            bent[at : at + now] = points[:, angles, :3]
            places = points[:, markers, :3]
            places[(places == 0).all(axis=2)] = np.nan
        positions[at : at + now] = places
        progress((at + now) / count)
    return positions, bent


def _points(raw: bytes, head: Head, count: int) -> np.ndarray:
    """Return x, y, z [file unit] and a number that is negative if not seen (n, m, 4)."""
    of_points = 4 * head.points
    if head.scale < 0:
        values = head.numbers.floats(raw).reshape(count, -1)[:, :of_points]
        return values.reshape(count, head.points, 4)
    values = head.numbers.integers(raw).reshape(count, -1)[:, :of_points]
    points = values.reshape(count, head.points, 4).astype(np.float32)
    points[:, :, :3] *= head.scale
    return points


def _measures(head: Head, unit: float | None) -> dict[str, float]:
    """Return the measures of the person [m]; none if the unit is unknown."""
    found = {}
    for name in head.parameters.get(_SUBJECT, {}):
        value = head.number(_SUBJECT, name)
        if unit is not None and value is not None and 0 < value <= _FARTHEST:
            found[name.casefold()] = value * unit
    return found
