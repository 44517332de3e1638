"""One process of the service that computes steps: all its loops in one thread, woken by epoll."""

from __future__ import annotations

import ctypes
import errno
import gc
import json
import os
import select
import signal
import socket
import struct
import time
from collections.abc import Callable, Mapping
from typing import Any, Final

from ergoqp.service.loop import NOT_SENT, SENT, Loop, Request
from ergoqp.service.schema import HEAD, SPOKEN, VERSION, Ask, Tell, note

_PEER: Final = struct.Struct("3i")
_DIE_WITH_PARENT: Final = 1
_LOCK_ALL: Final = 3
_LEFT: Final = 2.0
"""How long after its stop a loop that was left counts as moving [s]."""
_ROUND: Final = 0.25
"""How often a worker says that it lives [s]."""


class Client:
    """One connection to a loop.

    Attributes:
        request: the frame that is being received.
        filled: bytes of it that have arrived.
        pid: process at the other end.
        exchange: receives a request and answers a plain one, given the descriptor, the address of
            the request and `filled`; of the commander of a loop in machine code, else None.
    """

    def __init__(self, connection: socket.socket, loop: Loop, pid: int) -> None:
        """Take a connection."""
        self.socket, self.loop, self.pid = connection, loop, pid
        self.request: Request = loop.new_request()
        self.view = memoryview(self.request.buffer)
        self.filled, self.number = 0, connection.fileno()
        self.exchange: Callable[[int, int, int], int] | None = None


class Worker:
    """Loops, their listening sockets, and their clients.

    A loop has one commander: the connection whose step is answered first, until it ends.
    What a client sends cannot end the worker. A frame that is none ends that client's connection.
    """

    def __init__(
        self,
        loops: Mapping[str, Loop],
        listeners: Mapping[str, socket.socket],
        descriptions: Mapping[str, str],
        recorder: Any = None,
    ) -> None:
        """Take the loops of this process.

        Args:
            loops: the loops by name.
            listeners: listening socket of each.
            descriptions: what a client is told about each loop, an object of JSON.
            recorder: has a method ``record(loop, request, answer)``; None: nothing is recorded.
        """
        self._loops, self._descriptions, self._recorder = loops, descriptions, recorder
        self._poll = select.epoll()
        self._listening = {each.fileno(): (each, loops[name]) for name, each in listeners.items()}
        self._clients: dict[int, Client] = {}
        self._commanders: dict[str, Client] = {}
        self._steps = dict.fromkeys(loops, 0)
        self._since = time.time()
        # When the last commander of a loop left, and for how long its robot may move on [s].
        self._left: dict[str, float] = {}
        self._stops = {
            name: loop.stepper.problem.stop.duration + _LEFT for name, loop in loops.items()
        }
        self._spare = os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC)
        for number in self._listening:
            self._poll.register(number, select.EPOLLIN)

    @property
    def idle(self) -> bool:
        """Whether no loop has a commander, and no object moves."""
        return not self._commanders and not any(map(self._moves, self._loops.values()))

    def _moves(self, loop: Loop) -> bool:
        """Whether the object of a loop may move: not if it was left for longer than its stop."""
        if not loop.moved or loop.name in self._commanders:
            return loop.moved
        left = self._left.get(loop.name, 0.0)
        return time.monotonic() - left < self._stops[loop.name]

    def run(self, goes_on: Callable[[bool], bool]) -> None:
        """Serve until the process ends, or is asked to make room.

        Args:
            goes_on: called a few times per second, with whether this worker is idle; returns
                whether it goes on.
        """
        poll, due = self._poll.poll, 0.0
        while True:
            for number, _ in poll(_ROUND):
                client = self._clients.get(number)
                if client is not None:
                    self._receive(client)
                elif number in self._listening:
                    self._accept(*self._listening[number])
            if (now := time.monotonic()) >= due:
                due = now + _ROUND
                if not goes_on(self.idle):
                    return

    def _accept(self, listener: socket.socket, loop: Loop) -> None:
        try:
            connection, _ = listener.accept()
        except OSError as error:
            if error.errno in (errno.EMFILE, errno.ENFILE):
                self._turn_away(listener)
            return  # else it has gone already, or another worker took it
        pid, user, _ = _PEER.unpack(
            connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _PEER.size)
        )
        if user not in (0, os.getuid()):
            connection.close()
            return
        connection.setblocking(False)
        self._clients[connection.fileno()] = Client(connection, loop, pid)
        self._poll.register(connection.fileno(), select.EPOLLIN)

    def _turn_away(self, listener: socket.socket) -> None:
        """End the connection for which no descriptor is left; else it would wake this for ever."""
        os.close(self._spare)
        try:
            listener.accept()[0].close()
        except OSError:
            pass
        finally:
            self._spare = os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC)

    def _receive(self, client: Client) -> None:
        """Read what has arrived, and answer every whole frame."""
        if client.exchange is not None:
            # As few lines as can be before the answer is sent.
            found = client.exchange(client.number, client.request.address, client.filled)
            if found > 0 and found & 3:
                client.filled, done = 0, found & 3
                answer = client.loop.exchanged(client.request, done)
                if done == NOT_SENT:
                    self._end(client)
                elif done != SENT:
                    self._send(client, answer)
                self._note(client, answer)
            elif found != -1:
                self._arrived(client, max(found >> 2, 0))
            return
        try:
            count = client.socket.recv_into(client.view[client.filled :])
        except BlockingIOError:
            return
        except OSError:
            count = 0
        self._arrived(client, count)

    def _arrived(self, client: Client, count: int) -> None:
        """Answer what is whole now; 0 bytes: the connection has ended."""
        if not count:
            self._end(client)
            return
        client.filled += count
        while client.filled >= HEAD.size:
            length, version, kind, _, sequence = HEAD.unpack_from(client.view)
            whole = client.request.length
            if kind == Ask.describe and length == HEAD.size:
                self._send(client, self._described(client.loop, sequence))
            elif length != whole or version not in SPOKEN or kind != Ask.step:
                self._send(client, note(Tell.refused, sequence, _misfit(length, version, whole)))
                self._end(client)
                return
            elif client.filled < whole:
                return
            else:
                self._step(client, sequence)
            # A client sends one request at a time, but its next one may have arrived.
            rest = client.filled - length
            if rest > 0:  # of one that has ended it is negative
                client.view[:rest] = bytes(client.view[length : client.filled])
            client.filled = rest

    def _step(self, client: Client, sequence: int) -> None:
        loop = client.loop
        commander = self._commanders.get(loop.name)
        if commander is not client and commander is not None:
            words = f"loop {loop.name}: commanded by process {commander.pid} already"
            self._send(client, note(Tell.refused, sequence, words))
            return
        answer = loop.answer(client.request)
        if commander is None and isinstance(answer, memoryview):  # a step, and no refusal
            self._commanders[loop.name], client.exchange = client, loop.exchange
        self._send(client, answer)
        self._note(client, answer)

    def _note(self, client: Client, answer: bytes | memoryview) -> None:
        """Count an answer, and record it."""
        self._steps[client.loop.name] += 1
        if self._recorder is not None:
            self._recorder.record(client.loop, client.request, answer)
            if client.loop.unrecorded:
                client.loop.disarm()

    def _send(self, client: Client, frame: bytes | memoryview) -> None:
        """Send a frame; a client that does not read loses its connection."""
        try:
            if client.socket.send(frame, socket.MSG_NOSIGNAL) == len(frame):
                return
        except OSError:
            pass
        self._end(client)

    def _end(self, client: Client) -> None:
        number = client.socket.fileno()
        if self._clients.pop(number, None) is None:
            return
        self._poll.unregister(number)
        client.socket.close()
        client.filled = 0
        if self._commanders.get(client.loop.name) is client:
            del self._commanders[client.loop.name]
            self._left[client.loop.name] = time.monotonic()

    def _described(self, loop: Loop, sequence: int) -> bytes:
        """Return what a client has to know about a loop, and how the loop is."""
        commander = self._commanders.get(loop.name)
        health = {
            "pid": os.getpid(),
            "since": self._since,
            "steps": self._steps[loop.name],
            "taken_back": loop.undone,
            "commander": commander and commander.pid,
            "moves": self._moves(loop),
        }
        told = f'{self._descriptions[loop.name][:-1]}, "health": {json.dumps(health)}}}'
        return note(Tell.described, sequence, told, loop.session)


def _misfit(length: int, version: int, whole: int) -> str:
    if version not in SPOKEN:
        return f"version: got {version}, allowed {VERSION}"
    return f"frame: got {length} bytes, allowed {whole} for a step of this loop"


def die_with_parent() -> None:
    """Have this process ended when the one that forked it ends, however that ends."""
    ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGKILL)


def settle_in(priority: int | None) -> str:
    """Prepare a forked process for regular work; return what the log says about it.

    The collector is switched off: what exists now is never looked at again, and the loops make no
    circles of objects.

    Args:
        priority: of SCHED_FIFO. None: the usual scheduling.
    """
    gc.collect()
    gc.freeze()
    gc.disable()
    if priority is None:
        return "usual scheduling"
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except OSError as error:
        return f"SCHED_FIFO {priority} is not allowed here ({error.strerror}): usual scheduling"
    locked = ctypes.CDLL(None).mlockall(_LOCK_ALL) == 0
    return f"SCHED_FIFO {priority}, memory {'locked' if locked else 'not locked'}"
