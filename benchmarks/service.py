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
- ``unix_RATE.late_share``: share of the calls of more than half a period, in which a client
  with the default timeout follows the stop.
- ``lost``, ``repeated``: connections that were lost, and answers to no question, at 1 kHz for
  ``soak_s`` seconds. One question is outstanding at a time, so an answer can only be lost with its
  connection. ``late``: answers after the default timeout. ``memory_mb``: by how much the worker
  grew meanwhile. Wanted 0, 0, and <= 5 MB.
- ``cold_start_s``: processor time of supervisor and worker from the command to the first certified
  twist, interpreted; ``cold_start_wall_s``: the time on the clock. Wanted <= 1.5.
"""

from __future__ import annotations

import contextlib
import gc
import json
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
from types import SimpleNamespace
from typing import Any, Final

import numpy as np

from benchmarks.report import Report, run
from ergoqp.joints import INDEX
from ergoqp.native.compiled import program
from ergoqp.problem.load import load_problem
from ergoqp.service.c_header import header
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


def client_of(folder: Path, loop: str = PROBLEM, timeout: float | None = 1.0) -> Client:
    """Return a client as soon as the service answers."""
    until = time.monotonic() + 120
    while True:
        with contextlib.suppress(ServiceError):
            return Client(folder / f"{loop}.sock", timeout=timeout)
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


class JsonLoop:
    """A loop by lines of JSON."""

    def __init__(self, folder: Path, loop: str) -> None:
        """Connect."""
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._socket.connect(str(folder / "json.sock"))
        self._lines, self._loop, self._begins = self._socket.makefile("rb"), loop, True

    def reset(self) -> None:
        """Report that the robot stands."""
        self._begins = True

    def step(self, posture: np.ndarray) -> SimpleNamespace:
        """Ask for a step."""
        asked = {"loop": self._loop, "posture": posture.tolist(), "standing": self._begins}
        self._socket.sendall(json.dumps({"step": asked}).encode() + b"\n")
        told = json.loads(self._lines.readline())
        self._begins = False
        return SimpleNamespace(
            fresh="twist" in told,
            twist=np.array(told.get("twist", np.zeros(6))),
            posture_rate=np.array(told.get("posture_rate", np.zeros(32))),
        )


class InC:
    """A program in C that makes the calls.

    Attributes:
        moving: calls in which the object moved; calls: all.
    """

    def __init__(self, *arguments: str) -> None:
        """Start it."""
        self.moving = self.calls = 0
        self._process = subprocess.Popen(
            [str(c_program()), *arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self._tell(" ".join(map(repr, awkward().tolist())))

    def _tell(self, line: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()

    def block(self, rate: float, count: int) -> list[float]:
        """Return the times of a block of calls [us]."""
        assert self._process.stdout is not None
        self._tell(f"{rate} {count}")
        moving, *times = self._process.stdout.readline().split()
        self.moving, self.calls = self.moving + int(moving), self.calls + len(times)
        return list(map(float, times))

    def end(self) -> None:
        """End it."""
        self._process.communicate()


def c_program() -> Path:
    """Return the compiled program of `InC`."""
    here = Path(__file__).parent
    sources = {
        "service_client.c": (here / "service_client.c").read_text(),
        "ergoqp_client.h": header(),
    }
    return program("service_client", sources)


def doors(report: Report) -> None:
    """Measure every door at every rate."""
    rng, bounds, own, moving = np.random.default_rng(0), {}, {}, []
    problem = load_problem(PROBLEM)
    n, rows = len(problem.coordinates), len(problem.row_names)
    sizes = request_frame(n).length, answer_frame(n, rows).length
    lengths = [str(size) for size in sizes]
    for name, (rate, dt) in RATES.items():
        with contextlib.ExitStack() as stack:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="eqp")))
            loops = [f"{PROBLEM}.{number}" for number in range(3)]
            given = ("--compiled", "--dt", str(dt), "--loops", "3")
            stack.enter_context(service(folder / "s", *given))
            stack.enter_context(echo(folder / "raw", *sizes))
            client = client_of(folder / "s", loops[0])
            stepper = Stepper(problem, compiled=True, dt=dt)
            lines = JsonLoop(folder / "s", loops[2])
            in_c = InC("client", str(folder / "s" / f"{loops[1]}.sock"), str(dt))
            raw_c = InC("raw", str(folder / "raw"), str(dt), *lengths)
            calls: dict[str, Any] = {
                "raw": raw_call(folder / "raw", *sizes),
                "raw_c": raw_c,
                "direct": Loop(stepper.step, stepper.reset, dt),
                "unix": Loop(client.step, client.reset, dt),
                "c": in_c,
                "json": Loop(lines.step, lines.reset, dt),
            }
            found: dict[str, list[float]] = {door: [] for door in calls}
            blocks, block = report.pick(2, 16), report.pick(60, 250)
            for number in range(blocks + 1):
                for door in rng.permutation(list(calls)):
                    call = calls[door]
                    times = (
                        call.block(rate, block)
                        if isinstance(call, InC)
                        else timed(call, rate, block)
                    )
                    if number:  # the first block warms up
                        found[door] += times
            client.close()
            in_c.end()
            raw_c.end()
        for door, times in found.items():
            median, tail = np.percentile(times, [50, 99])
            report.figure(f"{door}_{name}.median_us", median)
            report.figure(f"{door}_{name}.p99_us", tail)
        late = np.mean(np.array(found["unix"]) > 1e6 * dt / 2)
        report.figure(f"unix_{name}.late_share", float(late))
        middle = {door: float(np.median(times)) for door, times in found.items()}
        over = max(middle["unix"] - middle["raw"], middle["c"] - middle["raw_c"])
        bounds[name] = over / (1.5 * middle["direct"])
        own[name] = (middle["unix"] - middle["raw"] - middle["direct"]) / middle["raw"]
        doors_moved = (calls["direct"], calls["unix"], calls["c"])
        moving += [each.moving / each.calls for each in doors_moved]
        report.figure(f"bound.{name}", bounds[name])
        report.figure(f"own_ratio.{name}", own[name])
    report.figure("bound", max(bounds.values()), "wanted <= 1")
    report.figure("own_ratio", max(own.values()), "wanted <= 2")
    report.figure("moving", min(moving), "wanted >= 0.5")


def fifo(report: Report) -> None:
    """Measure the tail with SCHED_FIFO, where it is allowed."""
    with tempfile.TemporaryDirectory(prefix="eqp") as folder:
        place = Path(folder) / "s"
        with service(place, "--compiled", "--fifo", "20"):
            client = client_of(place)
            loop = Loop(client.step, client.reset, client.dt)
            timed(loop, 1000.0, 200)
            times = timed(loop, 1000.0, report.pick(1000, 20_000))
            client.close()
        allowed = "SCHED_FIFO 20, memory" in (place / "log").read_text()
    report.figure("fifo", allowed, "1: SCHED_FIFO is allowed here")
    report.figure("unix_1khz.p99_us.fifo", float(np.percentile(times, 99)))


def sixteen(report: Report) -> None:
    """Measure sixteen loops of one worker, with and without the recorder and a long computation."""
    found: dict[bool, list[float]] = {False: [], True: []}
    for busy in [False, True] * report.pick(1, 4):
        with tempfile.TemporaryDirectory(prefix="eqp") as folder:
            place = Path(folder) / "s"
            more = ("--record", f"{folder}/record.mcap") if busy else ()
            with service(place, "--compiled", "--loops", "16", *more):
                names = [f"{PROBLEM}.{number}" for number in range(16)]
                client_of(place, names[0]).close()
                clients = [client_of(place, name) for name in names]
                search = long_computation() if busy else None
                try:
                    found[busy] += staggered(clients, report.pick(2.0, 10.0))
                finally:
                    if search is not None:
                        search.kill()
                        search.wait()
                    for client in clients:
                        client.close()
    medians = {busy: float(np.median(times)) for busy, times in found.items()}
    report.figure("sixteen.median_us", medians[False])
    report.figure("sixteen.median_us.busy", medians[True])
    report.figure("sixteen.p99_us", float(np.percentile(found[False], 99)))
    report.figure("sixteen.p99_us.busy", float(np.percentile(found[True], 99)))
    report.figure("sixteen.median_ratio", medians[True] / medians[False], "wanted <= 1.5")


def long_computation() -> subprocess.Popen[bytes]:
    """Start a search for places at idle priority, over and over."""
    script = (
        "import os; os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0));"
        "import ergoqp; p = ergoqp.load_problem('overhead'); q = p.response.comfort\n"
        "while True: ergoqp.optimise(p, q, starts=8)"
    )
    return subprocess.Popen([sys.executable, "-c", script])


def staggered(clients: list[Client], seconds: float) -> list[float]:
    """Return the times of the calls of all clients at 100 Hz, one after the other [us]."""
    postures, found = [awkward() for _ in clients], []
    for client in clients:
        client.reset()
    gc.collect()
    gc.disable()
    due, every = time.perf_counter(), 0.01 / len(clients)
    for number in range(int(seconds / every)):
        due += every
        if (wait := due - time.perf_counter()) > 0:
            time.sleep(wait)
        which = number % len(clients)
        start = time.perf_counter()
        step = clients[which].step(postures[which])
        if step.fresh:
            found.append(1e6 * (time.perf_counter() - start))
            postures[which] = postures[which] + 0.01 * step.posture_rate
        elif clients[which].waits:
            clients[which].reset()
    gc.enable()
    return found


def soak(report: Report) -> None:
    """Call at 1 kHz for a long time."""
    seconds = report.pick(2.0, 600.0)
    with tempfile.TemporaryDirectory(prefix="eqp") as folder:
        place = Path(folder) / "s"
        with service(place, "--compiled"):
            client = client_of(place, timeout=None)
            worker = client.description["health"]["pid"]
            loop = Loop(client.step, client.reset, client.dt)
            timed(loop, 1000.0, 1000)
            before, calls = resident_mb(worker), loop.calls
            for _ in range(int(seconds)):
                timed(loop, 1000.0, 1000)
            report.figure("soak_s", seconds)
            report.figure("soak.calls", loop.calls - calls)
            report.figure("late", client.late, "answers after more than half a period of 10 ms")
            report.figure("lost", client.lost, "wanted 0")
            report.figure("repeated", client.refused, "wanted 0")
            report.figure("memory_mb", resident_mb(worker) - before, "wanted <= 5")
            client.close()


def resident_mb(pid: int) -> float:
    """Return the memory that a process has for itself or shares [MB]."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def processor_time(pid: int) -> float:
    """Return the processor time of a process and of its threads so far [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def cold_start(report: Report) -> None:
    """Measure the way from the command to the first certified twist."""
    cpu, wall = [], []
    for _ in range(report.pick(2, 9)):
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
    fifo(report)
    sixteen(report)
    soak(report)


if __name__ == "__main__":
    run(measure, __doc__ or "")
