"""Series of messages in a ROS bag, and their values at the frames of a recording.

A message has two stamps: the sender's, in its header, and the recorder's. Only the sender's states
when something was seen. It is zero if the sender sets none, and may be of another clock.
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
"""Largest number of names of one kind in a bag of a person and objects."""
_OLD: Final = 500_000_000
"""Age up to which a message is valid [ns]."""
_APART: Final = 1_000_000_000
"""Difference between the lags of two senders' stamps from which they are of two clocks [ns]."""
_LARGEST: Final = 1e30
"""Largest number that is accepted as a measurement."""


@dataclass(frozen=True)
class Frames:
    """The frames at which everything else is sampled.

    Attributes:
        stamps: times by the clock of `lag`, shape (n,) [ns].
        lag: lead of that clock over the recorder's [ns].
        time: times from zero, shape (n,) [s].
        kept: which of the messages are frames, (messages,) bool.
        notes: sentences about them.
    """

    stamps: np.ndarray
    lag: int
    time: np.ndarray
    kept: np.ndarray
    notes: tuple[str, ...]


class Series:
    """Rows of numbers with their stamps, in the order in which they arrive."""

    def __init__(self, width: int) -> None:
        """Begin without rows; a row has `width` numbers."""
        self.width = width
        self._sent = array("q")
        self._recorded = array("q")
        self._rows = array("f")

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self._sent)

    def add(self, sent: int, recorded: int, row: Sequence[float]) -> None:
        """Append a row, with the stamps of its sender and of the recorder [ns]."""
        self._sent.append(sent)
        self._recorded.append(recorded)
        self._rows.extend(row)

    def frames(self, where: str) -> Frames:
        """Return the rows as frames."""
        sent, recorded = self._stamps()
        return frames_of(where, sent, recorded, self._table())

    def at(self, frames: Frames, where: str) -> np.ndarray:
        """Return the last row before each frame (n, width), NaN if there is none or it is old.

        Nothing is interpolated.

        Args:
            frames: the frames.
            where: name of the series, for messages.
        """
        sent, recorded = self._stamps()
        rows = finite(self._table(), where)
        stamps = recorded + frames.lag
        if usable(sent) and abs(_lag(sent, recorded) - frames.lag) < _APART:
            stamps = sent
        # The files of one bag may overlap in time.
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
        sent: the senders' stamps (n,) [ns].
        recorded: the recorder's stamps (n,) [ns].
        shown: content of the messages (n, ...).
        stated: which messages have a sender's stamp, (n,) bool; None: all.

    Raises:
        RecordingError: if time runs backwards, or many messages of equal time differ.
    """
    stated = np.ones(len(sent), dtype=bool) if stated is None else stated
    notes = []
    stamps, lag = recorded, 0
    if usable(sent[stated]):
        lag = _lag(sent[stated], recorded[stated])
        stamps = _between(sent, recorded, stated)
    else:
        notes.append(
            "The times are those of the recorder, because the stamps of the messages are missing or"
            " not in order."
        )
    time, kept, said = seconds(where, (stamps - stamps[0]) * 1e-9, 1.0, [shown])
    return Frames(stamps[kept], lag, time, kept, (*notes, *said))


def usable(sent: np.ndarray) -> bool:
    """Return whether all senders' stamps are set and in order."""
    if not len(sent) or not sent.all():
        return False
    return bool((np.diff(sent) >= 0).all()) and (len(sent) == 1 or bool(sent[-1] > sent[0]))


def finite(values: np.ndarray, where: str) -> np.ndarray:
    """Return values, which may be NaN; raise a RecordingError if one is infinite or too large."""
    if (np.abs(values) > _LARGEST).any():
        what = "not finite" if np.isinf(values).any() else "too large"
        raise RecordingError(f"{where}: got a number that is {what}, allowed up to {_LARGEST:g}")
    return values


def stamp_of(header: object) -> int:
    """Return the stamp in a message's header [ns]; zero if its sender set none."""
    stamp = header.stamp  # type: ignore[attr-defined]
    return stamp.sec * 1_000_000_000 + stamp.nanosec


def plain(name: str) -> str:
    """Return the name of a topic or coordinate frame in one line."""
    return repr(name)[1:-1][:80]


def _lag(sent: np.ndarray, recorded: np.ndarray) -> int:
    return int(np.median(sent - recorded))


def _between(sent: np.ndarray, recorded: np.ndarray, stated: np.ndarray) -> np.ndarray:
    """Return senders' stamps, with the missing ones interpolated by the recorder's clock."""
    if stated.all():
        return sent
    begin, first = recorded[stated][0], sent[stated][0]
    clock, known = (recorded - begin).astype(float), (recorded[stated] - begin).astype(float)
    filled = np.interp(clock, known, (sent[stated] - first).astype(float))
    filled += np.minimum(clock - known[0], 0) + np.maximum(clock - known[-1], 0)
    return np.where(stated, sent, first + np.rint(filled).astype(np.int64))
