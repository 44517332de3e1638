"""A service in a process of its own, for tests."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ergoqp.service.client import Client, ServiceError


class Running:
    """A running service.

    Attributes:
        folder: folder of its sockets.
        process: the supervisor.
    """

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.folder = folder
        self.log = folder / "log"
        command = [sys.executable, "-m", "ergoqp", "serve", "--dir", str(folder), *arguments]
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(command, stdout=log, stderr=log, env=dict(os.environ))

    def socket(self, loop: str = "screwing") -> Path:
        return self.folder / f"{loop}.sock"

    def client(self, loop: str = "screwing", timeout: float | None = 1.0, **options) -> Client:
        """Return a client, once the service is there."""
        until = time.monotonic() + 60
        while True:
            try:
                return Client(self.socket(loop), timeout=timeout, **options)
            except ServiceError:
                assert self.process.poll() is None, self.log.read_text()
                assert time.monotonic() < until, self.log.read_text()
                time.sleep(0.05)

    def worker(self, loop: str = "screwing") -> int:
        """Return the process that computes the steps of a loop."""
        with self.client(loop) as client:
            return client.description["health"]["pid"]

    def end(self) -> None:
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGCONT)
            self.process.terminate()
        self.process.wait(20)


@contextmanager
def running(folder: Path, *arguments: str) -> Iterator[Running]:
    """Run a service with these arguments; its sockets are in a folder that is made private."""
    folder.mkdir(mode=0o700, exist_ok=True)
    folder.chmod(0o700)
    found = Running(folder, *arguments)
    try:
        yield found
    finally:
        found.end()
