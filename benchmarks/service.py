"""The service: what it adds to the step, how regular it is, how it starts.

Run ``python -m benchmarks.service [--quick | --full] [--json FILE]``.

Every DOOR is called at each RATE after equal idling, in blocks of random order in one run; the step
is compiled, the answer holds the certified stop, and the object moves.

- ``DOOR_RATE.median_us``, ``.p99_us``: of a call. Doors: ``raw`` (a socket of the same kind and
  frames of the same length, echoed by a process that computes nothing), ``direct``
  (`Stepper.step`), ``unix`` (`ergoqp.Client`), ``c`` (the client in C), ``json`` (JSON lines).
  ``raw_c`` is `raw` from C. Rates: ``100hz``, ``1khz``, and ``1khz_1ms`` for a loop whose period is
  1 ms.
- ``bound``: largest (door - raw) / (1.5 direct) of unix and c over the rates, of medians; each door
  over the raw of its own language. Wanted <= 1.
- ``own_ratio``: largest (unix - raw - direct) / raw. Wanted <= 2.
- ``moving``: smallest share of the calls in which the object moved. Wanted >= 0.5.
- ``fifo``: 1 if SCHED_FIFO is allowed here; ``unix_1khz.p99_us.fifo`` is the p99 with it.
- ``sixteen.median_ratio``: median of a call to one of sixteen loops at 100 Hz, while the recorder
  and a search for a place (at idle priority) run, over that without them. Wanted <= 1.5.
- ``lost``, ``repeated``: answers that never came, or came twice, at 1 kHz for ``soak_s`` seconds;
  ``memory_mb``: by how much the worker grew meanwhile. Wanted 0, 0, <= 5.
- ``cold_start_s``: processor time of supervisor and worker from the command to the first certified
  twist, interpreted; ``cold_start_wall_s``: the time on the clock. Wanted <= 1.5.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.report import Report, run
from ergoqp.joints import INDEX
from ergoqp.problem.load import load_problem
from ergoqp.service.client import Client, ServiceError
from ergoqp.service.schema import answer_frame, request_frame
from ergoqp.step.stepper import Stepper

PROBLEM: Final = "screwing"
RATES: Final = {"100hz": (100.0, 0.01), "1khz": (1000.0, 0.01), "1khz_1ms": (1000.0, 0.001)}
RAISED: Final = {"right_shoulder_flexion": 1.3, "right_elbow_flexion": 0.5}


def awkward() -> np.ndarray:
    """Return a posture from which the object has a long way to go."""
    posture = np.array(load_problem(PROBLEM).response.comfort)  # type: ignore[attr-defined]
    for joint, angle in RAISED.items():
        posture[INDEX[joint]] = angle
    return posture


@contextlib.contextmanager
def service(folder: Path, *arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    """Run a service; its sockets are in a folder."""
    folder.mkdir(mode=0o700)
    command = [sys.executable, "-m", "ergoqp", "serve", PROBLEM, "--dir", str(folder), *arguments]
    log = (folder / "log").open("wb")
    process = subprocess.Popen(command, stderr=log)
    try:
        yield process
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait(20)
        log.close()


def client_of(folder: Path, loop: str = PROBLEM, timeout: float = 1.0) -> Client:
    """Return a client as soon as the service answers."""
    until = time.monotonic() + 120
    while True:
        with contextlib.suppress(ServiceError):
            return Client(folder / f"{loop}.sock", timeout=timeout, explain=False)
        if time.monotonic() > until:
            raise ServiceError((folder / "log").read_text())
        time.sleep(0.01)


@contextlib.contextmanager
def echo(path: Path, asked: int, told: int) -> Iterator[None]:
    """Run a process that answers every request with bytes, and computes nothing."""
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    listener.bind(str(path))
    listener.listen(4)
    pid = os.fork()
    if not pid:
        _echo(listener, asked, bytes(told))
    listener.close()
    try:
        yield
    finally:
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)


def _echo(listener: socket.socket, asked: int, answer: bytes) -> None:
    poll, clients = select.epoll(), dict[int, socket.socket]()
    poll.register(listener, select.EPOLLIN)
    buffer = memoryview(bytearray(asked))
    while True:
        for number, _ in poll.poll():
            if number == listener.fileno():
                client, _ = listener.accept()
                clients[client.fileno()] = client
                poll.register(client, select.EPOLLIN)
            elif clients[number].recv_into(buffer):
                clients[number].send(answer)
            else:
                poll.unregister(number)
                clients.pop(number).close()


def raw_call(path: Path, asked: int, told: int) -> Callable[[], None]:
    """Return a call that sends a request and reads the answer."""
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    connection.connect(str(path))
    request, answer = bytes(asked), memoryview(bytearray(told))
    poll = select.poll()
    poll.register(connection, select.POLLIN)

    def call() -> None:
        connection.send(request)
        got = 0
        while got < told:
            poll.poll(1000)
            got += connection.recv_into(answer[got:])

    return call


class Loop:
    """Calls of one door that move an object from the same start in every block.

    Attributes:
        moving: calls in which the object moved; calls: all.
    """

    def __init__(self, step: Callable[..., object], reset: Callable[[], None], dt: float) -> None:
        """Take the calls of a stepper or a client."""
        self._step, self._reset, self._dt = step, reset, dt
        self._start = awkward()
        self.moving = self.calls = 0

    def begin(self) -> None:
        """Start anew."""
        self._reset()
        self._posture = self._start.copy()

    def __call__(self) -> None:
        """Take a step."""
        self._answer = self._step(self._posture)

    def between(self) -> bool:
        """Have the model person follow; return whether the service answered in time."""
        step = self._answer
        if not getattr(step, "fresh", True):  # the machine was busy: it is no call of the door
            self._reset()
            return False
        self.calls += 1
        self.moving += bool(step.twist.any())  # type: ignore[attr-defined]
        self._posture = self._posture + self._dt * step.posture_rate  # type: ignore[attr-defined]
        return True


def timed(call: Callable[[], None], rate: float, count: int) -> list[float]:
    """Return the time of each call [us], each after the idling of its rate."""
    between = getattr(call, "between", lambda: True)
    getattr(call, "begin", lambda: None)()
    found, due = [], time.perf_counter()
    for _ in range(count):
        due += 1 / rate
        wait = due - time.perf_counter()
        if wait > 0:
            time.sleep(wait)
        else:
            due -= wait
        start = time.perf_counter()
        call()
        took = 1e6 * (time.perf_counter() - start)
        if between():
            found.append(took)
    return found


def doors(report: Report) -> None:
    """Measure every door at every rate."""
    rng, bounds, own, moving = np.random.default_rng(0), {}, {}, []
    problem = load_problem(PROBLEM)
    n, rows = len(problem.coordinates), len(problem.row_names)
    sizes = request_frame(n).length, answer_frame(n, rows).length
    for name, (rate, dt) in RATES.items():
        with contextlib.ExitStack() as stack:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="eqp")))
            stack.enter_context(service(folder / "s", "--compiled", "--dt", str(dt)))
            stack.enter_context(echo(folder / "raw", *sizes))
            client, stepper = client_of(folder / "s"), Stepper(problem, compiled=True, dt=dt)
            calls: dict[str, Callable[[], None]] = {
                "raw": raw_call(folder / "raw", *sizes),
                "direct": Loop(stepper.step, stepper.reset, dt),
                "unix": Loop(client.step, client.reset, dt),
            }
            found: dict[str, list[float]] = {door: [] for door in calls}
            blocks, block = report.pick(4, 16), report.pick(100, 250)
            for number in range(blocks + 1):
                for door in rng.permutation(list(calls)):
                    times = timed(calls[door], rate, block)
                    if number:  # the first block warms up
                        found[door] += times
            client.close()
        for door, times in found.items():
            median, tail = np.percentile(times, [50, 99])
            report.figure(f"{door}_{name}.median_us", median)
            report.figure(f"{door}_{name}.p99_us", tail)
        medians = {door: float(np.median(times)) for door, times in found.items()}
        bounds[name] = (medians["unix"] - medians["raw"]) / (1.5 * medians["direct"])
        own[name] = (medians["unix"] - medians["raw"] - medians["direct"]) / medians["raw"]
        moving += [each.moving / each.calls for each in calls.values() if isinstance(each, Loop)]
        report.figure(f"bound.{name}", bounds[name])
        report.figure(f"own_ratio.{name}", own[name])
    report.figure("bound", max(bounds.values()), "wanted <= 1")
    report.figure("own_ratio", max(own.values()), "wanted <= 2")
    report.figure("moving", min(moving), "wanted >= 0.5")


def processor_time(pid: int) -> float:
    """Return the processor time of a process and of its threads so far [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def cold_start(report: Report) -> None:
    """Measure the way from the command to the first certified twist."""
    cpu, wall = [], []
    for _ in range(report.pick(3, 9)):
        with tempfile.TemporaryDirectory(prefix="eqp") as folder:
            begun = time.perf_counter()
            with service(Path(folder) / "s", "--interpreted") as process:
                client = client_of(Path(folder) / "s")
                client.reset()
                step = client.step(awkward())
                wall.append(time.perf_counter() - begun)
                worker = client.description["health"]["pid"]
                cpu.append(processor_time(process.pid) + processor_time(worker))
                assert step.fresh
                assert step.twist.any()
                client.close()
    report.figure("cold_start_s", float(np.median(cpu)), "wanted <= 1.5")
    report.figure("cold_start_wall_s", float(np.median(wall)))


def measure(report: Report) -> None:
    """Measure all figures."""
    cold_start(report)
    doors(report)


if __name__ == "__main__":
    run(measure, __doc__ or "")
