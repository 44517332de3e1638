"""Folders with one table of poses for each body: x, y, z and a unit quaternion in a row.

Such folders come from scripts of laboratories that log one rigid body or bone a file. What stands
before the body's name in all files, and behind it, is no part of it.
"""

from __future__ import annotations

import itertools
import re
from pathlib import Path
from typing import Final

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.progress import Progress, part_of
from ergoqp.recordings.formats.opening import binary
from ergoqp.recordings.formats.poses import poses_of, unit_turns
from ergoqp.recordings.formats.rows import Asked, TextLines, blocks, gathered
from ergoqp.recordings.formats.stamps import repeated, seconds
from ergoqp.recordings.motion import JointMotion

ENDINGS: Final = frozenset({".csv", ".txt"})
_PLACE: Final = ("x", "y", "z")
_ORDERS: Final = (
    (("q0", "q1", "q2", "q3"), None),
    (("qx", "qy", "qz", "qw"), (0, 1, 2, 3)),
    (("qw", "qx", "qy", "qz"), (1, 2, 3, 0)),
)
_BONDED: Final = 0.05
"""A body's place in another's frame that varies by less belongs to a joint between them [m]."""


def is_folder_of_bodies(folder: Path) -> bool:
    """Return whether a folder has tables of poses."""
    return any(_head_of(path) is not None for path in _tables(folder))


def read_bodies(folder: Path, progress: Progress, asked: Asked) -> JointMotion:
    """Return the bodies of a folder; those that no skeleton names are objects too.

    Args:
        folder: with one table for each body, all of as many rows.
        progress: told how much of it is read.
        asked: frames per second.

    Raises:
        RecordingError: tables differ in length, or are no poses.
    """
    paths = [path for path in _tables(folder) if _head_of(path) is not None]
    if asked.rate is None:
        raise RecordingError(
            f"{folder.name}: got tables of poses without times, allowed with the frames per second"
            " stated (rate)"
        )
    places, quaternions, ordered = {}, {}, None
    names = _names([path.stem for path in paths])
    for i, (name, path) in enumerate(zip(names, paths, strict=True)):
        share = part_of(progress, i / len(paths), (i + 1) / len(paths))
        place, turn, order = _read(path, share)
        places[name], quaternions[name] = place, turn
        ordered = order if order is not None else ordered
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
    notes = [f"There are {asked.rate:g} frames per second, as stated."]
    if ordered is None:
        ordered, said = _order(places, quaternions)
        notes.append(said)
    turns = {name: unit_turns(each[:, ordered]) for name, each in quaternions.items()}
    positions = np.stack(list(places.values()), axis=1)
    time, _, _ = seconds(folder.name, np.arange(len(positions)) / asked.rate, 1.0)
    return JointMotion(
        tuple(places),
        positions,
        time,
        None,
        (*notes, *repeated(positions)),
        turns=turns,
        objects={name: poses_of(places[name], turns[name]) for name in places},
    )


def _tables(folder: Path) -> list[Path]:
    try:
        found = sorted(folder.iterdir())
    except OSError as error:
        raise RecordingError(
            f"{folder.name} cannot be read: {error.strerror}, allowed a folder"
        ) from None
    return [path for path in found if path.suffix.lower() in ENDINGS and path.is_file()]


def _head_of(path: Path) -> list[str] | None:
    with binary(path) as file:
        words = file.readline(2000).decode("utf-8-sig", "replace").strip().lower()
    columns = [word.strip() for word in re.split(r"[,;\t ]+", words)]
    return columns if set(_PLACE) <= set(columns) and _turn(columns) else None


def _turn(columns: list[str]) -> tuple[tuple[str, ...], tuple[int, ...] | None] | None:
    for names, order in _ORDERS:
        if set(names) <= set(columns):
            return names, order
    return None


def _read(path: Path, progress: Progress) -> tuple[np.ndarray, np.ndarray, tuple[int, ...] | None]:
    with binary(path) as file:
        lines = TextLines(path, file, path.stat().st_size, progress)
        head = lines.next("the names of the columns")
        separator = next((mark for mark in ",;\t" if mark in head), None)
        columns = [word.strip().lower() for word in head.split(separator)]
        found = _turn(columns)
        assert found is not None
        names, order = found
        parts = list(blocks(lines, separator, len(columns)))
    if not parts:
        raise RecordingError(f"{path.name}: got no row below the names, allowed poses")
    values = gathered(parts)
    place = values[:, [columns.index(name) for name in _PLACE]]
    return place, values[:, [columns.index(name) for name in names]], order


def _order(
    places: dict[str, np.ndarray], turns: dict[str, np.ndarray]
) -> tuple[tuple[int, ...], str]:
    """Return which column is x, y, z and w, and how it was found.

    In the right order the place of a neighbour in a bone's frame is fixed.
    """
    from scipy.spatial.transform import Rotation

    orders = {"x, y, z, w": (0, 1, 2, 3), "w, x, y, z": (1, 2, 3, 0)}
    every = max(1, len(next(iter(places.values()))) // 500)
    spread = {}
    for words, order in orders.items():
        least = []
        for name, turn in turns.items():
            bone = Rotation.from_quat(turn[::every][:, order]).inv()
            fixed = [
                np.std(bone.apply(places[other][::every] - places[name][::every]), axis=0).max()
                for other in places
                if other != name
            ]
            least.append(min(fixed, default=0.0))
        spread[words] = float(np.median(least))
    best = min(spread, key=lambda words: spread[words])
    return orders[best], (
        f"The quaternions are taken as {best}: a bone's neighbour moves by"
        f" {1000 * spread[best]:.0f} mm in its frame then, and by"
        f" {1000 * max(spread.values()):.0f} mm else (or by as much in the file's unit)."
    )


def _names(stems: list[str]) -> list[str]:
    """Return what distinguishes file names: without a shared begin and end, up to a mark."""
    if len(stems) < 2:
        return stems
    most = max(
        set(_first(stem) for stem in stems), key=lambda w: sum(_first(s) == w for s in stems)
    )
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


def _first(stem: str) -> str:
    match = re.match(r"[^_\-. ]+[_\-. ]", stem)
    return match.group(0) if match else stem
