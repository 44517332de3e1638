"""The C client in a process of its own, driven from a test."""

from __future__ import annotations

import os
import socket
import subprocess
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ergoqp.native.compiled import program
from ergoqp.service.c_header import header
from ergoqp.service.schema import ANSWER_HEAD, HEAD, KNOTS, Tell, answer_frame

N = 32


@dataclass
class Answer:
    """What a step of the C client gave."""

    fresh: bool
    status: str
    causes: int
    marks: int
    twist: np.ndarray
    cost: float
    posture_rate: np.ndarray
    margins: np.ndarray


def puppet_program() -> Path:
    """Return the program."""
    source = Path(__file__).with_name("puppet.c").read_text()
    return program("puppet", {"puppet.c": source, "ergoqp_client.h": header()})


class Puppet:
    """One client; its methods are the calls of the C client."""

    def __init__(self) -> None:
        self.process = subprocess.Popen(
            [puppet_program()], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def ask(self, *words: Any) -> str:
        """Return the answer to one command."""
        line = " ".join(repr(float(w)) if isinstance(w, float) else str(w) for w in words)
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()
        return self.process.stdout.readline().rstrip("\n")

    def numbers(self, *words: Any) -> np.ndarray:
        return np.array([float.fromhex(word) for word in self.ask(*words).split()])

    def init(
        self,
        path: Any,
        relay: Any = "-",
        dt: float = 0.01,
        timeout: float = 2.0,
        longest: float = 60.0,
        coordinates: int = N,
    ) -> bool:
        return self.ask("init", path, relay, coordinates, dt, timeout, longest) == "1"

    def give(self, name: str, values: Any) -> None:
        self.ask(name, *np.asarray(values, float).ravel().tolist())

    def step(self, posture: Any = None, what: str = "step") -> Answer:
        if posture is not None:
            self.give("posture", posture)
        fresh, status, causes, marks, rows, *rest = self.ask(what).split()
        values = np.array([float.fromhex(word) for word in rest])
        margins = values[-int(rows) :] if int(rows) else values[:0]
        rate = values[7 : len(values) - int(rows)]
        twist, cost = values[:6], float(values[6])
        return Answer(fresh == "1", status, int(causes), int(marks), twist, cost, rate, margins)

    @property
    def waits(self) -> bool:
        return self.ask("waits") == "1"

    @property
    def reason(self) -> str:
        return self.ask("reason")

    @property
    def counters(self) -> tuple[int, ...]:
        """Late, lost, refused."""
        return tuple(int(word) for word in self.ask("counters").split())

    def stop(self) -> np.ndarray:
        return self.numbers("stop").reshape(-1, 6)

    def end(self) -> None:
        self.process.kill()
        self.process.communicate()


class Fake:
    """A server on a socket that answers every request as a function says; None closes."""

    def __init__(self, path: Path, answer: Callable[[bytes], bytes | None]) -> None:
        self.path, self.requests, self.answer = path, list[bytes](), answer
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._listener.bind(os.fspath(path))
        self._listener.listen(4)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self._listener.settimeout(0.05)
        self._thread.start()

    def _serve(self) -> None:
        while not self._ended.is_set():
            try:
                connection, _ = self._listener.accept()
            except TimeoutError:
                continue
            connection.settimeout(0.05)
            with connection:
                self._talk(connection)

    def _talk(self, connection: socket.socket) -> None:
        while not self._ended.is_set():
            try:
                asked = connection.recv(65536)
                if not asked:
                    return
                self.requests.append(asked)
                if (told := self.answer(asked)) is None:
                    return
                connection.sendall(told)
            except TimeoutError:
                continue
            except OSError:
                return

    def end(self) -> None:
        self._ended.set()
        self._thread.join()
        self._listener.close()


def step_answer(
    asked: bytes,
    twist: Any = 0.1,
    knots: int = 2,
    rows: int = 3,
    dt: float = 0.01,
    session: int = 77,
    **changed: Any,
) -> bytearray:
    """Return an answer to a request: a twist, and a stop of equal steps."""
    layout = answer_frame(N, rows)
    frame = bytearray(layout.length)
    sequence = HEAD.unpack_from(asked)[4]
    ANSWER_HEAD.pack_into(
        frame, 0, len(frame), 1, Tell.step, session, sequence, 1, 0, 0, 0, 0, 0, N, rows, knots, 0.0
    )
    layout.numbers(frame, "twist")[:] = twist
    count = min(knots, KNOTS)
    layout.numbers(frame, "times")[:count] = dt * np.arange(1, count + 1)
    shares = 1 - np.arange(1, count + 1) / max(count, 1)
    with np.errstate(invalid="ignore"):
        stop = np.outer(shares, np.broadcast_to(twist, 6))
    layout.numbers(frame, "stop").reshape(KNOTS, 6)[:count] = stop
    for name, value in changed.items():
        layout.numbers(frame, name).flat[0] = value
    return frame
