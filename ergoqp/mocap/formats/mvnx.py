"""Xsens MVN's export of a recording as XML: poses of 23 segments, and joint angles.

The position of a segment is that of the joint at which it begins. z is up, lengths are in metres,
and quaternions are w, x, y, z (Xsens, "MVN User Manual", MVNX). Versions 3 and 4 were each tried on
a file by others. They differ in the axes of arms and hands: in a T-pose those of version 4 are the
axes of the world, and in version 3 the long axis of a hand is z. The file's own T-pose decides.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from functools import reduce
from math import inf, nan
from pathlib import Path
from typing import Any, BinaryIO, Final, NoReturn
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np
from scipy.spatial.transform import Rotation

from ergoqp.arguments import Progress
from ergoqp.errors import RecordingError
from ergoqp.mocap.formats.text import (
    LARGEST,
    GrowableArray,
    TableOptions,
    binary,
    count_of,
    is_nothing,
    is_number,
    short,
)
from ergoqp.mocap.formats.turns import UnitTurns, unit_turns
from ergoqp.mocap.recording import JointMotion, with_times

_AXES: Final = ("abduction", "rotation", "flexion")
"""Names of the three angles of a joint, in Xsens' order of the axes z, x, y."""
_BLOCK: Final = 4000
_T_POSES: Final = ("identity", "tpose")
"""Calibration poses with the arms to the sides and the palms down, the best first."""
_HANDS: Final = {"RightHand": (-0.5, 0.5, 0.5, 0.5), "LeftHand": (0.5, 0.5, -0.5, 0.5)}
"""Orientation that the axes of hands in `namings.toml` have in a T-pose, as x, y, z, w."""


class Wearer:
    """The data of one subject of the file."""

    def __init__(self, path: Path, label: str, rate: str) -> None:
        """Begin without data.

        Args:
            path: the file.
            label: the subject's name.
            rate: frames per second in words [Hz].

        Raises:
            RecordingError: if the rate is invalid.
        """
        self.path, self.label = path, label
        self.rate = float(rate) if is_number(rate) and "," not in rate else 0.0
        if not 1.0 <= self.rate <= 10_000.0:
            self.fail(f"frameRate: got {short(rate)}, allowed frames per second from 1 to 10000")
        self.segments: list[str] = []
        self.joints: list[str] = []
        self._indices: list[int] = []
        self._poses = 0  # calibration poses
        self._posed: dict[str, np.ndarray] = {}  # T-pose -> quaternions x, y, z, w (segments, 4)
        self._block: list[list[float]] = []
        # Positions, quaternions and joint angles.
        self._turns = UnitTurns()
        self._arrays = [GrowableArray(), GrowableArray(), GrowableArray()]

    def fail(self, problem: str) -> NoReturn:
        """Raise a RecordingError about the file."""
        raise RecordingError(f"{self.path.name}: {problem}")

    def append(self, what: str, label: str) -> None:
        """Add the label of a segment or joint; raise if it comes after a frame, or again."""
        labels = self.segments if what == "segment" else self.joints
        if not label or label in labels or self._indices:
            problem = "after a frame" if self._indices else "twice" if label else "without a name"
            self.fail(
                f"got the {what} {short(label)} {problem}, allowed each once and before the frames"
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
            self._poses += 1
            numbers = np.array([_number(word) for word in found.get("orientation", "").split()])
            if numbers.size == 4 * len(self.segments):
                self._posed[kind] = unit_turns(numbers.reshape(-1, 4)[:, [1, 2, 3, 0]])
            return False
        if not self.segments:
            raise lacking(self.path)
        row = self._row(index, found)
        if (number := count_of(index)) is None:
            self.fail(f"got a frame with the index {short(index)}, allowed a whole number")
        if self._indices and len(row) != self._width:
            self.fail("got joint angles (jointAngle) in some of the frames, allowed in all or none")
        self._width = len(row)
        self._indices.append(number)
        self._block.append(row)
        if len(self._block) == _BLOCK:
            self._take(share)
        return not self._block

    def motion(self, prefix: str) -> JointMotion:
        """Return the whole motion, with a prefix for all names.

        Raises:
            RecordingError: if there is no frame.
        """
        if not self.segments:
            raise lacking(self.path)
        if not self._indices:
            self.fail("got no frame of movement, allowed normal frames")
        if self._block:
            self._take(1.0)
        positions, quaternions, bent = (each.view for each in self._arrays)
        self._turn_hands(quaternions)
        names = tuple(prefix + name for name in self.segments)
        notes = self._turns.said()
        if self._poses:
            left = "calibration poses (N-pose, T-pose) of the file are left out."
            notes = [f"{self._poses} {left}", *notes]
        return JointMotion(
            names,
            positions,
            np.array(self._indices) / self.rate,
            notes=tuple(f"{prefix} {note}".lstrip() for note in notes),
            turns={name: quaternions[:, i] for i, name in enumerate(names)},
            angles={
                f"{prefix}{joint} {axis}": bent[:, 3 * i + j]
                for i, joint in enumerate(self.joints)
                for j, axis in enumerate(_AXES)
                if bent.shape[1]
            },
            unit=1.0,
            up="z",
        )

    def _turn_hands(self, quaternions: np.ndarray) -> None:
        """Give the hands the axes of `namings.toml`, if a T-pose of the file shows its own.

        Args:
            quaternions: those of all segments (n, segments, 4), changed in place.
        """
        posed = next((self._posed[kind] for kind in _T_POSES if kind in self._posed), None)
        for name in _HANDS:
            if posed is None or name not in self.segments:
                continue
            i = self.segments.index(name)
            own, hand = posed[i], quaternions[:, i]
            seen = np.isfinite(hand).all(axis=1)
            if np.isfinite(own).all() and seen.any():
                turn = Rotation.from_quat(own).inv() * Rotation.from_quat(_HANDS[name])
                hand[seen] = (Rotation.from_quat(hand[seen]) * turn).as_quat()

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
                values = [_number(word) for word in words]
            # NaN is not seen.
            if len(values) != width or "_" in text or any(abs(v) > LARGEST for v in values):
                wrong = [word for word in words if abs(_number(word)) > LARGEST]
                got = f"{short(wrong[0])} among " if wrong else ""
                self.fail(
                    f"frame {short(index)}: got {got}{len(words)} words for {what}, allowed {width}"
                    " numbers"
                )
            row += values
        return row

    def _take(self, share: float) -> None:
        """Move the rows of the block into the arrays."""
        values, count = np.array(self._block), len(self.segments)
        self._block.clear()
        places, turns, angles = np.split(values, [3 * count, 7 * count], axis=1)
        unit = self._turns.of(turns.reshape(len(values), -1, 4)[:, :, [1, 2, 3, 0]])
        parts = (places.reshape(len(values), -1, 3), unit, np.radians(angles))
        for array, part in zip(self._arrays, parts, strict=True):
            array.add(part.astype(np.float32), share)


def _number(word: str) -> float:
    """Return the number that a word stands for; infinity if it stands for none."""
    try:
        return inf if "_" in word else float(word)
    except ValueError:
        return nan if is_nothing(word) else inf


def lacking(path: Path) -> RecordingError:
    """Return the error for a file without segments."""
    return RecordingError(f"{path.name}: got no segments, allowed an MVNX file with a subject")


def together(path: Path, people: list[Wearer]) -> JointMotion:
    """Return everybody's motion.

    With several people, the names get the person as a prefix. A person without a frame at a time at
    which another one has a frame is not seen then.

    Raises:
        RecordingError: if two people have the same name, or different rates.
    """
    if not people:
        raise lacking(path)
    if len(people) == 1:
        return people[0].motion("")
    motions = [each.motion(f"{each.label}:") for each in people]
    labels = {each.label for each in people}
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
    time = np.unique(np.concatenate([motion.time for motion in motions]))
    return reduce(_beside, (_at_times(motion, time) for motion in motions))


def _at_times(motion: JointMotion, time: np.ndarray) -> JointMotion:
    """Return a motion at other times (n,), NaN where it has no frame."""
    own, first = np.unique(motion.time, return_index=True)
    at = np.searchsorted(time, own)

    def spread(values: np.ndarray) -> np.ndarray:
        found = np.full((len(time), *values.shape[1:]), np.nan, dtype=values.dtype)
        found[at] = values[first]
        return found

    return replace(motion.mapped(spread), time=time)


def _beside(one: JointMotion, other: JointMotion) -> JointMotion:
    """Return two motions of the same times as one."""
    return replace(
        one,
        names=one.names + other.names,
        positions=np.concatenate([one.positions, other.positions], axis=1),
        notes=(*one.notes, *other.notes),
        turns={**one.turns, **other.turns},
        angles={**one.angles, **other.angles},
    )


_PROLOG: Final = 1 << 20
"""Number of bytes in which the first element has to begin."""
_CHUNK: Final = 1 << 18
"""Bytes that are read at once; a parser may scan an unfinished element again with each chunk."""
_LONGEST: Final = 64
"""Largest number of chunks in a row without the start or end of an element."""
_DEEPEST: Final = 50
"""Largest depth of nested elements; Xsens has seven."""


def read_mvnx(path: Path, progress: Progress, asked: TableOptions) -> JointMotion:
    """Return segments and joint angles of a recording; its calibration poses are left out.

    With several people, the names get the person as a prefix: "Anna:Pelvis".

    Args:
        path: the file.
        progress: is called with the share of the file that is read.
        asked: unused, because the file states its rate.

    Raises:
        RecordingError: if it is not a complete MVNX file.
    """
    with binary(path) as file:
        size = max(path.stat().st_size, 1)
        _check_declarations(path, file)
        people: list[Wearer] = []
        for parent, element, begins in _elements(path, file):
            tag = _tag(element)
            if begins and tag == "subject":
                people.append(
                    Wearer(path, element.get("label") or "", element.get("frameRate") or "")
                )
            # The segments of hands have the same tag, but another parent.
            elif begins and (tag, parent) in {("segment", "segments"), ("joint", "joints")}:
                _last(path, people).append(tag, element.get("label") or "")
            elif not begins and tag == "frame":
                kind = element.get("type", "normal")
                found = {_tag(child): child.text or "" for child in element}
                share = min(file.tell() / size, 1.0)
                if _last(path, people).add(kind, str(element.get("index")), found, share):
                    progress(share)
    return with_times(path.name, together(path, people))


def _last(path: Path, people: list[Wearer]) -> Wearer:
    """Return the person whose data is being read; raise if there is none."""
    if not people:
        raise lacking(path)
    return people[-1]


def _check_declarations(path: Path, file: BinaryIO) -> None:
    """Raise if a file has its own declarations: by entities, a kilobyte can become gigabytes."""
    parser = expat.ParserCreate()
    begun: list[bool] = []

    def declared(name: str, system: str | None, public: str | None, own: int) -> None:
        if own:
            raise RecordingError(
                f"{path.name}, line {parser.CurrentLineNumber}: got declarations of its own"
                " (DOCTYPE), allowed an MVNX file without them"
            )

    parser.StartDoctypeDeclHandler = declared
    parser.StartElementHandler = lambda *_: begun.append(True)
    # Invalid XML is reported when the file is read.
    with suppress(expat.ExpatError, ValueError, LookupError):
        while not begun and (text := file.read(_PROLOG >> 4)):
            parser.Parse(text)
            if not begun and file.tell() > _PROLOG:
                raise RecordingError(
                    f"{path.name}: {_PROLOG >> 20} MB stand above the first element; this is no"
                    " MVNX file"
                )
    file.seek(0)


def _elements(path: Path, file: BinaryIO) -> Iterator[tuple[str, Any, bool]]:
    """Yield parent's tag, element and whether it begins or ends, for an XML file.

    When an element ends, its children have been removed, except those of a frame.
    """
    above: list[Any] = []
    try:
        for event, element in _events(path, file):
            if event == "end":
                above.pop()
            yield _tag(above[-1]) if above else "", element, event == "start"
            if event == "start":
                above.append(element)
                if len(above) > _DEEPEST:
                    raise RecordingError(f"{path.name}: got elements nested too deeply")
            elif above and not any(_tag(each) == "frame" for each in above):
                above[-1].clear()
    except ElementTree.ParseError as error:
        line, column = error.position
        raise RecordingError(
            f"{path.name}, line {line}: no XML at column {column + 1}"
            f" ({error.msg.split(':')[0]}); the file is cut or damaged"
        ) from None
    except (ValueError, LookupError) as error:
        raise RecordingError(
            f"{path.name}, line 1: got an encoding that is not read ({error}), allowed UTF-8"
        ) from None


def _events(path: Path, file: BinaryIO) -> Iterator[Any]:
    """Yield the events of the XML parser for a file."""
    parser = ElementTree.XMLPullParser(("start", "end"))
    quiet = 0
    while text := file.read(_CHUNK):
        parser.feed(text)
        quiet += 1
        for event in parser.read_events():
            quiet = 0
            yield event
        if quiet > _LONGEST:
            raise RecordingError(
                f"{path.name}: no element begins or ends in {_LONGEST * _CHUNK >> 20} MB; this is"
                " no MVNX file"
            )
    parser.close()
    yield from parser.read_events()


def _tag(element: Any) -> str:
    """Return an element's tag without its namespace."""
    return element.tag.rpartition("}")[2]
