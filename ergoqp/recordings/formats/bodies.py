"""Folders with one table of poses for each body: x, y, z and a unit quaternion in a row.

Such folders come from scripts of laboratories that log one rigid body or bone a file. What stands
before the body's name in all files, and behind it, is no part of it.
"""

from __future__ import annotations

import itertools
import re
from collections import Counter
from pathlib import Path
from typing import Final

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.progress import Progress, part_of
from ergoqp.recordings.formats.opening import binary, short
from ergoqp.recordings.formats.poses import poses_of, unit_turns
from ergoqp.recordings.formats.rows import Asked, Gathered, TextLines, blocks, cells, separator_of
from ergoqp.recordings.formats.stamps import repeated, steady
from ergoqp.recordings.motion import JointMotion

ENDINGS: Final = frozenset({".csv", ".txt"})
_PLACE: Final = ("x", "y", "z")
_ORDERS: Final = (
    (("q0", "q1", "q2", "q3"), None),
    (("qx", "qy", "qz", "qw"), (0, 1, 2, 3)),
    (("qw", "qx", "qy", "qz"), (1, 2, 3, 0)),
)
_LONGEST: Final = 2000
"""Letters in the row of names, at most."""
_LOOKED_AT: Final = 500
"""Frames by which the order of quaternions is found, about."""


def is_folder_of_bodies(folder: Path) -> bool:
    """Return whether a folder has tables of poses."""
    return any(_head_of(path) is not None for path in _tables(folder))


def read_bodies(folder: Path, progress: Progress, asked: Asked) -> JointMotion:
    """Return the bodies of a folder; those that do not belong to a person are objects too.

    Args:
        folder: with one table for each body, all of as many rows.
        progress: told how much of it is read.
        asked: frames per second.

    Raises:
        RecordingError: tables differ in length, or are no poses.
    """
    paths = [path for path in _tables(folder) if _head_of(path) is not None]
    if not paths:
        raise RecordingError(
            f"{folder.name}: got no table of poses, allowed one with the columns x, y, z, q0, q1,"
            " q2, q3 for each body"
        )
    if asked.rate is None:
        raise RecordingError(
            f"{folder.name}: got tables of poses without times, allowed with the frames per second"
            " stated (rate)"
        )
    places: dict[str, np.ndarray] = {}
    quaternions: dict[str, np.ndarray] = {}
    orders: dict[str, tuple[int, ...] | None] = {}
    for i, (name, path) in enumerate(zip(_names(paths), paths, strict=True)):
        share = part_of(progress, i / len(paths), (i + 1) / len(paths))
        places[name], quaternions[name], orders[name] = _read(path, share)
    counts = {len(place) for place in places.values()}
    if len(counts) > 1:
        least, most = (
            min(places, key=lambda n: len(places[n])),
            max(places, key=lambda n: len(places[n])),
        )
        raise RecordingError(
            f"{folder.name}: got {len(places[least])} rows for {least} and {len(places[most])} for"
            f" {most}, allowed as many for each body"
        )
    positions = np.stack(list(places.values()), axis=1)
    time, notes = steady(folder.name, len(positions), asked.rate)
    order = None
    if untold := [name for name in orders if orders[name] is None]:
        order, said = _order(places, {name: quaternions[name] for name in untold})
        notes.append(said)
    turns = {n: unit_turns(quaternions.pop(n)[:, orders[n] or order]) for n in places}
    names, own = tuple(places), _person_of(paths)
    places.clear()
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
    """Return the names of a table's columns and what parts them; None if it has no poses."""
    with binary(path) as file:
        row = file.readline(_LONGEST).decode("utf-8-sig", "replace").strip().lower()
    separator = separator_of(row)
    columns = cells(row, separator)
    return (columns, separator) if set(_PLACE) <= set(columns) and _turn(columns) else None


def _turn(columns: list[str]) -> tuple[tuple[str, ...], tuple[int, ...] | None] | None:
    """Return the names of the quaternion's columns and their order x, y, z, w, if they tell it."""
    for names, order in _ORDERS:
        if set(names) <= set(columns):
            return names, order
    return None


def _read(path: Path, progress: Progress) -> tuple[np.ndarray, np.ndarray, tuple[int, ...] | None]:
    """Return the places and quaternions of a table, and the order of the latter if it is told."""
    head = _head_of(path)
    if head is None or (turn := _turn(head[0])) is None:
        raise RecordingError(f"{path.name}, line 1: got other names than x, y, z, q0, q1, q2, q3")
    (columns, separator), (names, order) = head, turn
    rows = Gathered()
    with binary(path) as file:
        lines = TextLines(path, file, path.stat().st_size, progress)
        lines.next("the names of the columns")
        chosen = [*_PLACE, *names]
        if twice := [name for name in chosen if columns.count(name) > 1]:
            lines.fail(f"got the column {twice[0]} twice, allowed each once")
        taken = [columns.index(name) for name in chosen]
        for values in blocks(lines, separator, len(columns), blanks=True):
            rows.add(values[:, taken].astype(np.float32), lines.share)
    if not rows:
        raise RecordingError(f"{path.name}: got no row below the names, allowed poses")
    return rows.whole[:, :3], rows.whole[:, 3:], order


def _order(
    places: dict[str, np.ndarray], turns: dict[str, np.ndarray]
) -> tuple[tuple[int, ...], str]:
    """Return which column is x, y, z and w, and how it was found.

    In the right order the place of a neighbour in a bone's frame is fixed.
    """
    orders = {"x, y, z, w": (0, 1, 2, 3), "w, x, y, z": (1, 2, 3, 0)}
    if len(places) < 2:
        return orders["x, y, z, w"], (
            "The quaternions are taken as x, y, z, w: with one body nothing tells their order."
        )
    every = max(1, len(next(iter(places.values()))) // _LOOKED_AT)
    near = {name: place[::every].astype(float) for name, place in places.items()}
    spread = {}
    for words, order in orders.items():
        least = []
        for name, turn in turns.items():
            bone = unit_turns(turn[::every][:, order].astype(float))
            least.append(min(_wanders(bone, near[n] - near[name]) for n in places if n != name))
        known = [each for each in least if each < np.inf]
        spread[words] = float(np.median(known)) if known else 0.0
    best = min(spread, key=lambda words: spread[words])
    return orders[best], (
        f"The quaternions are taken as {best}: a bone's neighbour moves by"
        f" {1000 * spread[best]:.0f} mm in its frame then, and by"
        f" {1000 * max(spread.values()):.0f} mm else (or by as much in the file's unit)."
    )


def _wanders(turns: np.ndarray, offsets: np.ndarray) -> float:
    """Return by how much a point moves in the frame of a body; infinite if it is not seen."""
    from scipy.spatial.transform import Rotation

    seen = np.isfinite(turns).all(axis=1) & np.isfinite(offsets).all(axis=1)
    if np.count_nonzero(seen) < 2:
        return np.inf
    fixed = Rotation.from_quat(turns[seen]).inv().apply(offsets[seen])
    return float(np.std(fixed, axis=0).max())


def _names(paths: list[Path]) -> list[str]:
    """Return what distinguishes file names: without a shared begin and end, up to a mark."""
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
    many = sum(_first(name) == most for name in names) > 1
    names = [name.removeprefix(most) if many else name for name in names]
    return names if len(set(names)) == len(names) and all(names) else stems


def _person_of(paths: list[Path]) -> list[bool]:
    """Return which bodies are a person's: those whose files begin alike, if others do not."""
    begins = [_first(path.stem) for path in paths]
    most = max(begins, key=begins.count)
    alike = [begin == most for begin in begins]
    return alike if 1 < sum(alike) < len(alike) else [False] * len(alike)


def _first(stem: str) -> str:
    match = re.match(r"[^_\-. ]+[_\-. ]", stem)
    return match.group(0) if match else stem
