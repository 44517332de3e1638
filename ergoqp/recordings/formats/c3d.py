"""C3D files: markers of motion laboratories, with the angles that their programs computed.

The frames are read block by block: an hour is larger than memory should be. Points that are no
markers (joint centres, forces, moments, powers of the laboratory's own model) are not taken as
such; its angles are handed on.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import BinaryIO, Final

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.progress import Progress
from ergoqp.recordings.formats.c3d_head import Head, read_head
from ergoqp.recordings.formats.opening import binary
from ergoqp.recordings.formats.rows import Asked
from ergoqp.recordings.formats.stamps import seconds
from ergoqp.recordings.formats.trc import UNITS
from ergoqp.recordings.motion import JointMotion

_BLOCK: Final = 4 << 20
"""Bytes that are read at once."""
_COMPUTED: Final = ("FORCES", "MOMENTS", "POWERS", "SCALARS", "REACTIONS", "MODELED_MARKERS")
"""Groups of points that are computed and no markers."""
_NAMELESS: Final = re.compile(r"[*U]?\d*|unlabell?ed.*", re.IGNORECASE)
"""Names that programs give to what was not labelled."""
_SUBJECT: Final = "PROCESSING"
"""Where Vicon's programs keep what was measured at the person."""


def read_c3d(path: Path, progress: Progress, asked: Asked) -> JointMotion:
    """Return the labelled markers of a file, and the angles that it has.

    A point without camera or at the origin is not seen.

    Args:
        path: the file.
        progress: told how much of it is read.
        asked: unused, a file states its rate.

    Raises:
        RecordingError: it is no C3D file, cut, or has no labelled marker.
    """
    size = path.stat().st_size if path.is_file() else 0
    with binary(path) as file:
        head = read_head(path, file, size)
        labels, notes = _labels(head)
        angles = {name: i for name, i in labels.items() if name in head.texts("POINT", "ANGLES")}
        other = {name for group in _COMPUTED for name in head.texts("POINT", group)}
        markers = {n: i for n, i in labels.items() if n not in angles and n not in other}
        if not markers:
            raise RecordingError(
                f"{path.name}: got {head.points} points without a name, allowed labelled markers;"
                " label them in the program that recorded them"
            )
        positions, bent = _frames(
            file, head, list(markers.values()), list(angles.values()), progress
        )
    time, _, said = seconds(path.name, np.arange(len(positions)) / head.rate, 1.0)
    if computed := len(labels) - len(markers) - len(angles):
        notes.append(f"{computed} points are computed (forces, moments, powers) and left out.")
    degrees = str(head.of("POINT", "ANGLE_UNITS") or "deg").lower().startswith("deg")
    units = head.of("POINT", "UNITS")
    unit = UNITS.get((units if isinstance(units, str) else "").lower())
    return JointMotion(
        tuple(markers),
        positions,
        time,
        None,
        (*notes, *said),
        angles={
            f"{name} {axis}": bent[:, i, j] * (np.pi / 180 if degrees else 1)
            for i, name in enumerate(angles)
            for j, axis in enumerate("xyz")
        },
        markers=True,
        unit=unit,
        measures=_measures(head, unit),
    )


def _labels(head: Head) -> tuple[dict[str, int], list[str]]:
    """Return name -> the place of its point, for those that have a name, and sentences."""
    stated = head.texts("POINT", "LABELS")
    notes, labels, twice = [], {}, []
    if len(stated) > head.points and any(stated[head.points :]):
        notes.append(
            f"The file names {len(stated)} points and has {head.points}: the first names are"
            " theirs."
        )
    nameless = max(head.points - len(stated), 0)
    for i, name in enumerate(stated[: head.points]):
        if _NAMELESS.fullmatch(name.rpartition(":")[2]):
            nameless += 1
        elif name in labels:
            twice.append(name)
        else:
            labels[name] = i
    if nameless:
        notes.append(f"{nameless} of {head.points} points have no label and are left out.")
    if twice:
        notes.append(f"{', '.join(twice)}: there twice; the first is taken.")
    return labels, notes


def _frames(
    file: BinaryIO, head: Head, markers: list[int], angles: list[int], progress: Progress
) -> tuple[np.ndarray, np.ndarray]:
    """Return positions (n, m, 3) of markers and values (n, a, 3) of angles."""
    count, length = head.frames, head.frame_bytes
    positions = np.empty((count, len(markers), 3), dtype=np.float32)
    bent = np.empty((count, len(angles), 3), dtype=np.float32)
    file.seek(head.start)
    many = max(_BLOCK // length, 1)
    for at in range(0, count, many):
        now = min(many, count - at)
        points = _points(file.read(now * length), head, now)
        seen = points[:, :, 3] >= 0
        places = points[:, markers, :3]
        lost = ~seen[:, markers] | (places == 0).all(axis=2) | ~np.isfinite(places).all(axis=2)
        positions[at : at + now] = np.where(lost[:, :, None], np.nan, places)
        bent[at : at + now] = np.where(seen[:, angles, None], points[:, angles, :3], np.nan)
        progress((at + now) / count)
    return positions, bent


def _points(raw: bytes, head: Head, count: int) -> np.ndarray:
    """Return x, y, z [file unit] and a number that is negative where nothing is seen (n, m, 4)."""
    of_points = 4 * head.points
    if head.scale < 0:
        values = head.numbers.floats(raw).reshape(count, -1)[:, :of_points]
        return values.reshape(count, head.points, 4)
    values = head.numbers.integers(raw).reshape(count, -1)[:, :of_points]
    points = values.reshape(count, head.points, 4).astype(np.float32)
    points[:, :, :3] *= head.scale
    return points


def _measures(head: Head, unit: float | None) -> dict[str, float]:
    """Return what was measured at the person [m]."""
    found = {}
    for name in head.parameters.get(_SUBJECT, {}):
        value = head.number(_SUBJECT, name)
        if value is not None and np.isfinite(value) and value > 0:
            found[name.casefold()] = value * (unit or 1.0)
    return found
