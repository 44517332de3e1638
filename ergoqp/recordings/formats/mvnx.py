"""Xsens MVN's export of a recording as XML: poses of 23 segments, and joint angles.

A segment's place is that of the joint it begins in; z is up, lengths are metres, quaternions are
w, x, y, z (Xsens, "MVN User Manual", MVNX; version 3 was read as a file of others, version 4 is
the same in what is read here).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO, Final
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.progress import Progress
from ergoqp.recordings.formats.opening import binary, short
from ergoqp.recordings.formats.poses import unit_turns
from ergoqp.recordings.formats.rows import LARGEST, Asked, Gathered, count_of
from ergoqp.recordings.formats.stamps import repeated, seconds
from ergoqp.recordings.motion import JointMotion

_AXES: Final = ("abduction", "rotation", "flexion")
"""Of the three angles of a joint, in Xsens' order z, x, y of axes."""
_BLOCK: Final = 4000
_PROLOG: Final = 1 << 20
"""Bytes in which the first element begins."""
_CHUNK: Final = 1 << 18
"""Bytes that are read at once: a parser may look at what has no end yet again and again."""
_LONGEST: Final = 64
"""Of them without the begin or end of an element, at most."""
_DEEPEST: Final = 50
"""Elements in elements; Xsens has seven."""


def read_mvnx(path: Path, progress: Progress, asked: Asked) -> JointMotion:
    """Return segments and joint angles of a recording; its calibration poses are left out.

    Args:
        path: the file.
        progress: told how much of it is read.
        asked: unused, the file states its rate.

    Raises:
        RecordingError: it is no whole MVNX file, or holds several people.
    """
    with binary(path) as file:
        size = max(path.stat().st_size, 1)
        _check_declarations(path, file)
        segments: list[str] = []
        joints: list[str] = []
        indices: list[int] = []
        arrays = [Gathered(), Gathered(), Gathered()]
        block: list[list[float]] = []
        rate, posed, width = None, 0, 0
        for parent, element, begins in _elements(path, file):
            tag = _tag(element)
            if begins:
                if tag == "subject":
                    if rate is not None:
                        raise RecordingError(
                            f"{path.name}: got several people, allowed one: export them one by one"
                        )
                    rate = _rate(path, element.get("frameRate"))
                # The segments of hands have the same tag, and elsewhere their places.
                elif tag == "segment" and parent == "segments":
                    _append(path, segments, element, behind=bool(indices))
                elif tag == "joint" and parent == "joints":
                    _append(path, joints, element, behind=bool(indices))
            elif tag == "frame":
                if element.get("type", "normal") == "normal":
                    if not segments:
                        raise _lacking(path)
                    index, row = _frame(path, element, len(segments), len(joints))
                    indices.append(index)
                    width = width or len(row)
                    if len(row) != width:
                        raise RecordingError(
                            f"{path.name}: got joint angles (jointAngle) in some of the frames,"
                            " allowed in all or none"
                        )
                    block.append(row)
                else:
                    posed += 1
                if len(block) == _BLOCK:
                    share = min(file.tell() / size, 1.0)
                    _take(block, len(segments), arrays, share)
                    progress(share)
        if block:
            _take(block, len(segments), arrays, 1.0)
    if not segments or rate is None:
        raise _lacking(path)
    if not indices:
        raise RecordingError(f"{path.name}: got no frame of movement, allowed normal frames")
    positions, quaternions, bent = (each.whole for each in arrays)
    time, kept, notes = seconds(path.name, np.array(indices) / rate, 1.0)
    if not kept.all():
        positions, quaternions, bent = positions[kept], quaternions[kept], bent[kept]
    if posed:
        notes.append(f"{posed} calibration poses (N-pose, T-pose) of the file are left out.")
    return JointMotion(
        tuple(segments),
        positions,
        time,
        None,
        (*notes, *repeated(positions)),
        turns={name: quaternions[:, i] for i, name in enumerate(segments)},
        angles={
            f"{joint} {axis}": bent[:, 3 * i + j]
            for i, joint in enumerate(joints)
            for j, axis in enumerate(_AXES)
            if bent.shape[1]
        },
        unit=1.0,
        up="z",
    )


def _check_declarations(path: Path, file: BinaryIO) -> None:
    """Refuse a file that declares what stands for other text: a kilobyte can become gigabytes."""
    parser = expat.ParserCreate()
    begun: list[bool] = []

    def declared(name: str, system: str | None, public: str | None, own: int) -> None:
        if own:
            raise RecordingError(
                f"{path.name}, line {parser.CurrentLineNumber}: got declarations of its own"
                " (DOCTYPE), allowed an MVNX file without"
            )

    parser.StartDoctypeDeclHandler = declared
    parser.StartElementHandler = lambda *_: begun.append(True)
    # What is no XML is told when it is read.
    with suppress(expat.ExpatError, ValueError, LookupError):
        while not begun and (text := file.read(_PROLOG >> 4)):
            parser.Parse(text)
            if not begun and file.tell() > _PROLOG:
                raise RecordingError(
                    f"{path.name}: got {_PROLOG >> 20} MB above the first element, allowed an MVNX"
                    " file"
                )
    file.seek(0)


def _lacking(path: Path) -> RecordingError:
    return RecordingError(f"{path.name}: got no segments, allowed an MVNX file with a subject")


def _elements(path: Path, file: BinaryIO) -> Iterator[tuple[str, Any, bool]]:
    """Return the elements of an XML file as they begin (True) and end, and the parent's tag.

    When an element ends its children are gone, but a frame's.
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
            f"{path.name}, line {line}: got no XML at column {column + 1}"
            f" ({error.msg.split(':')[0]}), allowed a whole MVNX file"
        ) from None
    except (ValueError, LookupError) as error:
        raise RecordingError(
            f"{path.name}, line 1: got an encoding that is not read ({error}), allowed UTF-8"
        ) from None


def _events(path: Path, file: BinaryIO) -> Iterator[Any]:
    """Return what the parser tells of a file."""
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
                f"{path.name}: got {_LONGEST * _CHUNK >> 20} MB in which no element begins or ends,"
                " allowed an MVNX file"
            )
    parser.close()
    yield from parser.read_events()


def _tag(element: Any) -> str:
    """Return an element's tag without its namespace."""
    return element.tag.rpartition("}")[2]


def _append(path: Path, labels: list[str], element: Any, behind: bool) -> None:
    """Add the label of a segment or joint, which may not stand behind a frame."""
    label = element.get("label") or ""
    if not label or label in labels or behind:
        problem = "behind a frame" if behind else "twice" if label else "without a name"
        raise RecordingError(
            f"{path.name}: got the {_tag(element)} {short(label)} {problem}, allowed each once and"
            " above the frames"
        )
    labels.append(label)


def _rate(path: Path, stated: str | None) -> float:
    try:
        rate = float(stated or "")
    except ValueError:
        rate = 0.0
    if not 1.0 <= rate <= 10_000.0:
        raise RecordingError(
            f"{path.name}: frameRate: got {short(stated or '')}, allowed frames per second from 1"
            " to 10000"
        )
    return rate


def _frame(path: Path, element: Any, segments: int, joints: int) -> tuple[int, list[float]]:
    """Return a frame's index, and its places, quaternions and joint angles in a row."""
    found = {_tag(child): child.text or "" for child in element}
    row: list[float] = []
    index = str(element.get("index"))
    for what, width in (
        ("position", 3 * segments),
        ("orientation", 4 * segments),
        ("jointAngle", 3 * joints),
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
            raise RecordingError(
                f"{path.name}: frame {short(index)}: got {len(words)} words for {what}, allowed"
                f" {width} numbers"
            )
        row += values
    if (number := count_of(index)) is None:
        raise RecordingError(
            f"{path.name}: got a frame with the index {short(index)}, allowed a whole number"
        )
    return number, row


def _take(block: list[list[float]], segments: int, to: list[Gathered], share: float) -> None:
    """Move rows into the arrays of places, quaternions and angles."""
    values = np.array(block)
    block.clear()
    places, turns, angles = np.split(values, [3 * segments, 7 * segments], axis=1)
    unit = unit_turns(turns.reshape(len(values), -1, 4)[:, :, [1, 2, 3, 0]])
    parts = (places.reshape(len(values), -1, 3), unit, np.radians(angles))
    for each, part in zip(to, parts, strict=True):
        each.add(part.astype(np.float32), share)
