"""A walk and a stoop as markers of Plug-in Gait, what is done to them, and how wrong that gets."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from benchmarks.made_markers import markers_of
from benchmarks.made_motions import BODY, RATE, moved
from benchmarks.recording_outcomes import OFF as OFF
from benchmarks.recording_outcomes import known as known
from benchmarks.recording_outcomes import outside
from benchmarks.recording_outcomes import seen as seen
from ergoqp.mocap import Recording, fit_postures


@cache
def motion() -> tuple[np.ndarray, np.ndarray]:
    """Pelvis (600, 4) and postures (600, 32): six seconds of a walk, four of a stoop."""
    return moved()


NAMES, PLACES = markers_of(BODY, *motion())
PLACES.setflags(write=False)


def read(places: np.ndarray, names: tuple[str, ...] = NAMES, **options: Any) -> Recording:
    return fit_postures(names, places, RATE, **options)


@cache
def undisturbed() -> Recording:
    return read(PLACES)


def at(*names: str) -> list[int]:
    """Places of some markers."""
    return [NAMES.index(name) for name in names]


def without(*gone: str) -> tuple[tuple[str, ...], list[int]]:
    """The names that are left, and their places."""
    kept = tuple(name for name in NAMES if name not in gone)
    return kept, at(*kept)


def worst(recording: Recording, rows: np.ndarray | slice | None = None) -> float:
    """How far trunk, an upper arm, an elbow or a knee is outside its ends at most [deg].

    From what is read of the markers when nothing is wrong with them, as in
    `benchmarks.recording_outcomes`.
    """
    off = np.where(recording.scored, outside(recording, undisturbed().postures), 0.0)
    return float(off.max() if rows is None else off[rows].max(initial=0.0))


def said(recording: Recording) -> str:
    return " ".join(recording.assumptions)


def exchanged(one: str, other: str, rows: slice) -> np.ndarray:
    """The take with two markers exchanged for a while."""
    places = PLACES.copy()
    places[rows, at(one)] = PLACES[rows, at(other)]
    places[rows, at(other)] = PLACES[rows, at(one)]
    return places


def fallen(name: str, when: int, frames: int = 60) -> np.ndarray:
    """The take with a marker that comes off and is on the floor within some frames."""
    places, (i,) = PLACES.copy(), at(name)
    share = np.clip((np.arange(len(places)) - when) / frames, 0, 1)[:, None]
    floor = np.array([*PLACES[when, i, :2], 0.01])
    places[:, i] = (1 - share) * PLACES[:, i] + share * floor
    return places
