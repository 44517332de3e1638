"""The service: one process that holds problems and sockets, and forks the ones that work."""

from __future__ import annotations

import contextlib
import fcntl
import gc
import mmap
import os
import resource
import select
import signal
import socket
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final, NoReturn

from ergoqp.errors import ErgoqpError, InputError
from ergoqp.service.folder import socket_path
from ergoqp.service.json_door import JsonDoor, OtherLoops
from ergoqp.service.loads import (
    LONGEST_PACKET,
    MOST_LOADED,
    Text,
    own_terms,
    pack_outcome,
    unpack_load,
)
from ergoqp.service.served import JSON_DOOR, Served
from ergoqp.service.systemd import inherited_sockets, notify, watchdog_seconds
from ergoqp.service.tcp import TOKEN_FILE, listen_tcp, new_token
from ergoqp.service.worker import Worker, die_with_parent, settle_in

if TYPE_CHECKING:
    from ergoqp.service.recorder import Recorder

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
_CHECKING: Final = 20
"""How long a process may compute to load a problem that a client sent [s of CPU]."""
_WORDS: Final = 4096
"""Longest words about a problem that is refused [bytes]."""
_LONGEST_LOAD: Final = 2 * _CHECKING
"""How long that process may take, and a worker until it begins to serve such a problem [s]."""
_LEAVING: Final = 2.0
"""How long a worker may take to make room for one with another problem [s]."""


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
        round: of a worker, what its byte was when it was forked.
    """

    name: str
    work: Callable[[], None]
    again: bool = True
    last: bool = False
    worker: int | None = None
    pid: int = 0
    young: int = 0
    due: float = 0.0
    round: int = 0
    began: float = field(default=0.0, repr=False)
    beat: int = field(default=0, repr=False)
    heard: float = field(default=0.0, repr=False)


@dataclass
class _Loading:
    """A problem that a client has sent, until it is served or refused.

    Attributes:
        number: number of the request.
        text: the problem.
        group: number of the worker that has the loop already; None: nobody has it.
        job: process that checks it, as long as it does.
        until: until when that worker may make room (monotonic) [s]; infinite while it is not asked.
    """

    number: int
    text: Text
    group: int | None
    job: Job
    until: float = float("inf")


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
        self._locks: dict[Path, int] = {}
        self.listeners: dict[str, socket.socket] = {}
        self._inherited = inherited_sockets()
        self._compiler: Job | None = None
        self._looked = time.monotonic()
        groups = [list(problems)[start::workers] for start in range(workers)]
        self._groups: list[list[Served | Text]] = [[*group] for group in groups if group]
        self._workers: list[Job] = []
        # Two bytes of each worker: the first asks it to make room once it is not what it was when
        # the worker was forked, and the second is counted up by the worker.
        most = MOST_WORKERS + MOST_LOADED
        self._rounds, self._beats = mmap.mmap(-1, most), mmap.mmap(-1, most)
        self._loading: _Loading | None = None
        self._own = own_terms(problems)
        # Why a problem is refused, written by the process that tries it.
        self._words = mmap.mmap(-1, _WORDS)
        self._door, self._to_door = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._door.setblocking(False)
        self._json: socket.socket | None = None
        try:
            for each in problems:
                for name in each.loop_names:
                    self._lock(f"loop {name}", name)
                    kept = self._inherited.get(name)
                    self.listeners[name] = kept or self.listen(socket_path(folder, name))
        except InputError:
            self._close()
            raise
        for number in range(len(self._groups)):
            self._add_worker(number)
        self._senders: list[socket.socket] = []
        self._recorder: Recorder | None = None
        if record is not None:
            self._record(record.absolute())

    def _record(self, path: Path) -> None:
        """Have another process record what the workers answer."""
        from ergoqp.service.recorder import Recorder, recording_pair

        pairs = [recording_pair() for _ in self._groups]
        self._senders = [sender for sender, _ in pairs]
        receivers = [receiver for _, receiver in pairs]
        self._recorder = Recorder(path, receivers, list(self._problems.values()), say)
        self.jobs.append(Job("recorder", self._recorder.run, last=True))

    def open_json_door(self, port: int | None = None) -> list[str]:
        """Serve lines of JSON by a process of its own; return what the log says about it.

        Args:
            port: port of loopback TCP; 0: any free one. None: TCP is closed.

        Raises:
            InputError: if a socket cannot be bound, or another service of this folder has the door.
        """
        self._lock("JSON door", JSON_DOOR)
        path = socket_path(self.folder, JSON_DOOR)
        self._json = unix = self.listen(path)
        said, tcp, token = [f"lines of JSON at {path}"], [], b""
        if port is not None:
            tcp, token = listen_tcp(port), new_token(self.folder)
            said.append(
                f"TCP on this machine at port {tcp[0].getsockname()[1]}, token in"
                f" {self.folder / TOKEN_FILE}"
            )

        def work() -> None:
            problems = {
                name: each for group in self._groups for each in group for name in each.loop_names
            }
            loops = OtherLoops(self.folder, problems, self._own, self._to_door)
            JsonDoor(loops, self.folder, unix, tcp, token).run()

        self.jobs.append(Job("JSON door", work))
        return said

    def _add_worker(self, number: int) -> None:
        names = ", ".join(each.name for each in self._groups[number])
        job = Job(f"worker of {names}", lambda: self._work(number), worker=number)
        self._workers.append(job)
        self.jobs.append(job)

    def _lock(self, what: str, name: str) -> None:
        """Claim the name of a socket; the lock is held by this process and all that it forks."""
        path, lock = self.folder / f"{name}.lock", -1
        try:
            lock = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            os.ftruncate(lock, 0)
            os.pwrite(lock, str(os.getpid()).encode(), 0)
        except BlockingIOError:
            holder = os.pread(lock, 20, 0).decode() or "another process"
            os.close(lock)
            raise InputError(
                f"{what}: served by process {holder} in {str(self.folder)!r} already; end it,"
                " or give another --dir"
            ) from None
        except OSError as error:
            if lock >= 0:
                os.close(lock)
            raise InputError(
                f"{what}: cannot make {str(path)!r}: {error.strerror}; give a folder of yours with"
                " --dir"
            ) from None
        self._locks[path] = lock

    def listen(self, path: Path) -> socket.socket:
        """Return a listening socket that only this user can connect to.

        Raises:
            InputError: if it cannot be bound.
        """
        try:
            listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
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

    def _work(self, number: int) -> None:
        """Serve the loops of a group; this is a worker's whole life."""
        mine = self._workers[number].round
        group = [each.load() if isinstance(each, Text) else each for each in self._groups[number]]
        # The record has the problems that the service was started with, and no others.
        kept = [each for each in self._groups[number] if isinstance(each, Served) and self._senders]
        recorded = [name for each in kept for name in each.loop_names]
        for each in group:
            each.prepare(bool(each.engine))
        said = settle_in(self._priority)
        loops, told = {}, {}
        for each in group:
            loops |= each.loops()
            told |= {name: each.description(name, name in recorded) for name in each.loop_names}
        say(f"{', '.join(loops)}: process {os.getpid()}, {said}")
        others = [name for name in told if name not in recorded]
        if self._recorder is not None and others:
            say(f"{', '.join(others)}: not recorded: its problem was sent by a client")
        listeners = {name: self.listeners[name] for name in loops}
        feed = None
        if recorded and self._recorder is not None:
            from ergoqp.service.recorder import Feed

            feed = Feed(self._senders[number], recorded, self._recorder.tally)

        def goes_on(idle: bool) -> bool:
            self._beats[number] = (self._beats[number] + 1) % 256
            return not (idle and self._rounds[number] != mine)

        Worker(loops, listeners, told, feed).run(goes_on)

    def compile_beside(self) -> None:
        """Compile the steps at idle priority; workers take them when nobody uses their loops.

        A worker that is forked later takes them at once.
        """

        def work() -> None:
            os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
            try:
                for each in self._problems.values():
                    each.prepare(compiled=True)
            except ErgoqpError as error:
                say(f"the step goes on interpreted: {error}")
                os._exit(1)

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
        for number, group in enumerate(self._groups):
            if any(isinstance(each, Served) for each in group):
                self._ask_to_leave(number)

    def _ask_to_leave(self, number: int, back: bool = False) -> None:
        """Have a worker leave once nobody uses its loops, or stay after all."""
        self._rounds[number] = (self._rounds[number] + (-1 if back else 1)) % 256

    def _replace_what_hangs(self) -> None:
        """End workers that have not gone round their loop for a while.

        If this process did not run itself (the machine slept, or all was stopped), neither did
        they.
        """
        now = time.monotonic()
        slept, self._looked = now - self._looked > HANGS / 2, now
        for job in self.jobs:
            if job.worker is None or not job.pid:
                continue
            if slept or self._beats[job.worker] != job.beat:
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
        # What exists now stays, so no process that is forked has to look for garbage in it: a
        # worker is there some 45 ms earlier.
        gc.collect()
        gc.freeze()
        try:
            while not ended:
                self._fork_what_is_due()
                notify("READY=1\nWATCHDOG=1")
                self._replace_what_hangs()
                due = [job.due for job in self.jobs if not job.pid]
                if self._loading is not None:
                    due.append(self._loading.until)
                wait = max(0.0, min([*due, time.monotonic() + pause]) - time.monotonic())
                woken = select.select([reader, self._door], [], [], wait)[0]
                if reader in woken:
                    os.read(reader, 4096)
                if self._door in woken:
                    self._hear()
                self._reap()
                self._stop_waiting()
        finally:
            self._end_all()

    def _fork_what_is_due(self) -> None:
        now = time.monotonic()
        for job in self.jobs:
            if job.pid or job.due > now:
                continue
            if job.worker is not None:
                job.round = self._rounds[job.worker]
                loads = any(isinstance(each, Text) for each in self._groups[job.worker])
                job.heard = now + (_LONGEST_LOAD if loads else 0.0)
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
            if self._loading is not None:
                self._go_on_loading(self._loading, job, code)
            if not job.again:
                self.jobs.remove(job)
            elif code:
                say(f"{job.name} ended after {lived:.1f} s by {_how(code)}, and is started again")

    def _hear(self) -> None:
        """Begin to load a problem that the door sends; its text is not read in this process."""
        try:
            number, name, problem = unpack_load(self._door.recv(LONGEST_PACKET))
        except (OSError, ValueError):
            return
        loaded = {each.name for group in self._groups for each in group if isinstance(each, Text)}
        if self._loading is not None:
            self._tell(number, "load: another problem is being loaded; send it again")
            return
        if len(loaded | {name}) > MOST_LOADED:
            self._tell(number, f"load: got {len(loaded)} loaded problems, allowed {MOST_LOADED}")
            return
        text = Text(name, problem, self._own)
        holds = [
            i for i, group in enumerate(self._groups) for each in group if name in each.loop_names
        ]
        self._words[:] = bytes(len(self._words))
        job = Job("check of a problem", lambda: self._check(text), again=False)
        self._loading = _Loading(number, text, holds[0] if holds else None, job)
        self.jobs.append(job)

    def _check(self, text: Text) -> None:
        """Try a problem; this is the whole life of a process."""
        os.nice(10)
        resource.setrlimit(resource.RLIMIT_CPU, (_CHECKING, _CHECKING + 1))
        signal.alarm(_LONGEST_LOAD)
        try:
            text.load().prepare(False)
        except ErgoqpError as error:
            # The words are for the client; the log gets nothing that a client wrote.
            words = str(error).encode()[: len(self._words) - 1]
            self._words[: len(words)] = words
            raise ErgoqpError("a client's problem was refused") from None

    def _go_on_loading(self, loading: _Loading, job: Job, code: int) -> None:
        """Take the next step of loading after a process has ended."""
        text, group = loading.text, loading.group
        if job is loading.job:
            said = self._words[:].rstrip(b"\0").decode(errors="ignore")
            if code and said:
                self._stop_loading(said)
            elif code:
                slow = -code in (signal.SIGXCPU, signal.SIGALRM)
                why = f"building it took more than {_CHECKING} s" if slow else _how(code)
                self._stop_loading(f"load: trying the problem failed ({why}); nothing is served")
            elif group is None:
                self._serve_new(text)
            else:
                loading.until = time.monotonic() + _LEAVING
                self._ask_to_leave(group)
        elif group is not None and job is self._workers[group] and loading.until < float("inf"):
            if code:
                self._stop_loading(f"loop {text.name}: its process ended; nothing was replaced")
                return
            self._groups[group] = [
                text if text.name in each.loop_names else each for each in self._groups[group]
            ]
            self._problems.pop(text.name, None)
            say(f"loop {text.name}: its problem is replaced by one that a client sent")
            self._stop_loading("")

    def _serve_new(self, text: Text) -> None:
        """Begin to serve a problem that was tried."""
        try:
            path = socket_path(self.folder, text.name)
            self._lock(f"loop {text.name}", text.name)
            self.listeners[text.name] = self.listen(path)
        except InputError as error:
            self._stop_loading(str(error))
            return
        self._groups.append([text])
        self._add_worker(len(self._groups) - 1)
        say(f"loop {text.name} at {path}, sent by a client")
        self._stop_loading("")

    def _stop_waiting(self) -> None:
        """Let a worker stay that did not make room."""
        loading = self._loading
        if loading is None or loading.group is None or time.monotonic() < loading.until:
            return
        self._ask_to_leave(loading.group, back=True)
        self._stop_loading(
            f"loop {loading.text.name}: it, or a loop beside it, is commanded or moves; nothing was"
            " replaced"
        )

    def _stop_loading(self, words: str) -> None:
        assert self._loading is not None
        self._tell(self._loading.number, words)
        self._loading = None

    def _tell(self, number: int, words: str) -> None:
        """Tell the door how loading ended; a door that does not listen loads again."""
        with contextlib.suppress(OSError):
            self._door.send(pack_outcome(number, words))

    def _end_all(self) -> None:
        for job in sorted(self.jobs, key=lambda job: job.last):
            if job.pid and not (job.last and _finished(job.pid)):
                os.kill(job.pid, signal.SIGKILL)
                os.waitpid(job.pid, 0)
        self._close()

    def _close(self) -> None:
        """Close the sockets, and remove what stands for them in the folder."""
        self._door.close()
        self._to_door.close()
        for name, listener in self.listeners.items():
            listener.close()
            if name in self._inherited:
                continue
            socket_path(self.folder, name).unlink(missing_ok=True)
        if self._json is not None:
            self._json.close()
            socket_path(self.folder, JSON_DOOR).unlink(missing_ok=True)
            (self.folder / TOKEN_FILE).unlink(missing_ok=True)
        for path, lock in self._locks.items():
            path.unlink(missing_ok=True)
            os.close(lock)


def _how(code: int) -> str:
    return f"signal {-code}" if code < 0 else f"status {code}"


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
    """Write a line of the log; nobody has to read it."""
    with contextlib.suppress(OSError):
        os.write(2, f"ergoqp serve: {words}\n".encode())
