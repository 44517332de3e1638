"""A relay in a process of its own, what its driver gets, and a relay that a test answers for."""

from __future__ import annotations

import os
import socket
import subprocess
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
from puppet import Fake

from ergoqp.native.compiled import program
from ergoqp.service.c_header import header, relay_source
from ergoqp.service.relay import (
    DATAGRAM,
    EXECUTE_HEAD,
    RELAY_HEAD,
    RELAY_VERSION,
    TOLD_HEAD,
    RelayAsk,
    RelayTell,
    told_frame,
)

DT, A = 0.1, 1.0
"""Period [s] and acceleration limit [m/s^2] of the frames of the tests."""
V = 0.5
"""Speed limit of the frames of the tests [m/s]."""
TOLD = told_frame()


class Driver:
    """What the robot's driver gets."""

    def __init__(self, where: Path | None) -> None:
        family = socket.AF_INET if where is None else socket.AF_UNIX
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0) if where is None else os.fspath(where))
        self._socket.settimeout(0.05)
        port = self._socket.getsockname()[1] if where is None else 0
        self.address = f"udp:127.0.0.1:{port}" if where is None else f"unix:{where}"
        self._got, self._ended = list[tuple[float, ...]](), threading.Event()
        self._thread = threading.Thread(target=self._listen)
        self._thread.start()

    def _listen(self) -> None:
        while not self._ended.is_set():
            try:
                self._got.append(DATAGRAM.unpack(self._socket.recv(128)))
            except TimeoutError:
                continue

    @property
    def rows(self) -> np.ndarray:
        """Number, time and twist of each datagram."""
        return np.array(self._got).reshape(-1, 8)

    @property
    def twist(self) -> np.ndarray:
        """The newest twist."""
        return self.rows[-1, 2:]

    def wait(self, what: Any, seconds: float = 10.0) -> None:
        until = time.monotonic() + seconds
        while not (len(self._got) and what(self.twist)):
            assert time.monotonic() < until
            time.sleep(0.002)

    def wait_for_rest(self) -> None:
        self.wait(lambda twist: not twist.any())

    def check(self, acceleration: Any = A, speed: Any = V) -> None:
        """Check that no limit was exceeded from one datagram to the next."""
        rows = self.rows
        assert (np.abs(rows[:, 2:]) <= speed).all()
        change, seconds = np.diff(rows[:, 2:], axis=0), np.diff(rows[:, 1])[:, None]
        assert (np.abs(change) <= np.asarray(acceleration) * seconds * (1 + 1e-6) + 1e-12).all()

    def end(self) -> None:
        self._ended.set()
        self._thread.join()
        self._socket.close()


class Relay:
    """A running relay and its driver."""

    def __init__(self, folder: Path, *more: str, to: Driver | None = None) -> None:
        folder.mkdir(exist_ok=True)
        self.path, self.driver = folder / "in", to or Driver(folder / "out")
        self.log = folder / "log"
        before = self.log.read_text().count("listens at") if self.log.exists() else 0
        with self.log.open("ab") as log:
            words = ["--in", self.path, "--to", self.driver.address, "--rate", "500", *more]
            self.process = subprocess.Popen([relay_program(), *words], stderr=log)
        self.wait_for("listens at", before + 1)

    def wait_for(self, words: str, times: int = 1) -> None:
        """Wait until the log has said something so many times."""
        until = time.monotonic() + 10
        while self.log.read_text().count(words) < times:
            assert time.monotonic() < until, self.log.read_text()
            time.sleep(0.005)

    def end(self) -> None:
        self.process.kill()
        self.process.wait()
        self.driver.end()


def relay_program() -> Path:
    return program("relay", {"relay.c": relay_source(), "ergoqp_client.h": header()})


class FakeRelay(Fake):
    """A relay whose answers a test writes."""

    def __init__(self, path: Path) -> None:
        self.session, self.sequence, self.begun, self.takes = 0, 0, 0, True
        self.delay = 0.0
        super().__init__(path, self.told)

    def told(self, asked: bytes) -> bytes:
        kind, number = RELAY_HEAD.unpack_from(asked)[2:]
        if kind == RelayAsk.execute:
            kind = RelayTell.accepted
            if self.takes:
                self.session, self.sequence = EXECUTE_HEAD.unpack_from(asked)[4:6]
            time.sleep(self.delay)
        head = (TOLD.length, RELAY_VERSION, kind, number, self.session, self.sequence, self.begun)
        return TOLD_HEAD.pack(*head, 0, 0, 0) + bytes(TOLD.length - TOLD_HEAD.size)
