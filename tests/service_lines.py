"""A client of the service's lines of JSON, for tests."""

from __future__ import annotations

import json
import socket
import time
from pathlib import Path
from typing import Any

import ergoqp
from ergoqp.service.door import Handler
from ergoqp.service.served import served
from ergoqp.service.stdio import OwnLoops

COMFORT: list[float] = ergoqp.load_problem("screwing").response.comfort.tolist()


class Lines:
    """A connection that sends lines of JSON and reads the answers."""

    def __init__(self, connection: socket.socket) -> None:
        self.socket = connection
        self.socket.settimeout(60)
        self.file = connection.makefile("rb")

    @classmethod
    def by_unix(cls, folder: Path) -> Lines:
        """Connect, once the door is there."""
        until = time.monotonic() + 60
        while True:
            connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            try:
                connection.connect(str(folder / "json.sock"))
                return cls(connection)
            except OSError:
                connection.close()
                assert time.monotonic() < until
                time.sleep(0.05)

    @classmethod
    def by_tcp(cls, port: int, address: str = "127.0.0.1") -> Lines:
        return cls(socket.create_connection((address, port)))

    def send(self, line: bytes) -> None:
        self.socket.sendall(line)

    def read(self) -> dict[str, Any] | None:
        """Return the next answer; None: the connection has ended."""
        try:
            line = self.file.readline()
        except ConnectionResetError:
            return None
        return json.loads(line) if line else None

    def ask(self, **request: Any) -> dict[str, Any]:
        self.send(json.dumps(request).encode() + b"\n")
        answer = self.read()
        assert answer is not None
        return answer

    def close(self) -> None:
        self.file.close()
        self.socket.close()

    def __enter__(self) -> Lines:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Clock:
    """A clock that a test sets."""

    now = 100.0

    def __call__(self) -> float:
        return self.now


class Talk:
    """A handler with one loop or two, and a clock."""

    def __init__(self, *names: str, timed: bool = False) -> None:
        self.loops = OwnLoops([served(name) for name in names or ("screwing",)])
        self.clock = Clock()
        self.handler = Handler(self.loops, self.clock if timed else None)

    def line(self, line: bytes) -> dict[str, Any]:
        answer = self.handler.answer(line).line
        assert answer.endswith(b"\n")
        assert answer.count(b"\n") == 1
        return json.loads(answer)

    def ask(self, **request: Any) -> dict[str, Any]:
        return self.line(json.dumps(request).encode())

    def step(self, **said: Any) -> dict[str, Any]:
        return self.ask(step={"posture": COMFORT, **said})


def error_of(answer: dict[str, Any]) -> str:
    assert set(answer) <= {"error", "id"}, answer
    assert "\n" not in answer["error"]
    return answer["error"]
