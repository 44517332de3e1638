"""Joints that a ROS node publishes as markers (visualization_msgs/MarkerArray).

With the driver of the Azure Kinect, the number of a marker is 100 times the body plus the joint, in
the order of the body tracking SDK (Azure_Kinect_ROS_Driver, issue 113). The SDK counts bodies from
1. A body that is lost and found again gets a new number.
"""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.recordings.formats.bag_series import MOST, Frames, finite, frames_of, plain, stamp_of
from ergoqp.recordings.formats.opening import short, some
from ergoqp.recordings.formats.stamps import repeated

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
_IDS: Final = 100_000
"""Largest number of different markers of a topic."""
_CHANGES: Final = 3
"""Fewer changes of the body's number are no evidence."""
_APART: Final = 0.3
"""Distance by which no pelvis moves from one message to the next [m]."""
_CROWD: Final = 20
"""Largest number of bodies that are read if several are seen at once; more are tracking errors."""


@dataclass(frozen=True)
class Shown:
    """The joints that a topic's markers show.

    Attributes:
        names: names of the joints (m,).
        within: the coordinate frame of the positions.
        positions: positions (n, m, 3), NaN where not seen.
        frames: the frames.
        notes: sentences about them.
        turns: empty, because the orientations of markers are not those of joints.
    """

    names: tuple[str, ...]
    within: str
    positions: np.ndarray
    frames: Frames
    notes: tuple[str, ...]
    turns: Mapping[str, np.ndarray] = field(default_factory=dict)


class Markers:
    """One topic's markers; each of its messages is a frame."""

    def __init__(self, where: str) -> None:
        """Begin without markers; `where` names the topic in messages."""
        self.where = where
        self.ids: dict[tuple[str, int], int] = {}
        self.frames: Counter[str] = Counter()
        self._texts: list[str | None] = []
        self._sent = array("q")
        self._recorded = array("q")
        self._message = array("i")
        self._id = array("i")
        self._places = array("f")

    def __len__(self) -> int:
        """Return the number of messages."""
        return len(self._sent)

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
            self._message.append(len(self._sent))
            self._id.append(place)
            self._places.extend((position.x, position.y, position.z))
            self.frames[marker.header.frame_id.lstrip("/")] += 1
        self._sent.append(sent)
        self._recorded.append(recorded)

    def joints(self) -> Shown:
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
        sent, recorded = (np.frombuffer(s, dtype=np.int64) for s in (self._sent, self._recorded))
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
        notes += repeated(positions[shown[frames.kept]])
        return Shown(names, within, positions, frames, tuple(notes))

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
        seen = which[np.frombuffer(self._id, dtype=np.intc)]
        pelvis = (numbers % 100 == 0)[np.frombuffer(self._id, dtype=np.intc)]
        if np.bincount(messages[pelvis]).max(initial=0) <= 1:
            if not self._alternate(seen[pelvis], pelvis):
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
        often = np.bincount(seen[pelvis], minlength=len(bodies))
        kept = np.sort(np.argsort(-often, kind="stable")[:_CROWD])
        if len(kept) < len(bodies):
            notes.append(f"Of {len(bodies)} bodies the {_CROWD} that are seen most often are read.")
        names = tuple(f"body {bodies[k]}:{joint}" for k in kept for joint in KINECT)
        row = np.full(len(bodies), -1)
        row[kept] = np.arange(len(kept))
        columns = np.where(row[which] >= 0, row[which] * count + numbers % 100, -1)
        return names, columns, notes

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
        return float(np.median(leaps)) > _APART

    def _named(self) -> tuple[tuple[str, ...], np.ndarray, list[str]]:
        """Return the markers' own names: their texts, or else namespace and number."""
        texts = Counter(self._texts)
        names = [
            text if text and texts[text] == 1 else f"{ns}/{number}" if ns else str(number)
            for (ns, number), text in zip(self.ids, self._texts, strict=True)
        ]
        if len(set(names)) < len(names):
            names = [f"{ns}/{number}" if ns else str(number) for ns, number in self.ids]
        return tuple(names), np.arange(len(names)), []
