"""A record of the service: what its messages hold, and how they are read from a file.

A record is an MCAP file of the profile ``ergoqp``. Each loop has two channels: ``/LOOP/step`` with
the door's own frames, and ``/LOOP/view`` with JSON for viewers. ``/recorder`` counts what is
missing. A record of metadata per loop holds what is needed to compute its steps again.

A message of ``/LOOP/step`` is a head, the request, the answer, and now and then the state before
the step with the guide of that moment. The schema of the channel is `record_schema` as JSON.
"""

from __future__ import annotations

import json
import platform
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import numpy as np

from ergoqp._version import __version__
from ergoqp.errors import RecordingError
from ergoqp.files.mcap import Unreadable, mcap_records, open_mcap, profile_of
from ergoqp.native.compiled import CompilerError, compiler
from ergoqp.service.schema import ENGINES, VERSION, Field, schema
from ergoqp.service.served import Served
from ergoqp.step.guide import read_guide

PROFILE: Final = "ergoqp"
"""Profile of the MCAP file."""

ENCODING: Final = "x-ergoqp-frames"
"""Encoding of the messages with frames, and of their schema."""

STEP_TOPIC, VIEW_TOPIC, COUNTS_TOPIC = "/{}/step", "/{}/view", "/recorder"
"""Topics of the channels; the braces stand for the loop."""

LOOP_METADATA, END_METADATA = "ergoqp loop ", "ergoqp end"
"""Names of the metadata of a loop, which follows, and of the counts at the end."""

MESSAGE: Final = (
    Field("worker", "u64", "number drawn by the process that computed the step"),
    Field("number", "u64", "place among all answers of that process for this loop, from 0 on"),
    Field("lost", "u64", "how many of those before could not be given to the recorder"),
    Field("time", "u64", "when the answer had been sent, since 1970 [ns]"),
    Field("request", "u32", "bytes of the request, which follows this head"),
    Field("answer", "u32", "bytes of the answer, which follows the request"),
    Field("state", "u32", "numbers of the state before the step, which follow; 0: not recorded"),
    Field("guide", "u32", "the guide before the step: 0 that of the start, 1 none, 2 follows"),
)
"""Head of a message; a guide that follows is its pose (16) and promise, after the state."""

MESSAGE_HEAD: Final = struct.Struct("<QQQQIIII")

GUIDE_BYTES: Final = 17 * 8
_OF_START, _NONE, _GIVEN = range(3)


@dataclass(frozen=True)
class Recorded:
    """One step of a record.

    Attributes:
        loop: name of the loop.
        worker: the process that computed it.
        number: its place among the answers of that process for this loop.
        lost: how many of those before could not be given to the recorder.
        time_ns: when the answer had been sent, since 1970 [ns].
        request: the client's frame.
        answer: the frame that was sent.
        state: the state before the step (n,); None: not recorded.
        guide: the guide before the step: None for that of the start, empty for none; meaningful
            only with a state.
    """

    loop: str
    worker: int
    number: int
    lost: int
    time_ns: int
    request: bytes
    answer: bytes
    state: np.ndarray | None
    guide: bytes | None


def guide_kind(guide: bytes | None) -> int:
    """Return how a message states a guide."""
    return _OF_START if guide is None else _GIVEN if guide else _NONE


def read_message(loop: str, data: bytes) -> Recorded:
    """Return the step of a message.

    Raises:
        ValueError: if its lengths do not fit together.
    """
    if len(data) < MESSAGE_HEAD.size:
        raise ValueError("a message without its head")
    worker, number, lost, time_ns, *sizes, kind = MESSAGE_HEAD.unpack_from(data)
    asked, told, count = sizes
    request = MESSAGE_HEAD.size + asked
    answer = request + told
    state = answer + 8 * count
    end = state + (GUIDE_BYTES if kind == _GIVEN else 0)
    if len(data) != end:
        raise ValueError(f"a message of {len(data)} bytes instead of {end}")
    return Recorded(
        loop,
        worker,
        number,
        lost,
        time_ns,
        data[MESSAGE_HEAD.size : request],
        data[request:answer],
        np.frombuffer(data, "<f8", count, answer) if count else None,
        None if kind == _OF_START else data[state:end],
    )


def record_schema() -> bytes:
    """Return the schema of the channels with frames: JSON of the message and of both frames."""
    return json.dumps({"message": [dict(vars(each)) for each in MESSAGE], **schema()}).encode()


def machine() -> str:
    """Return what the last bits of a step may depend on: processor and C library."""
    processor = platform.processor()
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
        found = (line for line in lines if line.startswith("model name"))
        processor = next(found, processor).partition(":")[2].strip() or processor
    except OSError:
        pass
    return ", ".join(filter(None, (platform.machine(), processor, " ".join(platform.libc_ver()))))


def has_compiler() -> str:
    """Return ``yes`` if there is a C compiler here, else ``no``: with one, stops are compiled."""
    try:
        compiler()
    except CompilerError:
        return "no"
    return "yes"


def versions() -> dict[str, str]:
    """Return the versions that the last bits of a step depend on, by package."""
    return {"ergoqp": __version__, "casadi": version("casadi"), "numpy": np.__version__}


def loop_metadata(served: Served, loop: str) -> dict[str, str]:
    """Return what is needed to compute the steps of a loop again."""
    guide = ""
    if served.guide is not None:
        place = read_guide(served.problem, served.guide)
        guide = json.dumps({"pose": place.pose.tolist(), "expected": place.expected})
    return {
        "loop": loop,
        "problem": served.name,
        "text": served.text,
        "folder": "" if served.folder is None else str(served.folder),
        "dt": repr(served.problem.dt),
        "guide": guide,
        "digest": str(served.digest),
        "engine": ENGINES[served.engine],
        "frames": str(VERSION),
        "machine": machine(),
        "compiler": has_compiler(),
        "python": platform.python_version(),
        "description": served.description(loop, recorded=True),
        **versions(),
    }


@dataclass
class Record:
    """A record's file, read message by message.

    Attributes:
        path: the file.
        loops: metadata of each loop by name; complete once the first message is read.
        counts: what the recorder itself has counted, by loop, as far as it is read: ``steps``,
            ``lost`` (not given to it), ``dropped`` (by it) and ``gone`` (with an earlier recorder).
        unreadable: damaged parts so far.
        cut_off: whether the file ends in the middle.
    """

    path: Path
    loops: dict[str, dict[str, str]] = field(default_factory=dict)
    counts: dict[str, dict[str, int]] = field(default_factory=dict)
    unreadable: int = 0
    cut_off: bool = False

    def __post_init__(self) -> None:
        """Check that it is a record.

        Raises:
            RecordingError: if it is not, or cannot be read.
            MissingExtraError: if the package for such files is not installed.
        """
        self.path = Path(self.path)
        try:
            with open_mcap(self.path, "a record of the service") as file:
                profile = profile_of(file.read(256))
        except (OSError, ValueError) as error:
            why = getattr(error, "strerror", None) or error
            raise RecordingError(f"{self.path.name}: cannot be read ({why})") from None
        if profile is None:
            raise RecordingError(
                f"{self.path.name}: is no record of the service; give a file of"
                " `ergoqp serve --record`"
            )
        if profile != PROFILE:
            raise RecordingError(
                f"{self.path.name}: got an MCAP file of the profile {profile!r}, allowed one of"
                " `ergoqp serve --record`"
            )

    def messages(self) -> Iterator[Recorded]:
        """Yield the steps of all loops, in the order in which they were recorded.

        Raises:
            RecordingError: if the file cannot be read.
        """
        self.unreadable, self.cut_off = 0, False
        topics: dict[int, str] = {}
        loops: dict[int, str] = {}
        try:
            with open_mcap(self.path, "a record of the service") as file:
                for record in mcap_records(file):
                    yield from self._take(record, topics, loops)
        except OSError as error:
            raise RecordingError(f"{self.path.name}: cannot be read ({error.strerror})") from None

    def _take(
        self, record: Any, topics: dict[int, str], loops: dict[int, str]
    ) -> Iterator[Recorded]:
        """Note what a record of the file says, or yield the step that it holds."""
        kind = type(record).__name__
        if kind == "Unreadable":
            self._unreadable(record)
        elif kind == "Metadata" and record.name.startswith(LOOP_METADATA):
            self.loops[record.name.removeprefix(LOOP_METADATA)] = record.metadata
        elif kind == "Channel":
            topics[record.id] = record.topic
            if name := record.metadata.get("loop"):
                loops[record.id] = name
        elif kind == "Message":
            topic = topics.get(record.channel_id, "")
            loop = loops.get(record.channel_id, "")
            try:
                if topic == COUNTS_TOPIC:
                    self.counts = json.loads(record.data)
                elif topic == STEP_TOPIC.format(loop):
                    yield read_message(loop, record.data)
            except ValueError:
                self.unreadable += 1

    def _unreadable(self, found: Unreadable) -> None:
        self.unreadable += 1
        self.cut_off = self.cut_off or found.cut_off


def record_lost(*paths: str | Path) -> int:
    """Return how many steps are missing in a record beyond those that it says are missing.

    Args:
        paths: the file, or all files of one recording in order, if the recorder was restarted.

    Raises:
        RecordingError: if a file is no record.
    """
    return sum(_missing(paths).values())


def _missing(paths: tuple[str | Path, ...]) -> Mapping[str, int]:
    """Return by loop how many steps are missing without being counted in the files."""
    seen: dict[tuple[str, int], list[int]] = {}
    said: dict[str, int] = {}
    for path in paths:
        record = Record(Path(path))
        for step in record.messages():
            # Steps found, end of the numbers, and what the worker has counted up to there.
            found = seen.setdefault((step.loop, step.worker), [0, 0, 0])
            found[0] += 1
            found[1], found[2] = max(found[1], step.number + 1), max(found[2], step.lost)
        for loop, counts in record.counts.items():
            said[loop] = said.get(loop, 0) + counts.get("dropped", 0) + counts.get("gone", 0)
    missing: dict[str, int] = {}
    for (loop, _), (count, end, lost) in seen.items():
        missing[loop] = missing.get(loop, 0) + end - count - lost
    return {loop: max(0, number - said.get(loop, 0)) for loop, number in missing.items()}
