"""The service: one process that holds problems and sockets, and forks the ones that work."""

from __future__ import annotations

import fcntl
import mmap
import os
import select
import signal
import socket
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NoReturn

from ergoqp.errors import ErgoqpError, InputError
from ergoqp.service.folder import socket_path
from ergoqp.service.served import Served
from ergoqp.service.systemd import inherited_sockets, notify, watchdog_seconds
from ergoqp.service.worker import Worker, die_with_parent, settle_in

BACKLOG: Final = 16
MOST_WORKERS: Final = 64
HANGS: Final = 10.0
"""A worker that does nothing for longer is ended and started again [s]."""
_ROUND: Final = 1.0
"""How often it is looked whether workers hang [s]."""
_LIVED: Final = 1.0
"""A process that lived for less than this died of itself [s]."""
_PATIENCE: Final = (0.0, 0.0, 0.05, 0.2, 1.0)
"""Waits before a process is forked again, by how many have died young in a row [s]."""
_FAREWELL: Final = 3.0
"""Time that a process has for finishing its work [s]."""


@dataclass
class Job:
    """One process of the service, which is forked again when it ends.

    Attributes:
        name: what it does, for the log.
        work: what runs in the process.
        again: whether it is forked again when it ends.
        last: whether it ends after the others, and may finish its work.
        worker: its number among the workers; None: it is none.
        pid: process; 0: it does not run.
        young: how many have died young in a row.
        due: when it is forked again (monotonic) [s].
    """

    name: str
    work: Callable[[], None]
    again: bool = True
    last: bool = False
    worker: int | None = None
    pid: int = 0
    young: int = 0
    due: float = 0.0
    began: float = field(default=0.0, repr=False)
    beat: int = field(default=0, repr=False)
    heard: float = field(default=0.0, repr=False)


class Supervisor:
    """Problems, listening sockets, and the processes that serve them.

    The sockets stay with this process, so a client that connects while a worker is replaced waits
    for the next one. All processes end with this one, however it ends.
    """

    def __init__(
        self,
        problems: Sequence[Served],
        folder: Path,
        workers: int,
        priority: int | None = None,
        record: Path | None = None,
    ) -> None:
        """Bind the sockets of all loops.

        Args:
            problems: what is served; their names differ.
            folder: private folder of the sockets.
            workers: number of processes that compute steps.
            priority: of SCHED_FIFO for the workers. None: the usual scheduling.
            record: new file that all steps are recorded in. None: nothing is recorded.

        Raises:
            InputError: if another service has one of the loops, or a socket cannot be bound.
        """
        self.folder, self._priority = folder, priority
        self.jobs: list[Job] = []
        self._problems = {each.name: each for each in problems}
        self._locks: list[int] = []
        self.listeners: dict[str, socket.socket] = {}
        # One byte of each worker: whether it shall make room, and one that it counts up.
        self._step_aside, self._beats = mmap.mmap(-1, MOST_WORKERS), mmap.mmap(-1, MOST_WORKERS)
        self._inherited = inherited_sockets()
        self._compiler: Job | None = None
        groups = [list(problems)[start::workers] for start in range(workers)]
        for each in problems:
            for name in each.loop_names:
                self._lock(name)
                kept = self._inherited.get(name)
                self.listeners[name] = kept or self.listen(socket_path(folder, name))
        self._groups = [group for group in groups if group]
        for number, group in enumerate(self._groups):
            names = ", ".join(each.name for each in group)
            job = Job(f"worker of {names}", lambda n=number, g=group: self._work(n, g))
            job.worker = number
            self.jobs.append(job)
        self._senders: list[socket.socket] = []
        if record is not None:
            self._record(record.absolute())

    def _record(self, path: Path) -> None:
        """Have another process record what the workers answer."""
        from ergoqp.service.recorder import Recorder, recording_pair

        pairs = [recording_pair() for _ in self._groups]
        self._senders = [sender for sender, _ in pairs]
        receivers = [receiver for _, receiver in pairs]
        recorder = Recorder(path, receivers, list(self._problems.values()), say)
        self.jobs.append(Job("recorder", recorder.run, last=True))

    def _lock(self, name: str) -> None:
        """Claim a loop's name; the lock is held by this process and all that it forks."""
        path = self.folder / f"{name}.lock"
        lock = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
        self._locks.append(lock)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.pread(lock, 20, 0).decode() or "another process"
            raise InputError(
                f"loop {name}: served by process {holder} in {str(self.folder)!r} already; end it,"
                " or give another --dir"
            ) from None
        os.ftruncate(lock, 0)
        os.pwrite(lock, str(os.getpid()).encode(), 0)

    def listen(self, path: Path) -> socket.socket:
        """Return a listening socket that only this user can connect to.

        Raises:
            InputError: if it cannot be bound.
        """
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            path.unlink(missing_ok=True)
            listener.bind(os.fspath(path))
            os.chmod(path, 0o600)
            listener.listen(BACKLOG)
        except OSError as error:
            raise InputError(
                f"--dir: cannot make the socket {str(path)!r}: {error.strerror}"
            ) from None
        listener.setblocking(False)
        return listener

    def _work(self, number: int, group: Sequence[Served]) -> None:
        """Serve the loops of a group; this is a worker's whole life."""
        said = settle_in(self._priority)
        loops, told = {}, {}
        for each in group:
            loops |= each.loops()
            told |= {name: each.description(name) for name in each.loop_names}
        say(f"{', '.join(loops)}: process {os.getpid()}, {said}")
        listeners = {name: self.listeners[name] for name in loops}
        waits = any(not each.engine for each in group) and self._compiler is not None
        feed = None
        if self._senders:
            from ergoqp.service.recorder import Feed

            feed = Feed(self._senders[number])

        def goes_on(idle: bool) -> bool:
            self._beats[number] = (self._beats[number] + 1) % 256
            return not (waits and idle and self._step_aside[number])

        Worker(loops, listeners, told, feed).run(goes_on)

    def compile_beside(self) -> None:
        """Compile the steps at idle priority; workers take them when nobody uses their loops.

        A worker that is forked later takes them at once.
        """

        def work() -> None:
            os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
            for each in self._problems.values():
                each.prepare(compiled=True)

        self._compiler = Job("compiler", work, again=False)
        self.jobs.append(self._compiler)

    def _compiled(self, status: int) -> None:
        """Take the compiled steps."""
        if status:  # the compiler's process has said why
            return
        try:
            for each in self._problems.values():
                each.prepare(compiled=True)
        except ErgoqpError as error:
            say(f"the step goes on interpreted: {error}")
            return
        self._step_aside[:] = b"\1" * len(self._step_aside)

    def _replace_what_hangs(self) -> None:
        """End workers that have not gone round their loop for a while."""
        now = time.monotonic()
        for job in self.jobs:
            if job.worker is None or not job.pid:
                continue
            if self._beats[job.worker] != job.beat:
                job.beat, job.heard = self._beats[job.worker], now
            elif now - max(job.heard, job.began) > HANGS:
                say(f"{job.name} did nothing for {HANGS:g} s, and is ended")
                os.kill(job.pid, signal.SIGKILL)
                job.heard = now

    def run(self) -> None:
        """Serve until SIGTERM or SIGINT, then end all processes."""
        reader, writer = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
        ended: list[int] = []
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda *_: ended.append(1))
        signal.signal(signal.SIGCHLD, lambda *_: None)
        pause = min(_ROUND, watchdog_seconds() or _ROUND)
        try:
            while not ended:
                self._fork_what_is_due()
                notify("READY=1\nWATCHDOG=1")
                self._replace_what_hangs()
                due = [job.due for job in self.jobs if not job.pid]
                wait = max(0.0, min([*due, time.monotonic() + pause]) - time.monotonic())
                if select.select([reader], [], [], wait)[0]:
                    os.read(reader, 4096)
                self._reap()
        finally:
            self._end_all()

    def _fork_what_is_due(self) -> None:
        now = time.monotonic()
        for job in self.jobs:
            if job.pid or job.due > now:
                continue
            job.began, job.pid = now, os.fork()
            if not job.pid:
                _live(job)

    def _reap(self) -> None:
        """Note which processes have ended."""
        for job in list(self.jobs):
            if not job.pid:
                continue
            pid, status = os.waitpid(job.pid, os.WNOHANG)
            if not pid:
                continue
            code = os.waitstatus_to_exitcode(status)
            lived = time.monotonic() - job.began
            job.young = 0 if lived > _LIVED else job.young + 1
            job.pid, wait = 0, _PATIENCE[min(job.young, len(_PATIENCE) - 1)]
            job.due = time.monotonic() + wait
            if job is self._compiler:
                self._compiled(code)
            if not job.again:
                self.jobs.remove(job)
            elif code:
                how = f"signal {-code}" if code < 0 else f"status {code}"
                say(f"{job.name} ended after {lived:.1f} s by {how}, and is started again")

    def _end_all(self) -> None:
        for job in sorted(self.jobs, key=lambda job: job.last):
            if job.pid and not (job.last and _finished(job.pid)):
                os.kill(job.pid, signal.SIGKILL)
                os.waitpid(job.pid, 0)
        for name, listener in self.listeners.items():
            listener.close()
            if name in self._inherited:
                continue
            socket_path(self.folder, name).unlink(missing_ok=True)


def _finished(pid: int) -> bool:
    """Ask a process to end; return whether it has done so."""
    os.kill(pid, signal.SIGTERM)
    until = time.monotonic() + _FAREWELL
    while time.monotonic() < until:
        if os.waitpid(pid, os.WNOHANG)[0]:
            return True
        time.sleep(0.01)
    return False


def _live(job: Job) -> NoReturn:
    """Do the work of a process, and end it."""
    die_with_parent()
    signal.set_wakeup_fd(-1)
    for number in (signal.SIGTERM, signal.SIGCHLD):
        signal.signal(number, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of a terminal: the supervisor ends this one
    status = 0
    try:
        job.work()
    except ErgoqpError as error:
        say(f"{job.name}: {error}")
        status = 1
    except Exception as error:
        say(f"{job.name}: internal fault, {type(error).__name__}: {error}")
        status = 1
    finally:
        sys.stderr.flush()
        os._exit(status)


def say(words: str) -> None:
    """Write a line of the log."""
    os.write(2, f"ergoqp serve: {words}\n".encode())
