"""How a door reaches a loop: by frames, to the loop itself or to its socket."""

from __future__ import annotations

import json
import os
import socket
import time
from pathlib import Path
from typing import Any, Final, Protocol

from ergoqp.errors import ErgoqpError
from ergoqp.service.loop import Loop
from ergoqp.service.schema import ANSWER_HEAD, HEAD, LONGEST, VERSION, Ask

PATIENCE: Final = 2.0
"""How long a loop may take to answer [s]."""


class LinkError(ErgoqpError):
    """A loop gave no answer.

    Example:
        >>> from pathlib import Path
        >>> from ergoqp.service.links import LinkError, SocketLink
        >>> try:
        ...     SocketLink(Path("/nowhere/screwing.sock"), "screwing")
        ... except LinkError as error:
        ...     print(error)
        loop screwing: nobody answers at its socket; the service is ending, or send it again
    """


class Link(Protocol):
    """A way to one loop."""

    def describe(self) -> dict[str, Any]:
        """Return what the loop is, and how it is."""
        ...

    def ask(self, request: bytes | bytearray) -> bytes | memoryview:
        """Return the answer to a frame."""
        ...

    def close(self) -> None:
        """Give the loop free."""
        ...


class DirectLink:
    """A loop of the same process."""

    def __init__(self, loop: Loop, description: str) -> None:
        """Keep the loop, and what it is, an object of JSON."""
        self._loop, self._description = loop, description
        self._request = loop.new_request()
        self._steps = 0

    def describe(self) -> dict[str, Any]:
        """Return what the loop is, and how it is."""
        health = {
            "pid": os.getpid(),
            "steps": self._steps,
            "taken_back": self._loop.undone,
            "moves": self._loop.moved,
        }
        return json.loads(self._description) | {"health": health}

    def ask(self, request: bytes | bytearray) -> bytes | memoryview:
        """Return the answer to a frame."""
        self._request.buffer[:] = request
        self._steps += 1
        return self._loop.answer(self._request)

    def close(self) -> None:
        """Do nothing."""


class SocketLink:
    """A loop of another process, reached as every client reaches it.

    A link whose answer did not come in time is not used again, so that no answer is ever taken for
    that to another request.
    """

    def __init__(self, path: Path, loop: str) -> None:
        """Connect.

        Raises:
            LinkError: if nobody answers.
        """
        self._loop = loop
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._socket.settimeout(PATIENCE)
        try:
            self._socket.connect(os.fspath(path))
        except OSError:
            self._socket.close()
            raise LinkError(
                f"loop {loop}: nobody answers at its socket; the service is ending, or send it"
                " again"
            ) from None

    def describe(self) -> dict[str, Any]:
        """Return what the loop is, and how it is.

        Raises:
            LinkError: if it gives no answer.
        """
        answer = self.ask(HEAD.pack(HEAD.size, VERSION, Ask.describe, 0, 1))
        return json.loads(bytes(answer[ANSWER_HEAD.size :]))

    def ask(self, request: bytes | bytearray) -> bytes:
        """Return the answer to a frame.

        Raises:
            LinkError: if there is none in time, or one that is none.
        """
        until = time.monotonic() + PATIENCE
        try:
            self._socket.sendall(request)
            frame = self._read(HEAD.size, until)
            length = HEAD.unpack(frame)[0]
            if not HEAD.size <= length <= LONGEST:
                raise OSError
            return frame + self._read(length - HEAD.size, until)
        except OSError:
            self.close()
            raise LinkError(
                f"loop {self._loop}: gave no answer within {PATIENCE:g} s, or ended; say what the"
                ' robot did by "followed" or "standing"'
            ) from None

    def close(self) -> None:
        """Give the loop free."""
        self._socket.close()

    def _read(self, count: int, until: float) -> bytes:
        parts = bytearray()
        while len(parts) < count:
            left = until - time.monotonic()
            if left <= 0:
                raise TimeoutError
            self._socket.settimeout(left)
            if not (more := self._socket.recv(count - len(parts))):
                raise ConnectionResetError
            parts += more
        return bytes(parts)
