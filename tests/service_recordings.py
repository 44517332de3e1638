"""Records of loops that run in the process of the test."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer

from ergoqp.files.mcap import mcap_records
from ergoqp.service.loop import Loop
from ergoqp.service.recorder import Feed, Recorder, recording_pair
from ergoqp.service.schema import ANSWER_HEAD, REQUEST_HEAD, VERSION, Ask, Flag, Tell, answer_frame
from ergoqp.service.served import Served

USUAL = int(Flag.frame | Flag.enable)


class Recording:
    """Loops of a problem, a client of each, and the recorder that gets their steps."""

    def __init__(self, path: Path, *problems: Served) -> None:
        self.sender, self.receiver = recording_pair()
        self.log: list[str] = []
        self.recorder = Recorder(path, [self.receiver], problems, self.log.append)
        self.disk = self.recorder.begin()
        self.problems = problems
        self.work()

    def work(self) -> None:
        """Begin with loops as a new worker does."""
        loops = {name: loop for each in self.problems for name, loop in each.loops().items()}
        self.feed = Feed(self.sender, loops, self.recorder.tally)
        self.talks = {name: Talk(loop, self.feed) for name, loop in loops.items()}

    def again(self) -> None:
        """Go on with another recorder, as if the one before was killed."""
        self.disk.close()
        self.disk = self.recorder.begin()

    def write(self) -> None:
        """Have everything so far in the file."""
        self.recorder.drain()
        self.recorder.end_chunk()

    def end(self) -> None:
        self.recorder.finish()
        self.sender.close()
        self.receiver.close()


class Talk:
    """A client of a loop, which acts on every answer unless it is told otherwise."""

    def __init__(self, loop: Loop, feed: Feed) -> None:
        self.loop, self.feed, self.request = loop, feed, loop.new_request()
        self.session = self.acted = self.sequence = 0
        self.answer: tuple[Any, ...] = ()
        self.twist = np.zeros(6)

    def ask(
        self,
        posture: Any = None,
        bits: int = 0,
        *,
        followed: int = 0,
        dt: float = 0.01,
        age: float = 0.0,
        act: bool = True,
        **arrays: Any,
    ) -> bytes:
        """Send a request; `act`: the robot will execute the answer."""
        self.sequence += 1
        request, loop = self.request, self.loop
        for name, value in arrays.items():
            bits |= Flag[name] if name in Flag.__members__ else 0
            getattr(request, name)[...] = value
        if posture is not None:
            bits |= USUAL
            request.posture[:] = posture
        head = (self.session, self.sequence, self.acted, 0, followed, bits, loop.coordinates, 0)
        REQUEST_HEAD.pack_into(request.buffer, 0, request.length, VERSION, Ask.step, *head, age, dt)
        answer = loop.answer(request)
        self.answer = ANSWER_HEAD.unpack_from(answer)
        self.feed.record(loop, request, answer)
        if self.answer[2] == Tell.step and act:
            self.session, self.acted = self.answer[3], self.sequence
            self.twist = answer_frame(loop.coordinates, loop.rows).numbers(bytes(answer), "twist")
        return bytes(answer)


@contextmanager
def recording(path: Path, *problems: Served) -> Iterator[Recording]:
    """Record loops in a file, which is whole at the end."""
    found = Recording(path, *problems)
    try:
        yield found
    finally:
        found.end()


def rewritten(
    path: Path,
    into: Path,
    message: Callable[[str, bytes], bytes | None] = lambda _, data: data,
    metadata: Callable[[dict[str, str]], dict[str, str]] = lambda told: told,
    profile: str | None = None,
) -> Path:
    """Copy a record, with its steps changed, or left out (None), or its metadata changed."""
    channels: dict[int, tuple[str, int]] = {}
    schemas: dict[int, int] = {}
    with path.open("rb") as file, into.open("wb") as out:
        writer = Writer(out, compression=CompressionType.ZSTD)
        for record in mcap_records(file):
            kind = type(record).__name__
            if kind == "Header":
                writer.start(record.profile if profile is None else profile)
            elif kind == "Schema" and record.id not in schemas:
                schemas[record.id] = writer.register_schema(
                    record.name, record.encoding, record.data
                )
            elif kind == "Channel" and record.id not in channels:
                new = writer.register_channel(
                    record.topic,
                    record.message_encoding,
                    schemas[record.schema_id],
                    record.metadata,
                )
                channels[record.id] = record.topic, new
            elif kind == "Metadata":
                writer.add_metadata(record.name, metadata(record.metadata))
            elif kind == "Message":
                topic, channel = channels[record.channel_id]
                data: bytes | None = record.data
                if topic.endswith("/step"):
                    data = message(topic, record.data)
                if data is not None:
                    writer.add_message(
                        channel, record.log_time, data, record.publish_time, record.sequence
                    )
        writer.finish()
    return into


def messages(path: Path, topic: str) -> list[Any]:
    """Return what the JSON messages of a topic hold."""
    channels: dict[int, str] = {}
    found = []
    with path.open("rb") as file:
        for record in mcap_records(file):
            if type(record).__name__ == "Channel":
                channels[record.id] = record.topic
            elif type(record).__name__ == "Message" and channels[record.channel_id] == topic:
                found.append(json.loads(record.data))
    return found
