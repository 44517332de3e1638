"""The link of a client to `ergoqp relay`: what it executes, and what it is to execute next."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ergoqp.service.client_step import Answer
from ergoqp.service.relay import (
    EXECUTE_HEAD,
    RELAY_HEAD,
    RELAY_VERSION,
    TOLD_HEAD,
    Base,
    RelayAsk,
    RelayTell,
    Why,
    execute_frame,
    told_frame,
)
from ergoqp.service.stream import Stream

_COPIED = ("twist", "times", "stop", "speed", "acceleration")
"""What the frame to the relay takes from an answer of the service as it is."""


class RelayLink:
    """A relay, asked and told.

    Attributes:
        stream: the connection to it.
        known: whether it has answered the last `ask`.
        stands: whether its output was zero then, until it gets another twist.
        twist: its output then (6,) [m/s, rad/s].
        session, sequence: of the answer that it executes.
        begun: periods of that answer's stop that have begun.
    """

    def __init__(self, path: str | Path) -> None:
        """Prepare the frames; nothing is sent yet."""
        self.stream = Stream("relay", path, RELAY_HEAD, RELAY_VERSION, unasked=True)
        self.known = self.stands = False
        self.session = self.sequence = self.begun = 0
        told, self._execute = told_frame(), execute_frame()
        self._told = memoryview(bytearray(told.length))
        self._text = told.at["text"]
        self._output = told.numbers(self._told, "twist")
        self.twist = np.zeros(6)
        self._frame = memoryview(bytearray(self._execute.length))
        self._start = self._execute.numbers(self._frame, "from")
        self._number = 0

    def ask(self, until: float) -> bool:
        """Ask what it executes; return whether it said so."""
        stream = self.stream
        self.known = False
        if not stream.connect() or (stream.outstanding and not self._receive(until=0.0)):
            return False
        head = RELAY_HEAD.pack(
            RELAY_HEAD.size, RELAY_VERSION, int(RelayAsk.status), self._number + 1
        )
        if self._exchange(head, until) != RelayTell.status:
            return False
        _, _, _, _, self.session, self.sequence, self.begun, _, stands, _ = TOLD_HEAD.unpack_from(
            self._told
        )
        self.known, self.stands = True, bool(stands)
        self.twist[:] = self._output
        return True

    def execute(
        self,
        answer: Answer,
        executed: tuple[int, int],
        base: int,
        continued: tuple[int, int],
        start: np.ndarray,
        dt: float,
        until: float,
    ) -> int:
        """Have it execute an answer.

        Args:
            answer: the twist, its stop and the limits.
            executed: session and sequence of that answer.
            base: what it continues from, of `Base`.
            continued: the answer that it continues from, and how many periods of its stop.
            start: the motion (6,) that it takes over, if that is its base.
            dt: period of the answer [s].
            until: when to give up, by `time.perf_counter`.

        Returns:
            Kind of the relay's answer; 0 if it gave none in time.
        """
        frame, target, source = self._frame, self._execute.at, answer.layout.at
        EXECUTE_HEAD.pack_into(
            frame,
            0,
            len(frame),
            RELAY_VERSION,
            int(RelayAsk.execute),
            self._number + 1,
            *executed,
            *continued,
            base,
            answer.knots,
            0,
            dt,
        )
        for name in _COPIED:
            frame[target[name]] = answer.view[source[name]]
        self._start[:] = start if base == Base.motion else 0.0
        return self._exchange(frame, until)

    def _exchange(self, frame: bytes | memoryview, until: float) -> int:
        """Send a frame; return the kind of the answer, or 0."""
        self._number += 1
        stream = self.stream
        # A relay that has a client already says so and closes: nothing can be sent then, but that
        # can be read.
        sent = stream.send(frame, self._number)
        if not self._receive(until if sent else 0.0):
            stream.close() if not sent else None
            return 0
        _, _, kind, _, _, _, _, why, _, _ = TOLD_HEAD.unpack_from(self._told)
        if kind == RelayTell.refused:
            stream.refused += 1
            text = bytes(self._told[self._text]).split(b"\0", 1)[0].decode(errors="replace")
            stream.why = f"relay: {text}"
            if why == Why.taken:
                stream.close()
        return kind

    def _receive(self, until: float) -> bool:
        """Receive an answer; return whether it is one."""
        length = self.stream.receive(self._told, until)
        if not length:
            return False
        _, _, _, number, _, _, _, why, _, _ = TOLD_HEAD.unpack_from(self._told)
        if length != len(self._told) or (not number and why != Why.taken):
            return bool(self.stream.refuse("an answer that is none"))
        return True


__all__ = ["RelayLink"]
