"""A connection on which one question is answered at a time, and no call waits for long."""

from __future__ import annotations

import os
import select
import socket
import struct
import time
from pathlib import Path
from typing import Final

from ergoqp.service.schema import LONGEST

_QUIET: Final = int(socket.MSG_NOSIGNAL)
_SELECTED: Final = 1024
"""Descriptors from this number on cannot be given to `select.select`."""


class Stream:
    """A client's end of a Unix socket; a question that is late stays outstanding.

    Attributes:
        path: path of the socket.
        socket: the connection, if there is one.
        outstanding: number of the question that is not answered yet; 0: none.
        why: what went wrong last.
        late: answers that did not come in time; lost: connections; refused: answers that were none.
    """

    def __init__(
        self, who: str, path: str | Path, head: struct.Struct, version: int, unasked: bool = False
    ) -> None:
        """Connect to nothing yet.

        Args:
            who: name of the other side, for `why`.
            path: path of the socket.
            head: what all frames begin with: length, version, ..., and last the number.
            version: that of the frames.
            unasked: whether a frame of the number 0 may come too, which answers no question.
        """
        self.path, self.socket, self.number = os.fspath(path), None, -1
        self.outstanding = self.late = self.lost = self.refused = 0
        self.why = ""
        self._who, self._head, self._version, self._unasked = who, head, version, unasked
        self._got = 0

    def connect(self) -> bool:
        """Connect without waiting, if that is needed; return whether it worked."""
        if self.socket is not None:
            return True
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        connection.setblocking(False)
        try:
            connection.connect(self.path)
        except OSError:
            connection.close()
            self.lost += 1
            self.why = f"{self._who}: nobody answers at {self.path!r}"
            return False
        self.socket, self.number = connection, connection.fileno()
        return True

    def close(self) -> None:
        """End the connection; what is outstanding will not be answered."""
        if self.socket is not None:
            self.socket.close()
        self.socket, self.number = None, -1
        self.outstanding = self._got = 0

    def send(self, frame: bytearray | memoryview | bytes, number: int) -> bool:
        """Send a question; return whether it was sent as a whole. It does not close."""
        connection = self.socket
        try:
            if connection is None or connection.send(frame, _QUIET) != len(frame):
                return False
        except OSError:
            return False
        return self.sent(number, 0)

    def sent(self, number: int, got: int) -> bool:
        """Note that a question was sent, and how much of its answer has arrived; negative: not."""
        if got >= 0:
            self.outstanding, self._got = number, got
        return got >= 0

    def receive(self, into: memoryview, until: float) -> int:
        """Receive the rest of the answer to the outstanding question.

        Args:
            into: memory for the longest answer; that of one question, always the same.
            until: when to give up, by `time.perf_counter`; what is there is read in any case.

        Returns:
            Length of the answer; 0 if there is none, see `why`.
        """
        head, connection, got = self._head, self.socket, self._got
        if connection is None:
            return self.lose()
        while True:
            if got >= head.size:
                found = head.unpack_from(into)
                length, version, number = found[0], found[1], found[-1]
                if not head.size <= length <= LONGEST:
                    return self.refuse("an answer that is none")
                if version != self._version:
                    return self.refuse(f"an answer of version {version}, allowed {self._version}")
                if length > len(into):
                    return self.refuse("an answer that is too long")
                if got > length or (
                    got == length and number != self.outstanding and (number or not self._unasked)
                ):
                    return self.refuse("an answer to another question")
                if got == length:
                    self.outstanding = self._got = 0
                    return length
            left = until - time.perf_counter()
            try:
                if not _arrives(connection.fileno(), left if left > 0.0 else 0.0):
                    self.late += 1
                    self.why = f"{self._who}: no answer in time"
                    return 0
                count = connection.recv_into(into[got:] if got else into)
            except BlockingIOError:
                continue
            except (OSError, ValueError):  # also one that a signal handler closed
                count = 0
            if not count:
                return self.lose()
            self._got = got = got + count

    def refuse(self, what: str) -> int:
        """Close after an answer that is none; return 0."""
        self.refused += 1
        return self.lose(what)

    def lose(self, what: str = "the connection was lost") -> int:
        """Close a connection that does not work any more; return 0."""
        self.lost += 1
        self.why = f"{self._who}: {what}"
        self.close()
        return 0


def _arrives(number: int, seconds: float) -> bool:
    """Wait for bytes on a descriptor, or for the end of the connection."""
    if number < _SELECTED:  # this waits to the microsecond, and the other to the millisecond
        return bool(select.select((number,), (), (), seconds)[0])
    poll = select.poll()
    poll.register(number, select.POLLIN)
    return bool(poll.poll(1e3 * seconds))


__all__ = ["Stream"]
