"""Folders with one table of poses for each body: x, y, z and a unit quaternion in a row.

Folders with one table of poses for each body: x, y, z and a unit quaternion in a row.

Such folders come from scripts of laboratories that log one rigid body or bone per file. A part of
the file names that is common to all files is not part of the body's name. With several people, the
beginning of the file name states the person.
"""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from ergoqp.arguments import Progress, part_of
from ergoqp.errors import RecordingError
from ergoqp.mocap.formats.text import (
    Asked,
    Chosen,
    Gathered,
    TextLines,
    binary,
    blocks,
    cells,
    poses_of,
    repeated,
    seconds,
    separator_of,
    short,
    some,
    steady,
    time_head,
    unit_turns,
)
from ergoqp.mocap.recording import JointMotion

_LEAST: Final = 6
"""Least number of bodies of each of several people."""
_MARKS: Final = "_-. "
_SIDES: Final = frozenset({"left", "right", "l", "r"})


def names_of(paths: list[Path]) -> list[str]:
    """Return the bodies' names: the file names without a shared start and end, up to a mark.

    Bodies of several people get the person as a prefix: "giver:head".
    """
    stems = [path.stem for path in paths]
    if len(set(stems)) < len(stems):
        return [path.name for path in paths]
    if len(stems) < 2:
        return stems
    begins = Counter(map(_first, stems))
    most = max(begins, key=lambda begin: begins[begin])
    ends = itertools.takewhile(
        lambda letters: len(set(letters)) == 1, zip(*map(reversed, stems), strict=False)
    )
    shared = "".join(letters[0] for letters in ends)[::-1]
    cut = re.search(r"[_\-. ].*", shared)
    behind = cut.group(0) if cut else ""
    names = [stem.removesuffix(behind) if behind else stem for stem in stems]
    if people := _people(stems):
        names = [
            f"{begin.rstrip(_MARKS)}:{name.removeprefix(begin)}" if begin in people else name
            for name, begin in zip(names, map(_first, stems), strict=True)
        ]
        empty = any(name.endswith(":") for name in names)
        return stems if empty or len(set(names)) < len(names) else names
    many = sum(_first(name) == most for name in names) > 1
    names = [name.removeprefix(most) if many else name for name in names]
    return names if len(set(names)) == len(names) and all(names) else stems


def of_people(paths: list[Path]) -> list[bool]:
    """Return which bodies are a person's: those with a common start, if others have another."""
    stems = [path.stem for path in paths]
    begins = list(map(_first, stems))
    if people := _people(stems):
        return [begin in people for begin in begins]
    most = max(begins, key=begins.count)
    alike = [begin == most for begin in begins]
    return alike if 1 < sum(alike) < len(alike) else [False] * len(alike)


def _people(stems: list[str]) -> set[str]:
    """Return the starts of names with enough bodies for a person, if there are at least two."""
    begins = Counter(begin for stem in stems if (begin := _first(stem)) != stem)
    found = {begin for begin, count in begins.items() if count >= _LEAST}
    return found if len(found) > 1 else set()


def _first(stem: str) -> str:
    """Return the start of a name up to a mark; the whole name without a mark or if it is a side."""
    match = re.match(r"[^_\-. ]+[_\-. ]", stem)
    sided = match and match.group(0)[:-1].casefold() in _SIDES
    return match.group(0) if match and not sided else stem


_LOOKED_AT: Final = 500
"""Frames from which the order of quaternions is found, about."""
_USUAL: Final = "x, y, z, w"
_SURELY: Final = 0.8
"""With the right order, neighbours move by less than this share of what they do with the wrong."""
_STILL: Final = 1e-3
"""Movement below this share of the distance between bodies is no evidence."""


def order_of(
    places: dict[str, np.ndarray], turns: dict[str, np.ndarray]
) -> tuple[tuple[int, ...], str]:
    """Return the columns of x, y, z and w, and a sentence about how they were found.

    With the right order, a neighbour's place in a bone's axes is fixed.

    Args:
        places: name of a body -> positions (n, 3).
        turns: name of a body whose order is unknown -> its quaternions (n, 4).
    """
    orders = {"x, y, z, w": (0, 1, 2, 3), "w, x, y, z": (1, 2, 3, 0)}
    if len(places) < 2:
        return orders[_USUAL], (
            f"The quaternions are taken as {_USUAL}, because one body does not show their order."
        )
    every = max(1, len(next(iter(places.values()))) // _LOOKED_AT)
    near = {name: place[::every].astype(float) for name, place in places.items()}
    offsets = {name: _offsets(near, name) for name in turns}
    spread = {}
    for words, order in orders.items():
        least = []
        for name, turn in turns.items():
            bone = unit_turns(turn[::every][:, order].astype(float))
            least.append(min((_wanders(bone, each) for each in offsets[name]), default=np.inf))
        known = [each for each in least if each < np.inf]
        spread[words] = float(np.median(known)) if known else 0.0
    best = min(spread, key=lambda words: spread[words])
    most = max(spread.values())
    if spread[best] >= _SURELY * most or most < _STILL * _size(offsets.values()):
        return orders[_USUAL], (
            f"The quaternions are taken as {_USUAL}, because the movement does not show their"
            " order: with either order, a bone's neighbour moves in its axes by about"
            f" {1000 * spread[_USUAL]:.0f} mm (if the file's unit is a metre)."
        )
    return orders[best], (
        f"The quaternions are taken as {best}: a bone's neighbour then moves in its axes by"
        f" {1000 * spread[best]:.0f} mm, and with the other order by"
        f" {1000 * most:.0f} mm (if the file's unit is a metre)."
    )


def _wanders(turns: np.ndarray, offsets: np.ndarray) -> float:
    """Return how much a point moves in the axes of a body; infinite if it is not seen."""
    from scipy.spatial.transform import Rotation

    seen = np.isfinite(turns).all(axis=1) & np.isfinite(offsets).all(axis=1)
    if np.count_nonzero(seen) < 2:
        return np.inf
    fixed = Rotation.from_quat(turns[seen]).inv().apply(offsets[seen])
    return float(np.std(fixed, axis=0).max())


def _offsets(places: Mapping[str, np.ndarray], name: str) -> list[np.ndarray]:
    """Return the vectors from one body to each other (n, 3), without bodies at the same place."""
    found = [each - places[name] for other, each in places.items() if other != name]
    return [each for each in found if np.isfinite(each).any() and np.nanmax(np.abs(each)) > 0]


def _size(offsets: Iterable[list[np.ndarray]]) -> float:
    """Return the median distance of a body from its nearest neighbour."""
    nearest = [
        min(float(np.nanmedian(np.linalg.norm(each, axis=1))) for each in others)
        for others in offsets
        if others
    ]
    return float(np.median(nearest)) if nearest else 0.0


def lengths_said(turns: Mapping[str, np.ndarray]) -> list[str]:
    """Return a sentence with the bodies whose quaternions (n, 4) are not of length 1."""
    found = []
    for name, each in turns.items():
        told = np.isfinite(each).all(axis=1) & each.any(axis=1)
        lost = told & ~np.isfinite(unit_turns(each)).all(axis=1)
        if lost.any():
            length = float(np.median(np.linalg.norm(each[lost].astype(float), axis=1)))
            count = np.count_nonzero(lost)
            found.append(f"{name} ({count} of {len(each)}, {length:.3g} in the median)")
    if not found:
        return []
    return [f"Quaternions whose length is not 1 are not read: of {some(found, 30)}."]


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
