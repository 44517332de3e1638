"""Folders with one table of poses for each body: x, y, z and a unit quaternion in a row.

Such folders come from scripts of laboratories that log one rigid body or bone per file. A part of
the file names that is common to all files is not part of the body's name. With several people, the
beginning of the file name states the person.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.progress import Progress, part_of
from ergoqp.recordings.formats.body_names import names_of, of_people
from ergoqp.recordings.formats.body_turns import lengths_said, order_of
from ergoqp.recordings.formats.opening import binary, short
from ergoqp.recordings.formats.poses import poses_of, unit_turns
from ergoqp.recordings.formats.rows import Asked, Chosen, Gathered, blocks, cells, separator_of
from ergoqp.recordings.formats.stamps import repeated, seconds, steady, time_head
from ergoqp.recordings.formats.text_lines import TextLines
from ergoqp.recordings.motion import JointMotion

ENDINGS: Final = frozenset({".csv", ".txt"})
_PLACE: Final = ("x", "y", "z")
_ORDERS: Final = (
    (("q0", "q1", "q2", "q3"), None),
    (("qx", "qy", "qz", "qw"), (0, 1, 2, 3)),
    (("qw", "qx", "qy", "qz"), (1, 2, 3, 0)),
)
_LONGEST: Final = 2000
"""Largest number of bytes in the row of names."""


@dataclass(frozen=True)
class _Times:
    """The times of a table (n,) and their unit [s], which is None if the file does not state it."""

    stamps: np.ndarray
    tick: float | None


def is_folder_of_bodies(folder: Path) -> bool:
    """Return whether a folder has tables of poses."""
    return any(_head_of(path) is not None for path in _tables(folder))


def read_bodies(folder: Path, progress: Progress, asked: Asked) -> JointMotion:
    """Return the bodies of a folder; those that do not belong to a person are objects, too.

    Args:
        folder: the folder with one table per body, all with the same number of rows.
        progress: is called with the share that is read.
        asked: frames per second, used instead of the tables' times.

    Raises:
        RecordingError: if tables differ in length, or have no poses.
    """
    paths = [path for path in _tables(folder) if _head_of(path) is not None]
    if not paths:
        raise RecordingError(
            f"{folder.name}: got no table of poses, allowed one with the columns x, y, z, q0, q1,"
            " q2, q3 for each body"
        )
    places: dict[str, np.ndarray] = {}
    quaternions: dict[str, np.ndarray] = {}
    orders: dict[str, tuple[int, ...] | None] = {}
    times: dict[str, _Times] = {}
    for i, (name, path) in enumerate(zip(names_of(paths), paths, strict=True)):
        share = part_of(progress, i / len(paths), (i + 1) / len(paths))
        places[name], quaternions[name], orders[name], found = _read(path, share)
        if found is not None:
            times[name] = found
        elif asked.rate is None:
            raise RecordingError(
                f"{folder.name}: got tables of poses without times, allowed a column that is called"
                " time or timestamp, or stated frames per second (rate)"
            )
    counts = {len(place) for place in places.values()}
    if len(counts) > 1:
        least, most = (
            min(places, key=lambda n: len(places[n])),
            max(places, key=lambda n: len(places[n])),
        )
        raise RecordingError(
            f"{folder.name}: got {len(places[least])} rows for {least} and {len(places[most])} for"
            f" {most}, allowed the same number for each body"
        )
    positions = np.stack(list(places.values()), axis=1)
    time, kept, notes = _timed(folder.name, times, asked.rate, [positions, *quaternions.values()])
    order = None
    if untold := [name for name in orders if orders[name] is None]:
        order, said = order_of(places, {name: quaternions[name] for name in untold})
        notes.append(said)
    notes += lengths_said(quaternions)
    turns = {n: unit_turns(quaternions.pop(n)[:, orders[n] or order]) for n in places}
    names, own = tuple(places), of_people(paths)
    places.clear()
    if not kept.all():
        positions, turns = positions[kept], {name: each[kept] for name, each in turns.items()}
    return JointMotion(
        names,
        positions,
        time,
        None,
        (*notes, *repeated(positions)),
        turns=turns,
        objects={
            name: poses_of(positions[:, i], turns[name])
            for i, name in enumerate(names)
            if not own[i]
        },
    )


def _tables(folder: Path) -> list[Path]:
    try:
        found = sorted(folder.iterdir())
        return [path for path in found if path.suffix.lower() in ENDINGS and path.is_file()]
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise RecordingError(
            f"{short(folder.name or str(folder))} cannot be read: {reason}, allowed a folder"
        ) from None


def _head_of(path: Path) -> tuple[list[str], str | None] | None:
    """Return the names of a table's columns and their separator; None if it has no poses."""
    with binary(path) as file:
        row = file.readline(_LONGEST).decode("utf-8-sig", "replace").strip().lower()
    separator = separator_of(row)
    columns = cells(row, separator)
    return (columns, separator) if set(_PLACE) <= set(columns) and _turn(columns) else None


def _turn(columns: list[str]) -> tuple[tuple[str, ...], tuple[int, ...] | None] | None:
    """Return the names of a quaternion's columns, and their order x, y, z, w if it is stated."""
    for names, order in _ORDERS:
        if set(names) <= set(columns):
            return names, order
    return None


def _timed(
    where: str, times: dict[str, _Times], rate: float | None, shown: list[np.ndarray]
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Return the times of frames [s], which of them are kept, and sentences.

    Args:
        where: the folder's name, for messages.
        times: body -> times, for the tables that have them.
        rate: stated frames per second, used instead of the tables' times.
        shown: content of the frames.

    Raises:
        RecordingError: if bodies have different times, or the times are invalid.
    """
    if rate is not None:
        time, notes = steady(where, len(shown[0]), rate)
        if times:
            notes.append(
                "The times of the tables are not used: the frames per second are stated (rate)."
            )
        return time, np.ones(len(time), dtype=bool), notes
    first, own = next(iter(times.items()))
    steps = np.diff(own.stamps)
    # A script that logs one body after the other stamps each a little later.
    slack = 0.5 * float(np.median(steps)) if len(steps) else 0.0
    for name, each in times.items():
        if each.tick != own.tick or not (np.abs(each.stamps - own.stamps) <= abs(slack)).all():
            raise RecordingError(
                f"{where}: got other times for {name} than for {first}, allowed the same times for"
                " each body; or state the frames per second (rate)"
            )
    remedy = "; or state the frames per second (rate)"
    return seconds(where, own.stamps, own.tick, shown, remedy)


def _read(
    path: Path, progress: Progress
) -> tuple[np.ndarray, np.ndarray, tuple[int, ...] | None, _Times | None]:
    """Return positions, quaternions, and the quaternions' order and the times if it has them."""
    head = _head_of(path)
    if head is None or (turn := _turn(head[0])) is None:
        raise RecordingError(f"{path.name}, line 1: got other names than x, y, z, q0, q1, q2, q3")
    (columns, separator), (names, order) = head, turn
    clock, tick = next(
        ((i, tick) for i, (is_time, tick) in enumerate(map(time_head, columns)) if is_time),
        (None, None),
    )
    rows, stamps = Gathered(), Gathered()
    with binary(path) as file:
        lines = TextLines(path, file, path.stat().st_size, progress)
        lines.next("the names of the columns")
        wanted = [*_PLACE, *names]
        if twice := [name for name in wanted if columns.count(name) > 1]:
            lines.fail(f"got the column {twice[0]} twice, allowed each once")
        taken = [columns.index(name) for name in wanted]
        chosen = Chosen(taken if clock is None else [*taken, clock])
        for values in blocks(lines, separator, len(columns), clock is None, chosen):
            rows.add(values[:, : len(taken)].astype(np.float32), lines.share)
            if clock is not None:
                stamps.add(values[:, -1], lines.share)
    if not rows:
        raise RecordingError(f"{path.name}: got no row below the names, allowed rows of poses")
    times = None if clock is None else _Times(stamps.whole, tick)
    return rows.whole[:, :3], rows.whole[:, 3:], order, times
