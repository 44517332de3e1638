"""The people in an MVNX file, frame by frame, and several of them as one motion."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.recordings.formats.opening import short
from ergoqp.recordings.formats.poses import unit_turns
from ergoqp.recordings.formats.rows import LARGEST, Gathered, count_of
from ergoqp.recordings.motion import JointMotion

_AXES: Final = ("abduction", "rotation", "flexion")
"""Names of the three angles of a joint, in Xsens' order of the axes z, x, y."""
_BLOCK: Final = 4000


@dataclass(eq=False)
class Wearer:
    """The data of one subject of the file.

    Attributes:
        path: the file.
        label: the subject's name.
        rate: frames per second [Hz].
        segments: names of the segments.
        joints: names of the joints.
        indices: indices of the frames so far.
        posed: number of frames that were calibration poses.
        gathered: positions, quaternions and joint angles of the frames.
    """

    path: Path
    label: str
    rate: float
    segments: list[str] = field(default_factory=list)
    joints: list[str] = field(default_factory=list)
    indices: list[int] = field(default_factory=list)
    posed: int = 0
    gathered: tuple[Gathered, Gathered, Gathered] = field(
        default_factory=lambda: (Gathered(), Gathered(), Gathered())
    )
    _block: list[list[float]] = field(default_factory=list)
    _width: int = 0

    @classmethod
    def begun(cls, path: Path, label: str | None, rate: str | None) -> Wearer:
        """Return a subject without data.

        Raises:
            RecordingError: if the rate is invalid.
        """
        try:
            stated = float(rate or "")
        except ValueError:
            stated = 0.0
        if not 1.0 <= stated <= 10_000.0:
            raise RecordingError(
                f"{path.name}: frameRate: got {short(rate or '')}, allowed frames per second from"
                " 1 to 10000"
            )
        return cls(path, label or "", stated)

    def append(self, what: str, label: str) -> None:
        """Add the label of a segment or joint; raise if it comes after a frame, or again."""
        labels = self.segments if what == "segment" else self.joints
        if not label or label in labels or self.indices:
            problem = "after a frame" if self.indices else "twice" if label else "without a name"
            raise RecordingError(
                f"{self.path.name}: got the {what} {short(label)} {problem}, allowed each once and"
                " before the frames"
            )
        labels.append(label)

    def add(self, kind: str, index: str, found: dict[str, str], share: float) -> bool:
        """Add a frame; return whether a block is full.

        Args:
            kind: "normal", or the name of a calibration pose.
            index: its number in words.
            found: tag -> text of its children.
            share: share of the file that is read.
        """
        if kind != "normal":
            self.posed += 1
            return False
        if not self.segments:
            raise lacking(self.path)
        row = self._row(index, found)
        if (number := count_of(index)) is None:
            raise RecordingError(
                f"{self.path.name}: got a frame with the index {short(index)}, allowed a whole"
                " number"
            )
        self.indices.append(number)
        self._width = self._width or len(row)
        if len(row) != self._width:
            raise RecordingError(
                f"{self.path.name}: got joint angles (jointAngle) in some of the frames, allowed"
                " in all or none"
            )
        self._block.append(row)
        if len(self._block) == _BLOCK:
            self._take(share)
        return not self._block

    def motion(self) -> tuple[JointMotion, np.ndarray]:
        """Return the whole motion, without times, and the frames' indices.

        Raises:
            RecordingError: if there is no frame.
        """
        if not self.segments:
            raise lacking(self.path)
        if not self.indices:
            raise RecordingError(
                f"{self.path.name}: got no frame of movement, allowed normal frames"
            )
        if self._block:
            self._take(1.0)
        positions, quaternions, bent = (each.whole for each in self.gathered)
        note = f"{self.posed} calibration poses (N-pose, T-pose) of the file are left out."
        motion = JointMotion(
            tuple(self.segments),
            positions,
            np.zeros(len(positions)),
            None,
            (note,) if self.posed else (),
            turns={name: quaternions[:, i] for i, name in enumerate(self.segments)},
            angles={
                f"{joint} {axis}": bent[:, 3 * i + j]
                for i, joint in enumerate(self.joints)
                for j, axis in enumerate(_AXES)
                if bent.shape[1]
            },
            unit=1.0,
            up="z",
        )
        return motion, np.array(self.indices)

    def _row(self, index: str, found: dict[str, str]) -> list[float]:
        """Return positions, quaternions and joint angles of a frame."""
        row: list[float] = []
        for what, width in (
            ("position", 3 * len(self.segments)),
            ("orientation", 4 * len(self.segments)),
            ("jointAngle", 3 * len(self.joints)),
        ):
            if what == "jointAngle" and what not in found:
                continue
            text = found.get(what, "")
            words = text.split()
            try:
                values = [float(word) for word in words]
            except ValueError:
                values = []
            if len(values) != width or "_" in text or not all(abs(v) <= LARGEST for v in values):
                wrong = [word for word in words if not _is_read(word)]
                got = f"{short(wrong[0])} among " if wrong else ""
                raise RecordingError(
                    f"{self.path.name}: frame {short(index)}: got {got}{len(words)} words for"
                    f" {what}, allowed {width} numbers"
                )
            row += values
        return row

    def _take(self, share: float) -> None:
        """Move the rows of the block into the arrays."""
        values, count = np.array(self._block), len(self.segments)
        self._block.clear()
        places, turns, angles = np.split(values, [3 * count, 7 * count], axis=1)
        unit = unit_turns(turns.reshape(len(values), -1, 4)[:, :, [1, 2, 3, 0]])
        parts = (places.reshape(len(values), -1, 3), unit, np.radians(angles))
        for each, part in zip(self.gathered, parts, strict=True):
            each.add(part.astype(np.float32), share)


def _is_read(word: str) -> bool:
    """Return whether a word is a number that is not too large."""
    try:
        return "_" not in word and abs(float(word)) <= LARGEST
    except ValueError:
        return False


def lacking(path: Path) -> RecordingError:
    """Return the error for a file without segments."""
    return RecordingError(f"{path.name}: got no segments, allowed an MVNX file with a subject")


def together(path: Path, people: list[Wearer]) -> tuple[JointMotion, np.ndarray]:
    """Return everybody's motion, without times, and the times of its frames [s].

    With several people, the names get the person as a prefix. A person without a frame at a time at
    which another one has a frame is not seen then.

    Raises:
        RecordingError: if two people have the same name, or different rates.
    """
    if not people:
        raise lacking(path)
    motions = [each.motion() for each in people]
    rate = people[0].rate
    if len(people) == 1:
        motion, indices = motions[0]
        return motion, indices / rate
    labels = Counter(each.label for each in people)
    if len(labels) < len(people) or "" in labels:
        named = ", ".join(short(each.label) for each in people)
        raise RecordingError(
            f"{path.name}: got {len(people)} people with the labels {named}, allowed a different"
            " name for each"
        )
    if len({each.rate for each in people}) > 1:
        rates = ", ".join(f"{each.rate:g}" for each in people)
        raise RecordingError(
            f"{path.name}: got people with {rates} frames per second, allowed the same for all"
        )
    whole = np.unique(np.concatenate([indices for _, indices in motions]))
    names: list[str] = []
    positions, turns, angles, notes = [], {}, {}, []
    for each, (motion, indices) in zip(people, motions, strict=True):
        _, first = np.unique(indices, return_index=True)
        at = np.searchsorted(whole, indices[first])

        def spread(
            values: np.ndarray, at: np.ndarray = at, first: np.ndarray = first
        ) -> np.ndarray:
            found = np.full((len(whole), *values.shape[1:]), np.nan, dtype=values.dtype)
            found[at] = values[first]
            return found

        names += [f"{each.label}:{name}" for name in motion.names]
        positions.append(spread(motion.positions))
        turns |= {f"{each.label}:{name}": spread(turn) for name, turn in motion.turns.items()}
        angles |= {f"{each.label}:{name}": spread(bent) for name, bent in motion.angles.items()}
        notes += [f"{each.label}: {note}" for note in motion.notes]
    motion = JointMotion(
        tuple(names),
        np.concatenate(positions, axis=1),
        np.zeros(len(whole)),
        None,
        tuple(notes),
        turns=turns,
        angles=angles,
        unit=1.0,
        up="z",
    )
    return motion, whole / rate
