"""OptiTrack Motive's export of a take: bones, rigid bodies and markers as CSV.

Seven rows stand above the numbers: the take, a blank, the type of each column, the name, its ID,
the measured quantity, and the axis (OptiTrack, "Data Export: CSV"; tried on files by others of the
versions 1.21 and 1.23).
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from ergoqp.arguments import Progress
from ergoqp.errors import RecordingError
from ergoqp.mocap.formats.text import (
    TableOptions,
    TextLines,
    cells,
    is_number,
    points_of,
    read_rows,
    short,
    text_lines,
)
from ergoqp.mocap.formats.turns import UnitTurns, poses_of
from ergoqp.mocap.recording import JointMotion, count_note, with_times

_UNITS: Final = {"meters": 1.0, "centimeters": 0.01, "millimeters": 0.001}
_AXES: Final = {"Position": "XYZ", "Rotation": "XYZW"}


_STATED: Final = (
    "Format Version",
    "Export Frame Rate",
    "Total Exported Frames",
    "Rotation Type",
    "Length Units",
    "Coordinate Space",
)
_ROUNDED: Final = 0.6e-3
"""Largest error of times that are rounded to whole milliseconds [s]."""


@dataclass
class _Thing:
    """A thing that Motive tracks: a bone, a rigid body or a marker.

    Attributes:
        kind: Motive's type.
        name: Motive's name; things of different types may have the same name.
        columns: "Position" or "Rotation" -> axis -> column.
    """

    kind: str
    name: str
    columns: dict[str, dict[str, int]] = field(default_factory=dict)

    def of(self, what: str) -> list[int] | None:
        """Return the columns of its position or rotation; None if there are none."""
        found = self.columns.get(what, {})
        axes = _AXES[what]
        return [found[axis] for axis in axes] if all(axis in found for axis in axes) else None


def read_motive(path: Path, progress: Progress, asked: TableOptions) -> JointMotion:
    """Return bones and rigid bodies of a take, or its labelled markers if it has no bones.

    Args:
        path: the file.
        progress: is called with the share of the file that is read.
        asked: unused, because a take states its rate.

    Raises:
        RecordingError: if it is not such a take, or nothing is tracked in it.
    """
    with text_lines(path, progress) as lines:
        stated = _stated(lines)
        things, width = _things(lines)
        bones = _named(t for t in things if t.kind == "Bone")
        bodies = _named(t for t in things if t.kind == "Rigid Body")
        markers = _named(
            t
            for t in things
            if t.kind in {"Marker", "Bone Marker"} and not t.name.startswith("Unlabeled")
        )
        points = bones or {**markers, **bodies}
        if not points:
            raise RecordingError(
                f"{path.name}: got a take in which nothing is tracked, allowed bones, rigid bodies"
                " or labelled markers; export the take with its skeletons and rigid bodies"
            )
        others = {n: t for n, t in bodies.items() if points.get(n) is not t}
        again = [t for t in things if t.name in points and _again(t, points[t.name])]
        taken = [*points.values(), *again, *others.values()]
        oriented = [thing for thing in taken if thing.of("Rotation")]
        columns = [c for thing in taken for c in thing.of("Position") or ()]
        turning = [c for thing in oriented for c in thing.of("Rotation") or ()]
        turns = UnitTurns()
        numbered, positions, quaternions = read_rows(
            lines,
            ",",
            width,
            lambda rows: (
                rows[:, :2],
                points_of(rows[:, columns]),
                turns.of(rows[:, turning].reshape(len(rows), -1, 4)).astype(np.float32),
            ),
        )
    units = {id(thing): quaternions[:, i] for i, thing in enumerate(oriented)}
    objects = {
        thing.name: poses_of(positions[:, i], units[id(thing)])
        for i, thing in enumerate(taken)
        if thing.kind == "Rigid Body" and id(thing) in units
    }
    motion = JointMotion(
        (*points, *(thing.name for thing in again)),
        positions[:, : len(points) + len(again)],
        _times(numbered, stated),
        notes=(
            *count_note(stated.get("Total Exported Frames", ""), len(positions), "frames"),
            *turns.said(),
        ),
        turns={n: units[id(thing)] for n, thing in points.items() if id(thing) in units},
        objects=objects,
        markers=not bones and any(t.kind != "Rigid Body" for t in points.values()),
        unit=_UNITS.get(stated.get("Length Units", "").lower()),
    )
    return with_times(path.name, motion.once(), shown=[positions, quaternions])


def _named(things: Iterable[_Thing]) -> dict[str, _Thing]:
    """Return name -> the first of the things with that name."""
    found: dict[str, _Thing] = {}
    for thing in things:
        found.setdefault(thing.name, thing)
    return found


def _again(thing: _Thing, first: _Thing) -> bool:
    """Return whether a thing repeats another one of the same type and name."""
    return thing is not first and thing.kind == first.kind


def _stated(lines: TextLines) -> Mapping[str, str]:
    """Return the keys and values in the first row."""
    words = cells(lines.next("the row 'Format Version'"), ",")
    # Names and notes of takes may contain commas, so not every second word is a key.
    stated = {key: value for key, value in itertools.pairwise([*words, ""]) if key in _STATED}
    if "Format Version" not in stated:
        lines.fail(f"got {short(words[0])}, allowed 'Format Version'")
    rotation = stated.get("Rotation Type", "Quaternion")
    if rotation != "Quaternion":
        lines.fail(
            f"Rotation Type: got {short(rotation)}, allowed Quaternion: Motive's other types are"
            " not read; export the take with quaternions"
        )
    space = stated.get("Coordinate Space", "Global")
    if space != "Global":
        lines.fail(f"Coordinate Space: got {short(space)}, allowed Global: export the take with it")
    return stated


def _things(lines: TextLines) -> tuple[list[_Thing], int]:
    """Return the tracked things that have a position, and the number of columns."""
    head: list[list[str]] = []
    while not head or head[-1][:1] != ["Frame"]:
        row = cells(lines.next("the row 'Frame'"), ",")
        if any(row):
            head.append(row)
        if len(head) > 8 or lines.line > 100:
            lines.fail("got more than 8 rows above the numbers, allowed those of a take")
    if len(head) < 4:
        lines.fail(
            "got too few rows above the numbers, allowed type, name, ID, measured quantity and axis"
        )
    kinds, names, *_, what, axes = head
    if not "".join(axes[1:2]).startswith("Time"):
        lines.fail(f"got the second column {short(''.join(axes[1:2]))}, allowed Time (Seconds)")
    things: dict[tuple[str, str], list[_Thing]] = {}
    for column in range(2, min(map(len, (kinds, names, what, axes)))):
        kind, name = kinds[column], names[column]
        if axes[column] and name:
            copies = things.setdefault((kind, name), [_Thing(kind, name)])
            if axes[column] in copies[-1].columns.get(what[column], {}):
                copies.append(_Thing(kind, name))
            copies[-1].columns.setdefault(what[column], {})[axes[column]] = column
    every = (thing for copies in things.values() for thing in copies)
    return [thing for thing in every if thing.of("Position")], len(axes)


def _times(numbered: np.ndarray, stated: Mapping[str, str]) -> np.ndarray:
    """Return the times of frames [s], from the rate if that agrees with the rounded times.

    Args:
        numbered: number and time of each frame (n, 2).
        stated: keys and values in the first row.
    """
    frames, stamps = numbered.T
    rate = stated.get("Export Frame Rate", "").replace(",", ".")
    if is_number(rate) and 1.0 <= float(rate) <= 10_000.0:
        exact = stamps[0] + (frames - frames[0]) / float(rate)
        if (np.abs(exact - stamps) < _ROUNDED).all():
            return exact
    return stamps
