"""OptiTrack Motive's export of a take: bones, rigid bodies and markers as CSV.

Seven rows stand above the numbers: the take, a blank, the type of each column, the name, its ID,
what it measures, and the axis (OptiTrack, "Data Export: CSV"; versions 1.21 and 1.23 were read as
files of others).
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.progress import Progress
from ergoqp.recordings.formats.opening import binary, short
from ergoqp.recordings.formats.poses import poses_of, unit_turns
from ergoqp.recordings.formats.rows import Asked, TextLines, blocks, gathered
from ergoqp.recordings.formats.stamps import repeated, seconds
from ergoqp.recordings.motion import JointMotion

_UNITS: Final = {"meters": 1.0, "centimeters": 0.01, "millimeters": 0.001}
_AXES: Final = {"Position": "XYZ", "Rotation": "XYZW"}


@dataclass
class _Thing:
    """What Motive tracks: a bone, a rigid body or a marker.

    Attributes:
        kind: Motive's type.
        columns: "Position" or "Rotation" -> axis -> column.
    """

    kind: str
    columns: dict[str, dict[str, int]] = field(default_factory=dict)

    def of(self, what: str) -> list[int] | None:
        """Return the columns of its position or rotation; None if there are none."""
        found = self.columns.get(what, {})
        axes = _AXES[what]
        return [found[axis] for axis in axes] if all(axis in found for axis in axes) else None


def read_motive(path: Path, progress: Progress, asked: Asked) -> JointMotion:
    """Return bones and rigid bodies of a take, or its labelled markers if it has no bones.

    Args:
        path: the file.
        progress: told how much of it is read.
        asked: unused, a take states its rate.

    Raises:
        RecordingError: it is no such take, or nothing is tracked in it.
    """
    with binary(path) as file:
        lines = TextLines(path, file, path.stat().st_size, progress)
        stated = _stated(lines)
        things, width = _things(lines)
        bones = {name: thing for name, thing in things.items() if thing.kind == "Bone"}
        bodies = {name: thing for name, thing in things.items() if thing.kind == "Rigid Body"}
        points = bones or {
            name: thing
            for name, thing in things.items()
            if thing.kind in {"Marker", "Bone Marker"} and not name.startswith("Unlabeled")
        }
        points = points if bones else {**points, **bodies}
        if not points:
            raise RecordingError(
                f"{path.name}: got a take in which nothing is tracked, allowed bones, rigid bodies"
                " or labelled markers; export the take with its skeletons and rigid bodies"
            )
        oriented = bones if bones else bodies
        kept = {**points, **bodies}
        rows = blocks(lines, ",", width)
        columns = [c for thing in kept.values() for c in thing.of("Position") or ()]
        turning = {n: t.of("Rotation") for n, t in {**oriented, **bodies}.items()}
        quats = [c for each in turning.values() if each for c in each]
        stamps, places, turns = [], [], []
        for values in rows:
            stamps.append(values[:, 1])
            places.append(values[:, columns].astype(np.float32).reshape(len(values), -1, 3))
            turns.append(values[:, quats].astype(np.float32).reshape(len(values), -1, 4))
        if not stamps:
            raise RecordingError(f"{path.name}: got no frame, allowed a take with movement in it")
    positions, quaternions = gathered(places), gathered(turns)
    time, good, notes = seconds(path.name, np.concatenate(stamps), 1.0)
    positions, quaternions = positions[good], quaternions[good]
    have = [name for name, each in turning.items() if each]
    oriented_turns = {name: unit_turns(quaternions[:, i]) for i, name in enumerate(have)}
    names = list(kept)
    objects = {
        name: poses_of(positions[:, names.index(name)], oriented_turns[name])
        for name in bodies
        if name in oriented_turns
    }
    notes += _counted(path, stated, len(good))
    places_kept = [names.index(name) for name in points]
    return JointMotion(
        tuple(points),
        positions[:, places_kept],
        time,
        None,
        (*notes, *repeated(positions)),
        turns={name: each for name, each in oriented_turns.items() if name in points},
        objects=objects,
        markers=not bones and any(t.kind != "Rigid Body" for t in points.values()),
        unit=_UNITS.get(stated.get("Length Units", "").lower()),
    )


def _stated(lines: TextLines) -> Mapping[str, str]:
    """Return what the first row says."""
    words = next(csv.reader([lines.next("the row 'Format Version'")]))
    stated = dict(zip(words[::2], words[1::2], strict=False))
    if "Format Version" not in stated:
        lines.fail(f"got {short(words[0])}, allowed 'Format Version'")
    rotation = stated.get("Rotation Type", "Quaternion")
    if rotation != "Quaternion":
        lines.fail(
            f"Rotation Type: got {short(rotation)}, allowed Quaternion: Motive's other ones are not"
            " read; export the take with it"
        )
    space = stated.get("Coordinate Space", "Global")
    if space != "Global":
        lines.fail(f"Coordinate Space: got {short(space)}, allowed Global: export the take with it")
    return stated


def _things(lines: TextLines) -> tuple[dict[str, _Thing], int]:
    """Return what is tracked, by name, and how many columns there are."""
    head: list[list[str]] = []
    while not head or head[-1][:1] != ["Frame"]:
        row = next(csv.reader([lines.next("the row 'Frame'")]), [])
        if any(row):
            head.append([word.strip() for word in row])
        if len(head) > 8:
            lines.fail("got more than 8 rows above the numbers, allowed a take's")
    if len(head) < 4:
        lines.fail("got too few rows above the numbers, allowed type, name, ID, what and axis")
    axes, what = head[-1], head[-2]
    kinds, names = head[0], head[1]
    things: dict[str, _Thing] = {}
    for column in range(2, len(axes)):
        if column >= min(len(kinds), len(names), len(what)) or not axes[column]:
            continue
        thing = things.setdefault(names[column], _Thing(kinds[column]))
        # A rigid body's solved markers and a marker may share its name.
        if thing.kind == kinds[column]:
            thing.columns.setdefault(what[column], {})[axes[column]] = column
    return {n: t for n, t in things.items() if t.of("Position")}, len(axes)


def _counted(path: Path, stated: Mapping[str, str], found: int) -> list[str]:
    total = stated.get("Total Exported Frames", "")
    if total.isdigit() and int(total) != found:
        if int(total) > found:
            raise RecordingError(
                f"{path.name}: got {found} frames, allowed {total}, as is stated; the recording is"
                " cut"
            )
        return [f"The file states {total} frames and has {found}: all are read."]
    return []
