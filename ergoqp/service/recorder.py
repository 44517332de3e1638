"""The recorder: what workers give it without waiting, and the process that writes it to a file."""

from __future__ import annotations

import gc
import json
import mmap
import os
import select
import signal
import socket
import struct
import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from ergoqp._version import __version__
from ergoqp.errors import InputError
from ergoqp.files.mcap import check_installed
from ergoqp.service.loop import Loop, Request
from ergoqp.service.record import (
    COUNTS_TOPIC,
    ENCODING,
    END_METADATA,
    LOOP_METADATA,
    MESSAGE_HEAD,
    PROFILE,
    STEP_TOPIC,
    VIEW_TOPIC,
    Recorded,
    guide_kind,
    loop_metadata,
    read_message,
    record_schema,
)
from ergoqp.service.schema import (
    ANSWER_HEAD,
    HEAD,
    REQUEST_HEAD,
    Flag,
    Frame,
    Tell,
    answer_frame,
    request_frame,
)
from ergoqp.service.served import Served
from ergoqp.step.causes import Status

SNAPSHOT: Final = 1_000_000_000
"""Longest time between two snapshots of a loop's state [ns]."""

BUFFER: Final = 1 << 23
"""Wanted size of the buffer between a worker and the recorder [bytes].

The system may allow less.
"""

_LONGEST: Final = 1 << 20
"""Longest message of a worker [bytes]."""

_NAME: Final = struct.Struct("<I")
"""Length of the loop's name, with which a worker's message begins."""

_PAUSE: Final = 0.005
"""The recorder sleeps for this long after it was woken [s]: a worker that finds it asleep, and not
waiting, need not wake it, which takes longer than the message."""

_CHUNK: Final = 0.5
"""Longest time for which steps are kept in memory before they are written [s]."""

_CHUNK_BYTES: Final = 1 << 20

_BACKLOG: Final = 1 << 26
"""Most bytes that wait for the disk; more steps are dropped and counted."""

_VIEW: Final = 1 / 30
"""Least time between two messages for viewers [s]."""

_ROUND: Final = 256
"""Messages of one worker that are read before it is the next one's turn."""

_MARKS: Final = 4
"""Numbers of a loop that a recorder tells the next one."""

_SLOTS: Final = 64
"""Chunks about whose end a recorder tells the next one."""


_NAMED: Final = 8
"""Most loops that a line of the log names."""


class Tally:
    """How many answers of each loop its workers gave so far, in memory that all processes share."""

    def __init__(self, loops: Sequence[str]) -> None:
        """Begin at zero."""
        self._places = {name: i for i, name in enumerate(loops)}
        self._counts = memoryview(mmap.mmap(-1, 8 * max(1, len(loops)))).cast("Q")

    def __getitem__(self, loop: str) -> int:
        """Return the count of a loop."""
        return self._counts[self._places[loop]]

    def add(self, loop: str) -> None:
        """Count one answer."""
        self._counts[self._places[loop]] += 1


@dataclass
class _Fed:
    """What a worker keeps about the recording of one loop."""

    head: bytearray
    at: int
    number: int = 0
    lost: int = 0
    since: int = -SNAPSHOT
    due: bool = True


class Feed:
    """A worker's end of the recording: every answer is given away or counted, without waiting.

    A recorder that is dead, stopped or slow is noticed only by counting: the next answer has the
    mark ``unrecorded``.
    """

    def __init__(self, sender: socket.socket, loops: Collection[str], tally: Tally) -> None:
        """Take the worker's end of a pair of sockets.

        Args:
            sender: that end.
            loops: names of the loops that are recorded; the others of the worker are not.
            tally: counts their answers.
        """
        sender.setblocking(False)
        self._send = sender.sendmsg
        self._worker = int.from_bytes(os.urandom(7), "little") + 1
        self._loops, self._tally = frozenset(loops), tally
        self._fed: dict[str, _Fed] = {}

    def record(self, loop: Loop, request: Request, answer: bytes | memoryview) -> None:
        """Give a request and its answer to the recorder, now and then with the state before."""
        fed = self._fed.get(loop.name)
        if fed is None:
            if loop.name not in self._loops:
                return
            name = loop.name.encode()
            head = bytearray(_NAME.size + len(name) + MESSAGE_HEAD.size)
            _NAME.pack_into(head, 0, len(name))
            head[_NAME.size : _NAME.size + len(name)] = name
            fed = self._fed[loop.name] = _Fed(head, _NAME.size + len(name))
        now, count, kind = time.time_ns(), 0, 0
        parts: list[Any] = [fed.head, request.buffer, answer]
        state = loop.before
        if state is not None and (loop.turned or fed.due or not 0 <= now - fed.since < SNAPSHOT):
            count, kind = state.size, guide_kind(loop.led)
            parts.append(state)
            if loop.led:
                parts.append(loop.led)
        asked, told = len(request.buffer), len(answer)
        MESSAGE_HEAD.pack_into(
            fed.head, fed.at, self._worker, fed.number, fed.lost, now, asked, told, count, kind
        )
        fed.number += 1
        self._tally.add(loop.name)
        try:
            self._send(parts)
        except OSError:
            fed.lost += 1
            fed.due = loop.unrecorded = True
            return
        if count:
            fed.since, fed.due = now, False


def recording_pair() -> tuple[socket.socket, socket.socket]:
    """Return the two ends between a worker and the recorder.

    The process that forks both keeps both, so that each of them can be forked again: a message
    waits in the buffer meanwhile.
    """
    sender, receiver = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    sender.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER)
    sender.setblocking(False)
    receiver.setblocking(False)
    return sender, receiver


def check_record(path: Path, again: bool = False) -> None:
    """Check that a recording can begin.

    Args:
        path: its file.
        again: whether it goes on beside an older file, under a name with a number.

    Raises:
        InputError: if there is such a file, or its folder cannot be written.
        MissingExtraError: if the package for records is not installed.
    """
    check_installed("--record")
    if path.exists() and not again:
        raise InputError(f"--record: {str(path)!r} exists already; give the name of a new file")
    if path.suffix != ".mcap":
        raise InputError(f"--record: got {str(path)!r}, allowed a name with the ending .mcap")
    folder = path.parent
    if not folder.is_dir():
        raise InputError(f"--record: there is no folder {str(folder)!r}; make it, or give another")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InputError(f"--record: cannot write in {str(folder)!r}; give a folder of yours")


class Disk:
    """A new file, which a thread writes: a slow disk does not keep the recorder from reading.

    Attributes:
        path: the wanted path, or the first free one with a number.
        before: path of the file before it, of another recorder; None: there is none.
        error: why nothing is written any more.
        written: bytes that are in the file.
        first: end of the first part that was taken since `held` began.
    """

    def __init__(self, path: Path) -> None:
        """Open the file, and start the thread.

        Raises:
            OSError: if it cannot be opened.
        """
        self.path, number = path, 0
        self.before: Path | None = None
        while True:
            try:
                self._file = self.path.open("xb", buffering=0)
                break
            except FileExistsError:
                number += 1
                self.before = self.path
                self.path = path.with_name(f"{path.stem}.{number}{path.suffix}")
        self.error: OSError | None = None
        self.written, self._at, self.first = 0, 0, 0
        self._waiting: deque[bytes] = deque()
        self._change = threading.Condition()
        self._ended = False
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    @property
    def full(self) -> bool:
        """Whether as much waits as is allowed."""
        return self._at - self.written > _BACKLOG

    def write(self, data: bytes) -> int:
        """Take whole records."""
        with self._change:
            if data:
                self._waiting.append(data)
                self._at += len(data)
                self.first = self.first or self._at
                self._change.notify()
        return len(data)

    @contextmanager
    def held(self) -> Iterator[None]:
        """Begin to write what is taken here only afterwards."""
        with self._change:
            self.first = 0
            yield

    def tell(self) -> int:
        """Return the position after what was taken."""
        return self._at

    def flush(self) -> None:
        """Do nothing: the thread writes as soon as it can."""

    def close(self) -> None:
        """Write what waits, and close the file."""
        with self._change:
            self._ended = True
            self._change.notify()
        self._thread.join()

    def _work(self) -> None:
        with self._file:
            while True:
                with self._change:
                    while not self._waiting and not self._ended:
                        self._change.wait()
                    if not self._waiting:
                        return
                    data = memoryview(self._waiting.popleft())
                try:
                    left = data
                    while left:
                        left = left[self._file.write(left) or 0 :]
                except OSError as error:
                    self.error = error
                    self._drop_the_rest()
                    return
                self.written += len(data)

    def _drop_the_rest(self) -> None:
        """End the file after its last whole record."""
        with suppress(OSError):  # it is then read up to there all the same
            self._file.truncate(self.written)


@dataclass
class _Loop:
    """What the recorder knows about one loop."""

    step: int
    view: int
    request: Frame
    answer: Frame
    coordinates: list[str]
    rows: list[str]
    reasons: dict[int, str]
    worker: int
    end: int
    lost: int
    recorded: int
    viewed: float = -1.0
    counts: dict[str, int] = field(
        default_factory=lambda: dict.fromkeys(("steps", "lost", "dropped", "gone"), 0)
    )

    @property
    def mark(self) -> tuple[int, int, int, int]:
        """What the next recorder has to know."""
        return self.worker, self.end, self.lost, self.recorded


class Recorder:
    """The process that writes what workers give it.

    Attributes:
        path: wanted name of the file; one that exists is never written.
    """

    def __init__(
        self,
        path: Path,
        receivers: Sequence[socket.socket],
        problems: Sequence[Served],
        say: Callable[[str], None],
    ) -> None:
        """Prepare a recording; nothing is opened before `run`, which may run in several forks.

        Args:
            path: the file.
            receivers: the recorder's end of each pair of sockets.
            problems: what is served.
            say: writes a line of the log.
        """
        self.path, self._receivers, self._problems, self._say = path, receivers, problems, say
        self._names = [name for each in problems for name in each.loop_names]
        self.tally = Tally(self._names)
        # It outlives this process: for each of the last chunks its end in the file, and by loop the
        # worker, the end of its numbers in the chunk, how many it had counted as lost by then, and
        # how many steps were recorded by then, in all files.
        numbers = 1 + _MARKS * len(self._names)
        memory = mmap.mmap(-1, 8 * _SLOTS * numbers)
        self._ends = np.frombuffer(memory, np.uint64).reshape(_SLOTS, numbers)
        self._chunks = self._held = 0
        self._loops: dict[str, _Loop] = {}
        self._buffer = memoryview(bytearray(_LONGEST))

    def run(self) -> None:
        """Write until SIGTERM, or until the file cannot be written."""
        gc.freeze()
        ended: list[int] = []
        signal.signal(signal.SIGTERM, lambda *_: ended.append(1))
        disk, path = None, self.path
        try:
            disk = self.begin()
            path = disk.path
            self._say(f"recorded in {str(path)!r}: process {os.getpid()}")
            self._write_until(ended, disk)
            self.finish()
            error = disk.error
        except OSError as found:
            error = found
        if error is None:
            return
        self._say(f"the recording has ended: {error.strerror}, {str(path)!r}; loops go on")
        if disk is None:  # no file could be opened
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            while True:
                signal.pause()
        self._say(f"until then {self.told()}")
        # The workers count what is lost from now on.
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
        if not ended:
            signal.sigwait({signal.SIGTERM})
        self._say(f"at the end {self.told()}")

    def begin(self) -> Disk:
        """Open a new file, and write what it begins with.

        Raises:
            OSError: if it cannot be opened.
        """
        from mcap.writer import CompressionType, Writer

        self._disk = Disk(self.path)
        before = self._take_over()
        # The disk is written like a file.
        stream: Any = self._disk
        self._file = Writer(stream, 1 << 62, CompressionType.ZSTD)  # `end_chunk` ends them all
        self._file.start(PROFILE, f"ergoqp {__version__}")
        frames = self._file.register_schema("ergoqp.Step", ENCODING, record_schema())
        shown = self._file.register_schema("ergoqp.View", "jsonschema", b'{"type": "object"}')
        counted = self._file.register_schema("ergoqp.Counts", "jsonschema", b'{"type": "object"}')
        self._counts = self._file.register_channel(COUNTS_TOPIC, "json", counted)
        for served in self._problems:
            for name in served.loop_names:
                self._file.add_metadata(LOOP_METADATA + name, loop_metadata(served, name))
                told = json.loads(served.description(name))
                coordinates, rows = told["coordinates"], told["rows"]
                worker, end, lost, recorded = before[self._names.index(name)]
                sizes = {"loop": name, "coordinates": str(len(coordinates)), "rows": str(len(rows))}
                sizes["names"] = json.dumps(coordinates)
                self._loops[name] = _Loop(
                    self._file.register_channel(STEP_TOPIC.format(name), ENCODING, frames, sizes),
                    self._file.register_channel(VIEW_TOPIC.format(name), "json", shown),
                    request_frame(len(coordinates)),
                    answer_frame(len(coordinates), len(rows)),
                    coordinates,
                    rows,
                    {int(number): text for number, text in told["reasons"].items()},
                    worker,
                    end,
                    lost,
                    recorded,
                )
        self._add_counts()
        self.end_chunk()
        return self._disk

    def _take_over(self) -> list[list[int]]:
        """Return by loop what a recorder before this one has in its file, and begin anew."""
        sizes = [each.stat().st_size for each in [self._disk.before] if each is not None]
        last = self._last_whole((sizes or [0])[0])
        self._ends[:] = 0
        self._ends[:, 1:] = last
        self._chunks = 0
        return last.reshape(-1, _MARKS).tolist()

    def _last_whole(self, size: int) -> np.ndarray:
        """Return what was told about the last chunk of a file of so many bytes."""
        whole = self._ends[self._ends[:, 0] <= size]
        last = whole[np.argmax(whole[:, 0])] if len(whole) else np.zeros_like(self._ends[0])
        return last[1:].copy()

    def told(self) -> str:
        """Return how many steps of each loop are in the files by now, and how many are not."""
        recorded = self._last_whole(self._disk.written).reshape(-1, _MARKS)[:, 3].tolist()
        counts = {
            name: (number, self.tally[name] - number)
            for name, number in zip(self._names, recorded, strict=True)
        }
        if len(counts) > _NAMED:
            others = list(counts)[_NAMED:]
            both = [counts.pop(name) for name in others]
            counts[f"{len(others)} other loops"] = sum(n for n, _ in both), sum(m for _, m in both)
        return "; ".join(
            f"{name}: {number} steps are recorded, {missing} are not"
            for name, (number, missing) in counts.items()
        )

    def _write_until(self, ended: Sequence[int], disk: Disk) -> None:
        """Write what arrives, in chunks of at most some time."""
        poll = select.poll()
        for each in self._receivers:
            poll.register(each, select.POLLIN)
        chunk = second = time.monotonic()
        while not ended and disk.error is None:
            poll.poll(1e3 * _CHUNK)
            time.sleep(_PAUSE)
            self.drain(_ROUND)
            now = time.monotonic()
            if now - second >= 1.0:
                second = now
                self._add_counts()
            if now - chunk >= _CHUNK or self._held > _CHUNK_BYTES:
                chunk = now
                self.end_chunk()

    def drain(self, most: int = 1 << 30) -> None:
        """Take what the workers have given: all, or at most so many messages of each."""
        for receiver in self._receivers:
            for _ in range(most):
                try:
                    size = receiver.recv_into(self._buffer)
                except BlockingIOError:
                    break
                if size:
                    self._take(self._buffer[:size])

    def end_chunk(self) -> None:
        """Have everything so far written, however little it is."""
        slot = self._ends[self._chunks % _SLOTS]
        self._chunks, self._held = self._chunks + 1, 0
        # Told before it is written: by the size of the file the next recorder sees whether it was.
        with self._disk.held():
            self._file.flush()
            slot[0] = -1 % (1 << 64)
            slot[1:] = [n for each in self._loops.values() for n in each.mark]
            slot[0] = self._disk.first

    def finish(self) -> None:
        """Write what is still there, the counts, and the index."""
        self.drain()
        self._add_counts()
        self.end_chunk()
        counts = {name: json.dumps(loop.counts) for name, loop in self._loops.items()}
        self._file.add_metadata(END_METADATA, counts)
        self._file.finish()
        self._disk.close()

    def _take(self, data: memoryview) -> None:
        """Write a worker's message."""
        start = _NAME.size + _NAME.unpack_from(data)[0]
        name, message = str(data[_NAME.size : start], "utf-8"), bytes(data[start:])
        loop = self._loops.get(name)
        if loop is None:
            return
        step = read_message(name, message)
        self._count(loop, step)
        if self._disk.full:
            loop.counts["dropped"] += 1
            return
        self._file.add_message(
            loop.step, step.time_ns, message, step.time_ns, step.number & 0xFFFFFFFF
        )
        self._held += len(message)
        loop.counts["steps"] += 1
        loop.recorded += 1
        now = 1e-9 * step.time_ns
        if not 0 <= now - loop.viewed < _VIEW and (view := _view(loop, step)) is not None:
            loop.viewed = now
            told = json.dumps(view, allow_nan=False).encode()
            self._file.add_message(loop.view, step.time_ns, told, step.time_ns)

    def _count(self, loop: _Loop, step: Recorded) -> None:
        """Count what is missing before a step, by its numbers."""
        if step.worker != loop.worker:
            loop.worker, loop.end, loop.lost = step.worker, 0, 0
        lost = step.lost - loop.lost
        loop.counts["lost"] += lost
        # What a recorder before this one had in its memory when it was killed.
        loop.counts["gone"] += step.number - loop.end - lost
        loop.end, loop.lost = step.number + 1, step.lost

    def _add_counts(self) -> None:
        """Write what was counted so far."""
        counts = {name: loop.counts for name, loop in self._loops.items()}
        now = time.time_ns()
        self._file.add_message(self._counts, now, json.dumps(counts).encode(), now)


def _view(loop: _Loop, step: Recorded) -> dict[str, Any] | None:
    """Return what viewers show of a step; None if the answer is no step."""
    if HEAD.unpack_from(step.answer)[2] != Tell.step:
        return None
    status, _, reason = ANSWER_HEAD.unpack_from(step.answer)[7:10]
    bits = REQUEST_HEAD.unpack_from(step.request)[8]

    def told(name: str) -> np.ndarray:
        return loop.answer.numbers(step.answer, name)

    twist, pose = told("twist"), told("pose").reshape(4, 4)
    view: dict[str, Any] = {
        "status": Status(status).name,
        "reason": loop.reasons.get(reason, ""),
        "cost": _number(told("cost")[0]),
        "twist": {"linear": _axes(twist[:3]), "angular": _axes(twist[3:])},
        "position": _axes(pose[:3, 3]),
        "margins": dict(zip(loop.rows, map(_number, told("margins")), strict=True)),
    }
    if bits & Flag.frame:
        posture = np.degrees(loop.request.numbers(step.request, "posture"))
        if bits & Flag.observed:
            posture[loop.request.numbers(step.request, "observed") != 1.0] = np.nan
        view["posture_deg"] = dict(zip(loop.coordinates, map(_number, posture), strict=True))
    return view


def _number(value: float) -> float | None:
    """Return a number for JSON, which has no NaN."""
    return float(value) if np.isfinite(value) else None


def _axes(values: np.ndarray) -> Mapping[str, float | None]:
    return dict(zip("xyz", map(_number, values), strict=True))
