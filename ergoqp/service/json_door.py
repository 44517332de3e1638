"""The process that speaks JSON: connections by socket, each in a thread, clients of the loops.

It holds no loop and computes no step. Towards a loop it is a client like every other, so what comes
in as JSON reaches no worker but as a frame.
"""

from __future__ import annotations

import os
import select
import socket
import struct
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from ergoqp.problem.problem import Problem
from ergoqp.service.command import Refused
from ergoqp.service.door import Handler
from ergoqp.service.folder import socket_path
from ergoqp.service.lines import LONGEST_LINE, write_line
from ergoqp.service.links import Link, LinkError, SocketLink
from ergoqp.service.loads import Own, Text, pack_load, unpack_outcome
from ergoqp.service.served import Served, check_name
from ergoqp.service.tcp import Entry, admit, forward

MOST_CONNECTIONS: Final = 32
"""Most connections at once by each of the Unix socket and TCP."""

MOST_STRANGERS: Final = 16
"""Most connections by TCP at once that have not sent the token; one more ends the oldest."""

LONGEST_WAIT: Final = 10.0
"""How long a line may take from its first byte to its end [s]."""

STUCK: Final = 5.0
"""How long a client may refuse to take an answer [s]."""
_LOADING: Final = 60.0
"""How long loading a problem may take [s]."""
_PEER: Final = struct.Struct("3i")


class OtherLoops:
    """The loops of the workers, as the door reaches them."""

    def __init__(
        self,
        folder: Path,
        problems: Mapping[str, Served | Text],
        own: Own,
        supervisor: socket.socket,
    ) -> None:
        """Take what is served.

        Args:
            folder: folder of the sockets.
            problems: the problem of each loop.
            own: own terms that a problem may have.
            supervisor: socket of packets to the process that loads problems.
        """
        self._folder, self._problems, self._supervisor = folder, dict(problems), supervisor
        self._one_loads, self._lock = threading.Lock(), threading.Lock()
        self._built: dict[str, Problem] = {}
        self._own = own
        self.labels: dict[str, str] = {}

    @property
    def names(self) -> list[str]:
        """Names of the loops."""
        return list(self._problems)

    def link(self, loop: str) -> Link:
        """Return a new connection to a loop.

        Raises:
            LinkError: if nobody answers.
        """
        return SocketLink(socket_path(self._folder, loop), loop)

    def problem(self, loop: str) -> Problem:
        """Return the problem of a loop."""
        found = self._problems[loop]
        if isinstance(found, Served):
            return found.problem
        with self._lock:
            if loop not in self._built:
                self._built[loop] = found.load().problem
            return self._built[loop]

    def load(self, name: str, problem: str) -> None:
        """Serve the problem of a text, in a process of its own.

        Raises:
            ProblemError: if the name cannot be used.
            Refused: if it cannot be served.
        """
        check_name(name)
        if not self._one_loads.acquire(blocking=False):
            raise Refused("load: another problem is being loaded; send it again")
        try:
            if name in self._problems:
                self._check_rests(name)
            words = self._load(name, problem)
            if words:
                raise Refused(words)
            with self._lock:
                self._problems[name] = Text(name, problem, self._own)
                self._built.pop(name, None)
            self._await(name)
        finally:
            self._one_loads.release()

    def commander(self, loop: str, words: str) -> str:
        """Return the words of a refusal; a connection of this door is named by its own peer."""
        label = self.labels.get(loop, "another connection by the JSON door or TCP")
        return words.replace(f"by process {os.getpid()} already", f"by {label} already")

    def _check_rests(self, name: str) -> None:
        link = self.link(name)
        try:
            health = link.describe()["health"]
        finally:
            link.close()
        if health["commander"] is not None:
            words = self.commander(name, f"commanded by process {health['commander']} already")
            raise Refused(f"loop {name}: {words}; nothing was replaced")
        if health["moves"]:
            raise Refused(f"loop {name}: moves, or was left moving; nothing was replaced")

    def _load(self, name: str, problem: str) -> str:
        """Ask the supervisor; return why it refuses, or nothing."""
        number, until = time.monotonic_ns(), time.monotonic() + _LOADING
        try:
            self._supervisor.settimeout(STUCK)
            self._supervisor.send(pack_load(number, name, problem))
            while (left := until - time.monotonic()) > 0:
                self._supervisor.settimeout(left)
                told, words = unpack_outcome(self._supervisor.recv(65536))
                if told == number:  # another one is that to a door that has ended
                    return words
        except OSError:
            pass
        return f"load: problem {name} was not loaded within {_LOADING:g} s"

    def _await(self, name: str) -> None:
        """Wait until the loop's new process answers."""
        until = time.monotonic() + _LOADING
        while True:
            with suppress(LinkError):
                link = self.link(name)
                link.describe()
                link.close()
                return
            if time.monotonic() > until:
                raise Refused(f"loop {name}: was loaded, and does not answer")
            time.sleep(0.05)


class JsonDoor:
    """Listening sockets, and a thread for each connection."""

    def __init__(
        self,
        loops: OtherLoops,
        folder: Path,
        unix: socket.socket,
        tcp: Sequence[socket.socket],
        token: bytes,
    ) -> None:
        """Take the sockets.

        Args:
            loops: the loops.
            folder: folder of the loops' sockets.
            unix: listening socket for lines of JSON.
            tcp: listening sockets on loopback; none: TCP is closed.
            token: what a connection by TCP has to send first.
        """
        self._loops, self._folder, self._token = loops, folder, token
        self._unix, self._tcp = unix, list(tcp)
        self._room = {True: MOST_CONNECTIONS, False: MOST_CONNECTIONS}
        self._strangers: list[socket.socket] = []
        self._lock = threading.Lock()

    def run(self) -> None:
        """Serve until the process ends."""
        while True:
            for listener in select.select([self._unix, *self._tcp], [], [])[0]:
                try:
                    connection, peer = listener.accept()
                except OSError:  # it has gone already
                    continue
                self._begin(connection, listener is self._unix, peer)

    def _begin(self, connection: socket.socket, by_unix: bool, peer: object) -> None:
        """Serve a connection in a thread, if there is room."""
        if by_unix:
            pid, user, _ = _PEER.unpack(
                connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _PEER.size)
            )
            if user not in (0, os.getuid()):
                connection.close()
                return
            label = f"process {pid} (JSON)"
        else:
            label = f"{peer[0]} port {peer[1]} (TCP)" if isinstance(peer, tuple) else "TCP"
        if by_unix and not self._take_place(connection, by_unix):
            connection.close()
            return
        if not by_unix:
            self._add_stranger(connection)
        threading.Thread(
            target=self._serve, args=(connection, by_unix, label), name=label, daemon=True
        ).start()

    def _take_place(self, connection: socket.socket, by_unix: bool) -> bool:
        """Take one of the places; return whether there was one."""
        with self._lock:
            full = not self._room[by_unix]
            self._room[by_unix] -= not full
        if full:
            words = f"got more than {MOST_CONNECTIONS} connections at once, allowed as many"
            connection.setblocking(False)
            with suppress(OSError):
                connection.send(write_line({"error": words}))
        return not full

    def _add_stranger(self, connection: socket.socket) -> None:
        """Note a connection that has not sent the token; if there are too many, end the oldest."""
        with self._lock:
            self._strangers.append(connection)
            oldest = self._strangers.pop(0) if len(self._strangers) > MOST_STRANGERS else None
        if oldest is not None:
            with suppress(OSError):  # its thread finds it ended, and closes it
                oldest.shutdown(socket.SHUT_RDWR)

    def _serve(self, connection: socket.socket, by_unix: bool, label: str) -> None:
        has_place = by_unix
        try:
            with connection:
                if by_unix:
                    self._converse(connection, label, b"", patient=True)
                elif (entry := self._admit(connection)) is not None:
                    has_place = self._take_place(connection, by_unix)
                    if has_place:
                        self._enter(connection, entry, label)
        except OSError:  # the client has gone, or does not read
            pass
        finally:
            with self._lock:
                self._room[by_unix] += has_place

    def _admit(self, connection: socket.socket) -> Entry | None:
        """Return what a connection by TCP asks for, once it has sent the token."""
        try:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            entry = admit(connection, self._token, self._loops.names)
            if isinstance(entry, Entry):
                return entry
            if entry:
                connection.settimeout(STUCK)
                connection.sendall(write_line({"error": entry}))
            return None
        finally:
            with self._lock, suppress(ValueError):  # it was ended for another one
                self._strangers.remove(connection)

    def _enter(self, connection: socket.socket, entry: Entry, label: str) -> None:
        """Serve a connection by TCP that has sent the token."""
        if entry.loop is None:
            self._converse(connection, label, entry.rest, patient=False)
        else:
            forward(connection, socket_path(self._folder, entry.loop), entry.rest)

    def _converse(self, connection: socket.socket, label: str, rest: bytes, patient: bool) -> None:
        """Answer the lines of a connection; an impatient one ends with its first bad line."""
        handler = Handler(self._loops, time.monotonic)
        try:
            for line in lines_from(connection, rest):
                answer = handler.answer(line)
                if handler.commands is not None:
                    self._loops.labels[handler.commands] = label
                connection.settimeout(STUCK)
                connection.sendall(answer.line)
                if answer.bad and not patient:
                    return
        except TimeoutError:
            words = f"line: got no end within {LONGEST_WAIT:g} s"
            with suppress(OSError):
                connection.send(write_line({"error": words}), socket.MSG_DONTWAIT)
        finally:
            if handler.commands is not None and self._loops.labels.get(handler.commands) == label:
                del self._loops.labels[handler.commands]
            handler.close()


def lines_from(connection: socket.socket, rest: bytes = b"") -> Iterator[bytes]:
    """Yield the lines of a connection without their ends; of one that is too long its beginning.

    Args:
        connection: the connection.
        rest: what was read of it already.

    Raises:
        TimeoutError: if a line does not end in time.
        OSError: if the connection fails.
    """
    buffer, searched, skips = bytearray(rest), 0, False
    begun = time.monotonic()
    while True:
        end = buffer.find(b"\n", searched)
        if end >= 0:
            line = bytes(buffer[:end]).rstrip(b"\r")
            del buffer[: end + 1]
            searched, begun = 0, time.monotonic()
            if not skips:
                yield line
                begun = time.monotonic()
            skips = False
            continue
        if len(buffer) > LONGEST_LINE:
            if not skips:
                yield bytes(buffer[: LONGEST_LINE + 1])
            buffer.clear()
            skips = True
        searched = len(buffer)
        left = None
        if buffer or skips:
            left = begun + LONGEST_WAIT - time.monotonic()
            if left <= 0:
                raise TimeoutError
        connection.settimeout(left)
        more = connection.recv(65536)
        if not more:
            if buffer and not skips:
                yield bytes(buffer)
            return
        if not buffer and not skips:
            begun = time.monotonic()
        buffer += more
