"""What arrives in a ROS bag message by message, and which of it holds at a frame.

A message has two stamps: its sender's, in its header, and the recorder's. Only the first says when
something was seen, but it is zero where a sender sets none, and of another clock where a sender has
its own.
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.recordings.formats.stamps import seconds

MOST: Final = 1000
"""Names of one kind that a bag of a person and objects may have."""
_OLD: Final = 500_000_000
"""After so long nobody knows where a thing is [ns]."""
_APART: Final = 1_000_000_000
"""Two senders' stamps that lag so differently behind the recorder's are of two clocks [ns]."""
_LARGEST: Final = 1e30
"""Nothing that anybody measures is larger."""


@dataclass(frozen=True)
class Frames:
    """The frames that all else is sampled at.

    Attributes:
        stamps: when they are, by the clock of `lag`, shape (n,) [ns].
        lag: how far the clock is ahead of the recorder's [ns].
        time: times from zero, shape (n,) [s].
        kept: which of the messages they are, (messages,) bool.
        notes: sentences about them.
    """

    stamps: np.ndarray
    lag: int
    time: np.ndarray
    kept: np.ndarray
    notes: tuple[str, ...]


class Series:
    """Rows of numbers with their stamps, which grow as they come."""

    def __init__(self, width: int) -> None:
        """Begin with no row of so many numbers."""
        self.width = width
        self._sent = array("q")
        self._recorded = array("q")
        self._rows = array("f")

    def __len__(self) -> int:
        """Return how many rows there are."""
        return len(self._sent)

    def add(self, sent: int, recorded: int, row: Sequence[float]) -> None:
        """Append a row, with its stamps by its sender and by the recorder [ns]."""
        self._sent.append(sent)
        self._recorded.append(recorded)
        self._rows.extend(row)

    def frames(self, where: str) -> Frames:
        """Return its rows as frames."""
        sent, recorded = self._stamps()
        return frames_of(where, sent, recorded, self._table())

    def at(self, frames: Frames, where: str) -> np.ndarray:
        """Return the rows that hold at frames (n, width), NaN where there is none or it is old.

        Nothing is interpolated.

        Args:
            frames: the frames.
            where: what it is, for messages.
        """
        sent, recorded = self._stamps()
        rows = finite(self._table(), where)
        stamps = recorded + frames.lag
        if usable(sent) and abs(_lag(sent, recorded) - frames.lag) < _APART:
            stamps = sent
        # A bag in several files may overlap.
        order = np.argsort(stamps, kind="stable")
        last = np.searchsorted(stamps[order], frames.stamps, side="right") - 1
        held = order[np.maximum(last, 0)]
        fresh = (last >= 0) & (frames.stamps - stamps[held] <= _OLD)
        return np.where(fresh[:, None], rows[held], np.float32(np.nan))

    def _table(self) -> np.ndarray:
        return np.frombuffer(self._rows, dtype=np.float32).reshape(-1, self.width)

    def _stamps(self) -> tuple[np.ndarray, np.ndarray]:
        return (
            np.frombuffer(self._sent, dtype=np.int64),
            np.frombuffer(self._recorded, dtype=np.int64),
        )


def frames_of(
    where: str,
    sent: np.ndarray,
    recorded: np.ndarray,
    shown: np.ndarray,
    stated: np.ndarray | None = None,
) -> Frames:
    """Return messages as frames, at their senders' stamps if these increase.

    Args:
        where: the file's name, for messages.
        sent: their senders' stamps (n,) [ns].
        recorded: the recorder's (n,) [ns].
        shown: what the messages say (n, ...).
        stated: which messages have a sender's stamp, (n,) bool; None: all.

    Raises:
        RecordingError: time runs backwards, or messages of one time differ.
    """
    stated = np.ones(len(sent), dtype=bool) if stated is None else stated
    notes = []
    stamps, lag = recorded, 0
    if usable(sent[stated]):
        lag = _lag(sent[stated], recorded[stated])
        stamps = _between(sent, recorded, stated)
    else:
        notes.append("The times are those of the recorder: the messages are not stamped in order.")
    time, kept, said = seconds(where, (stamps - stamps[0]) * 1e-9, 1.0, [shown])
    return Frames(stamps[kept], lag, time, kept, (*notes, *said))


def usable(sent: np.ndarray) -> bool:
    """Return whether senders' stamps are set, and in order."""
    if not len(sent) or not sent.all():
        return False
    return bool((np.diff(sent) >= 0).all()) and (len(sent) == 1 or bool(sent[-1] > sent[0]))


def finite(values: np.ndarray, where: str) -> np.ndarray:
    """Return values that may be NaN and not more than anybody measures, or say where they are."""
    if (np.abs(values) > _LARGEST).any():
        what = "not finite" if np.isinf(values).any() else "too large"
        raise RecordingError(f"{where}: got a number that is {what}, allowed up to {_LARGEST:g}")
    return values


def stamp_of(header: object) -> int:
    """Return the stamp of a message's header [ns]; zero if its sender set none."""
    stamp = header.stamp  # type: ignore[attr-defined]
    return stamp.sec * 1_000_000_000 + stamp.nanosec


def plain(name: str) -> str:
    """Return the name of a topic or coordinate frame without what breaks a line."""
    return repr(name)[1:-1][:80]


def _lag(sent: np.ndarray, recorded: np.ndarray) -> int:
    return int(np.median(sent - recorded))


def _between(sent: np.ndarray, recorded: np.ndarray, stated: np.ndarray) -> np.ndarray:
    """Return senders' stamps with those that are missing at their place between the others."""
    if stated.all():
        return sent
    begin, first = recorded[stated][0], sent[stated][0]
    clock, known = (recorded - begin).astype(float), (recorded[stated] - begin).astype(float)
    filled = np.interp(clock, known, (sent[stated] - first).astype(float))
    filled += np.minimum(clock - known[0], 0) + np.maximum(clock - known[-1], 0)
    return np.where(stated, sent, first + np.rint(filled).astype(np.int64))
