"""Series of messages in a ROS bag, the tree of their frames, and joints published as markers.

Series of messages in a ROS bag, and their values at the frames of a recording. A message has two
stamps: the sender's, in its header, and the recorder's. Only the sender's states when something was
seen. It is zero if the sender sets none, and may be of another clock.

The tree of coordinate frames that ROS nodes publish piece by piece (tf2_msgs/TFMessage). Trackers
publish a person's joints as coordinate frames in the frame of their camera.

Joints that a ROS node publishes as markers (visualization_msgs/MarkerArray). With the driver of the
Azure Kinect, the number of a marker is 100 times the body plus the joint, in the order of the body
tracking SDK (Azure_Kinect_ROS_Driver, issue 113). The SDK counts bodies from 1. A body that is lost
and found again gets a new number.
"""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from ergoqp.errors import RecordingError
from ergoqp.mocap.formats.text import short, some
from ergoqp.mocap.formats.times import count_repeated_frames, to_seconds
from ergoqp.mocap.formats.turns import unit_turns

MOST: Final = 1000
"""Largest number of names of one kind in a bag of a person and objects."""
_OLD: Final = 500_000_000
"""Age up to which a message is valid [ns]."""
_APART: Final = 1_000_000_000
"""Difference between the lags of two senders' stamps from which they are of two clocks [ns]."""
_LARGEST: Final = 1e30
"""Largest number that is accepted as a measurement."""


def check_count(where: str, count: int, things: str) -> None:
    """Raise a RecordingError if there are more than `MOST` of some things."""
    if count > MOST:
        raise RecordingError(f"{where}: got more than {MOST} {things}, allowed at most that many")


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
        return frames_of(where, *self.stamps(), self._table())

    def at(self, frames: Frames, where: str) -> np.ndarray:
        """Return the last row before each frame (n, width), NaN if there is none or it is old.

        Nothing is interpolated.

        Args:
            frames: the frames.
            where: name of the series, for messages.
        """
        sent, recorded = self.stamps()
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

    def stamps(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the stamps of the sender and of the recorder (n,) [ns]."""
        sent, recorded = (np.frombuffer(s, dtype=np.int64) for s in (self._sent, self._recorded))
        return sent, recorded


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
    time, kept, said = to_seconds(where, (stamps - stamps[0]) * 1e-9, 1.0, [shown])
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


@dataclass(frozen=True)
class Joints:
    """The joints of a person, or the people, in a bag.

    Attributes:
        names: names of the joints (m,).
        within: the coordinate frame of the positions.
        positions: positions (n, m, 3), NaN where not seen.
        frames: the frames in time.
        notes: sentences about them.
        turns: name -> unit quaternions (n, 4), NaN where unknown; none of markers, whose
            orientations are not those of joints.
    """

    names: tuple[str, ...]
    within: str
    positions: np.ndarray
    frames: Frames
    notes: tuple[str, ...]
    turns: Mapping[str, np.ndarray] = field(default_factory=dict)


class Tree:
    """Coordinate frames, each given in its parent."""

    def __init__(self, where: str) -> None:
        """Begin without coordinate frames; `where` is the file's name."""
        self.where = where
        self._moving: dict[str, tuple[str, Series]] = {}
        self._still: dict[str, tuple[str, tuple[float, ...]]] = {}

    @property
    def names(self) -> list[str]:
        """The coordinate frames that move."""
        return list(self._moving)

    def take(self, message: Any, recorded: int, still: bool) -> None:
        """Add a message that was recorded at a time [ns]; `still`: whether it is static."""
        for each in message.transforms:
            parent, child = (n.lstrip("/") for n in (each.header.frame_id, each.child_frame_id))
            row = pose_row(each.transform.translation, each.transform.rotation)
            if still:
                self._still[child] = (parent, row)
                continue
            usual, series = self._moving.setdefault(child, (parent, Series(7)))
            if parent != usual:
                raise RecordingError(
                    f"{self.where}: got the frame {short(child)} of tf in {short(usual)} and in"
                    f" {short(parent)}, allowed one parent"
                )
            series.add(stamp_of(each.header), recorded, row)
            check_count(self.where, len(self._moving), "moving frames of tf")

    def joints(self) -> Joints:
        """Return the frames that move, at the times of the one that is published most often.

        Raises:
            RecordingError: if the tree has a cycle, or time runs backwards.
        """
        parents = self._parents()
        chains = {name: _chain(self.where, name, parents) for name in self._moving}
        roots = [chain[-1] for chain in chains.values()]
        root = max(dict.fromkeys(roots), key=roots.count)
        names = tuple(name for name, chain in chains.items() if chain[-1] == root)
        own = {name: self._moving[name][1] for name in names}
        clock = max(own, key=lambda name: len(own[name]))
        frames = own[clock].frames(self.where)
        others = [plain(name) for name in chains if name not in names]
        notes = [
            *frames.notes,
            f"The positions are those of the {len(names)} moving frames of tf, in the axes of their"
            f" root {short(root)} and at the times of {short(clock)}.",
        ]
        if others:
            notes.append(f"The frames {some(others)} of tf have another root and are not read.")
        known: dict[str, np.ndarray] = {}
        for name in names:
            for link in reversed(chains[name][:-1]):
                if link not in known:
                    pose = self._pose(link, frames)
                    above = known.get(parents[link])
                    known[link] = pose if above is None else onto(above, pose)
        positions = np.stack([known[name][:, :3] for name in names], axis=1)
        turns = {name: known[name][:, 3:] for name in names}
        notes += count_repeated_frames(positions)
        return Joints(names, root, positions, frames, tuple(notes), turns)

    def between(self, name: str, target: str, frames: Frames) -> np.ndarray | None:
        """Return a frame's pose in another (n, 7), NaN where unknown; None if not connected."""
        parents = self._parents()
        one, other = (_chain(self.where, each, parents)[::-1] for each in (name, target))
        if one[0] != other[0]:
            return None
        # The poses of the common ancestors are not needed.
        while len(one) > 1 and len(other) > 1 and one[1] == other[1]:
            one, other = one[1:], other[1:]
        below, above = (self._along(chain, frames) for chain in (one, other))
        return onto(_reversed(above), below)

    def _along(self, chain: list[str], frames: Frames) -> np.ndarray:
        """Return the pose of the last frame of a chain in the first one (n, 7)."""
        pose = np.tile(np.array([0, 0, 0, 0, 0, 0, 1], np.float32), (len(frames.time), 1))
        for child in chain[1:]:
            pose = onto(pose, self._pose(child, frames))
        return pose

    def _parents(self) -> dict[str, str]:
        """Return child -> parent."""
        return {child: parent for child, (parent, _) in (self._still | self._moving).items()}

    def _pose(self, child: str, frames: Frames) -> np.ndarray:
        """Return a frame's pose in its parent (n, 7), NaN where unknown."""
        if child in self._moving:
            rows = self._moving[child][1].at(frames, f"{self.where}: {plain(child)}")
        else:
            row = np.array([self._still[child][1]], dtype=np.float32)
            rows = np.tile(finite(row, f"{self.where}: {plain(child)}"), (len(frames.time), 1))
        return np.concatenate([rows[:, :3], turns_of(rows[:, 3:])], axis=1)


def pose_row(place: Any, turn: Any) -> tuple[float, ...]:
    """Return a message's position and quaternion x, y, z, w in a row."""
    return (place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w)


def turns_of(rows: np.ndarray) -> np.ndarray:
    """Return quaternions (n, 4) of length 1 in 32 bits, NaN where they have no direction."""
    # The square of a large number would overflow 32 bits.
    return unit_turns(rows.astype(float)).astype(np.float32)


def _chain(where: str, name: str, parents: Mapping[str, str]) -> list[str]:
    """Return a frame, its parent and so on up to the root."""
    chain: dict[str, None] = {name: None}
    while (parent := parents.get(next(reversed(chain)))) is not None:
        if parent in chain:
            raise RecordingError(
                f"{where}: got the frame {short(parent)} of tf inside itself, allowed a tree"
            )
        chain[parent] = None
    return list(chain)


def onto(above: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Return the product of two poses (n, 7): that of a frame, and a pose in that frame."""
    seen = np.isfinite(above).all(axis=1) & np.isfinite(pose).all(axis=1)
    out = np.full_like(pose, np.nan)
    if seen.any():
        turn = Rotation.from_quat(above[seen, 3:])
        out[seen, :3] = above[seen, :3] + turn.apply(pose[seen, :3])
        out[seen, 3:] = (turn * Rotation.from_quat(pose[seen, 3:])).as_quat()
    return out


def _reversed(pose: np.ndarray) -> np.ndarray:
    """Return the inverse of poses (n, 7)."""
    seen = np.isfinite(pose).all(axis=1)
    out = np.full_like(pose, np.nan)
    if seen.any():
        turn = Rotation.from_quat(pose[seen, 3:]).inv()
        out[seen, :3] = -turn.apply(pose[seen, :3])
        out[seen, 3:] = turn.as_quat()
    return out


_SPINE: Final = ("PELVIS", "SPINE_NAVEL", "SPINE_CHEST", "NECK")
_ARM: Final = ("CLAVICLE", "SHOULDER", "ELBOW", "WRIST", "HAND", "HANDTIP", "THUMB")
_LEG: Final = ("HIP", "KNEE", "ANKLE", "FOOT")
_HEAD: Final = ("HEAD", "NOSE", "EYE_LEFT", "EAR_LEFT", "EYE_RIGHT", "EAR_RIGHT")
KINECT: Final[tuple[str, ...]] = (
    *_SPINE,
    *(f"{name}_{side}" for part in (_ARM, _LEG) for side in ("LEFT", "RIGHT") for name in part),
    *_HEAD,
)
"""The joints of the Azure Kinect, in their order."""
_POINTS: Final = frozenset({0, 1, 2, 3, 9, 10})
"""Types of markers that have one position: arrow, cube, sphere, cylinder, text and mesh."""
_CHANGES: Final = 3
"""Fewer changes of the body's number are no evidence."""
_LEAP: Final = 0.3
"""Distance by which no pelvis moves from one message to the next [m]."""
_IDS: Final = 100_000
"""Largest number of different markers of a topic."""


class Markers:
    """One topic's markers; each of its messages is a frame."""

    def __init__(self, where: str) -> None:
        """Begin without markers; `where` names the topic in messages."""
        self.where = where
        self.ids: dict[tuple[str, int], int] = {}
        self.frames: Counter[str] = Counter()
        self._texts: list[str | None] = []
        self._messages = Series(0)
        self._message = array("i")
        self._id = array("i")
        self._places = array("f")

    def __len__(self) -> int:
        """Return the number of messages."""
        return len(self._messages)

    @property
    def crowded(self) -> bool:
        """Whether there are more markers than a person can have joints."""
        return len(self.ids) > (_IDS if self.kinect else MOST)

    def take(self, message: Any, recorded: int) -> None:
        """Add a message that was recorded at a time [ns]."""
        sent = 0
        if len(self.ids) > _IDS:
            return
        for marker in message.markers:
            # The action 0 shows a marker, the others remove it.
            if marker.action != 0 or marker.type not in _POINTS:
                continue
            sent = sent or stamp_of(marker.header)
            place = self.ids.setdefault((marker.ns, marker.id), len(self._texts))
            if place == len(self._texts):
                self._texts.append(marker.text)
            elif marker.text != self._texts[place]:
                self._texts[place] = None
            position = marker.pose.position
            self._message.append(len(self))
            self._id.append(place)
            self._places.extend((position.x, position.y, position.z))
            self.frames[marker.header.frame_id.lstrip("/")] += 1
        self._messages.add(sent, recorded, ())

    def joints(self) -> Joints:
        """Return the joints of all messages.

        Raises:
            RecordingError: if they are in different coordinate frames, or time runs backwards.
        """
        if len(self.frames) > 1:
            within = some([plain(name) for name in self.frames])
            raise RecordingError(
                f"{self.where}: got markers in the frames {within}, allowed one frame"
            )
        messages = np.frombuffer(self._message, dtype=np.intc)
        sent, recorded = self._messages.stamps()
        shown = np.zeros(len(sent), dtype=bool)
        shown[messages] = True
        names, columns, said = self._kinect_columns(messages) if self.kinect else self._named()
        column = columns[np.frombuffer(self._id, dtype=np.intc)]
        read = column >= 0
        positions = np.full((len(sent), len(names), 3), np.nan, dtype=np.float32)
        places = np.frombuffer(self._places, dtype=np.float32).reshape(-1, 3)
        positions[messages[read], column[read]] = finite(places[read], self.where)
        frames = frames_of(self.where, sent, recorded, positions, shown)
        within = next(iter(self.frames))
        notes = [
            *frames.notes,
            *said,
            f"The positions are in the axes of the frame {short(within)}.",
        ]
        if not shown.all():
            notes.append(f"{int((~shown).sum())} of {len(shown)} messages show nobody.")
        positions = positions if frames.kept.all() else positions[frames.kept]
        # Consecutive messages that show nobody do not count as repeated frames.
        notes += count_repeated_frames(positions[shown[frames.kept]])
        return Joints(names, within, positions, frames, tuple(notes))

    @property
    def kinect(self) -> bool:
        """Whether each body has the joints of the Azure Kinect, and there are no other markers."""
        count = len(KINECT)
        bodies = Counter(number // 100 for _, number in self.ids)
        return (
            bool(self.ids)
            and all(not space and number % 100 < count for space, number in self.ids)
            and all(body > 0 and found == count for body, found in bodies.items())
        )

    def _kinect_columns(
        self, messages: np.ndarray
    ) -> tuple[tuple[str, ...], np.ndarray, list[str]]:
        """Return names of joints, the column of each marker or -1, and sentences."""
        count = len(KINECT)
        numbers = np.array([number for _, number in self.ids], dtype=np.int64)
        bodies, which = np.unique(numbers // 100, return_inverse=True)
        notes = ["The 32 markers of a body are taken as the joints of the Azure Kinect."]
        marks = np.frombuffer(self._id, dtype=np.intc)
        pelvis = (numbers % 100 == 0)[marks]
        if np.bincount(messages[pelvis]).max(initial=0) <= 1:
            if not self._alternate(which[marks][pelvis], pelvis):
                if len(bodies) > 1:
                    notes.append(
                        f"The tracker numbers {len(bodies)} bodies but never shows two at once:"
                        " they are taken as one person."
                    )
                return KINECT, numbers % 100, notes
            notes.append(
                f"The tracker shows {len(bodies)} bodies in turn and far apart: they are taken as"
                " different people."
            )
        names = tuple(f"body {body}:{joint}" for body in bodies for joint in KINECT)
        return names, which * count + numbers % 100, notes

    def _alternate(self, bodies: np.ndarray, shown: np.ndarray) -> bool:
        """Return whether bodies that are never shown at once belong to different people.

        They do if numbers come back several times, each time at another place: a person who is
        found again gets a new number.

        Args:
            bodies: body of each pelvis marker, in the order in which they are shown (k,).
            shown: which of the markers are those of a pelvis (markers,) bool.
        """
        changes = np.flatnonzero(np.diff(bodies))
        if len(changes) < _CHANGES or len(changes) < len(np.unique(bodies)):
            return False
        places = np.frombuffer(self._places, dtype=np.float32).reshape(-1, 3)[shown].astype(float)
        leaps = np.linalg.norm(places[changes + 1] - places[changes], axis=1)
        return float(np.median(leaps)) > _LEAP

    def _named(self) -> tuple[tuple[str, ...], np.ndarray, list[str]]:
        """Return the markers' own names: their texts, or else namespace and number."""
        texts = Counter(self._texts)
        numbered = [f"{ns}/{number}" if ns else str(number) for ns, number in self.ids]
        pairs = zip(numbered, self._texts, strict=True)
        names = [text if text and texts[text] == 1 else name for name, text in pairs]
        if len(set(names)) < len(names):
            names = numbered
        return tuple(names), np.arange(len(names)), []
