"""Xsens MVN's export of a recording as XML: poses of 23 segments, and joint angles.

The position of a segment is that of the joint at which it begins. z is up, lengths are in metres,
and quaternions are w, x, y, z (Xsens, "MVN User Manual", MVNX). Version 3 was tried on a file by
others; in what is read here, version 4 is the same.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO, Final
from xml.etree import ElementTree
from xml.parsers import expat

from ergoqp.errors import RecordingError
from ergoqp.progress import Progress
from ergoqp.recordings.formats.mvnx_wearer import Wearer, lacking, together
from ergoqp.recordings.formats.opening import binary
from ergoqp.recordings.formats.rows import Asked
from ergoqp.recordings.formats.stamps import repeated, seconds
from ergoqp.recordings.motion import JointMotion

_PROLOG: Final = 1 << 20
"""Number of bytes in which the first element has to begin."""
_CHUNK: Final = 1 << 18
"""Bytes that are read at once; a parser may scan an unfinished element again with each chunk."""
_LONGEST: Final = 64
"""Largest number of chunks in a row without the start or end of an element."""
_DEEPEST: Final = 50
"""Largest depth of nested elements; Xsens has seven."""


def read_mvnx(path: Path, progress: Progress, asked: Asked) -> JointMotion:
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
                people.append(Wearer.begun(path, element.get("label"), element.get("frameRate")))
            # The segments of hands have the same tag, but another parent.
            elif begins and (tag, parent) in {("segment", "segments"), ("joint", "joints")}:
                _last(path, people).append(tag, element.get("label") or "")
            elif not begins and tag == "frame":
                kind = element.get("type", "normal")
                found = {_tag(child): child.text or "" for child in element}
                share = min(file.tell() / size, 1.0)
                if _last(path, people).add(kind, str(element.get("index")), found, share):
                    progress(share)
    motion, stamps = together(path, people)
    time, kept, notes = seconds(path.name, stamps, 1.0, [motion.positions])
    motion = replace(motion if kept.all() else motion.at(kept), time=time)
    return replace(motion, notes=(*notes, *motion.notes, *repeated(motion.positions)))


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
                    f"{path.name}: got {_PROLOG >> 20} MB above the first element, allowed an MVNX"
                    " file"
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
            f"{path.name}, line {line}: got no XML at column {column + 1}"
            f" ({error.msg.split(':')[0]}), allowed a whole MVNX file"
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
                f"{path.name}: got {_LONGEST * _CHUNK >> 20} MB in which no element begins or ends,"
                " allowed an MVNX file"
            )
    parser.close()
    yield from parser.read_events()


def _tag(element: Any) -> str:
    """Return an element's tag without its namespace."""
    return element.tag.rpartition("}")[2]
