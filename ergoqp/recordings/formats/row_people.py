"""Tables with a row per person and frame: separation of the people, at common frames."""

from __future__ import annotations

from typing import Final

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.recordings.formats.opening import short
from ergoqp.recordings.formats.stamps import once

_PEOPLE: Final = frozenset(
    {"body", "bodyid", "id", "person", "personid", "user", "userid", "track", "trackid", "skeleton"}
    | {"skeletonid", "trackingid", "subject", "subjectid", "bodyindex"}
)
"""Heads of columns that state the person of a row, without separators of words."""
_CROWD: Final = 20
"""Largest number of people that are read; more are tracking errors."""
_COUNTED: Final = 1000
"""Number of different values, one per row, from which a column is taken as a count of the rows."""


def is_whose(squashed_head: str) -> bool:
    """Return whether a column states the person, by its head without separators of words."""
    return squashed_head in _PEOPLE


class People:
    """The people that a column names, numbered in the order in which they appear."""

    def __init__(self) -> None:
        """Begin without people."""
        self.labels: dict[str, int] = {}
        self.counts = False
        self._rows = 0

    def __call__(self, word: str) -> str:
        """Return the number of a row's person.

        Raises:
            ValueError: if there are too many people; the text says what is allowed.
        """
        self._rows += 1
        if self.counts:
            return "0"
        if len(self.labels) == _COUNTED and word not in self.labels:
            if self._rows <= _COUNTED + 1:
                self.counts = True
                return "0"
            raise ValueError(f"as a further person, allowed at most {_COUNTED} people")
        return str(self.labels.setdefault(word, len(self.labels)))

    def are_several(self, keys: np.ndarray | None) -> bool:
        """Return whether the column names several people and is not a count of the rows.

        Args:
            keys: times or numbers of the rows' frames (n,), if there are any.
        """
        if self.counts or len(self.labels) < 2:
            return False
        if len(self.labels) < self._rows:
            return True
        return keys is not None and len(np.unique(keys)) < len(keys)


def side_by_side(
    where: str,
    names: tuple[str, ...],
    positions: np.ndarray,
    whose: np.ndarray,
    people: People,
    keys: np.ndarray,
    remedy: str,
) -> tuple[tuple[str, ...], np.ndarray, np.ndarray, list[str]]:
    """Return everybody's points "person:point" (p m,), (n, p m, 3), frames (n,) and sentences.

    Args:
        where: the file's name, for messages.
        names: names of the points (m,).
        positions: positions of the points (rows, m, 3).
        whose: number of each row's person (rows,); NaN for nobody.
        people: the people.
        keys: times or numbers of the rows' frames (rows,).
        remedy: what the user can do if a person has several rows of a time, for the message.

    Raises:
        RecordingError: if a row has no time, or time runs backwards for a person.
    """
    if len(lost := np.flatnonzero(~np.isfinite(keys) & np.isfinite(whose))):
        raise RecordingError(
            f"{where}: row {lost[0] + 1} of the numbers has no time, allowed a time for each row"
        )
    stamps = np.unique(keys[np.isfinite(keys)])
    often = np.bincount(whose[np.isfinite(whose)].astype(int), minlength=len(people.labels))
    kept = np.sort(np.argsort(-often, kind="stable")[:_CROWD])
    labels = list(people.labels)
    notes = [f"The rows are those of {len(labels)} people, whose names are the points' prefixes."]
    if len(kept) < len(labels):
        notes.append(f"Of {len(labels)} people the {_CROWD} that are seen most often are read.")
    count = len(names)
    out = np.full((len(stamps), len(kept) * count, 3), np.nan, dtype=positions.dtype)
    for at, person in enumerate(kept):
        own, name = np.flatnonzero(whose == person), f"{where}: {short(labels[person])}"
        if len(back := np.flatnonzero(np.diff(keys[own]) < 0)):
            before, after = keys[own[back[0]]], keys[own[back[0] + 1]]
            raise RecordingError(
                f"{name}: time runs backwards from {before:.10g} to {after:.10g}, allowed times"
                " that increase"
            )
        taken, said = once(name, keys[own], [positions[own]], remedy)
        own = own[taken]
        out[np.searchsorted(stamps, keys[own]), at * count : (at + 1) * count] = positions[own]
        notes += [f"Of {short(labels[person])}: {each}" for each in said]
    return tuple(f"{labels[k]}:{name}" for k in kept for name in names), out, stamps, notes
