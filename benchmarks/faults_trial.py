"""One trial of `benchmarks.faults`: a service, a robot and its loop, each a process of its own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.faults_judge import STANDING, read_loop
from benchmarks.faults_world import TICK, WAIT, World
from ergoqp.native.compiled import program
from ergoqp.service.c_header import header, relay_source
from ergoqp.service.client import Client, ServiceError
from ergoqp.service.worker import die_with_parent

ROOT: Final = Path(__file__).resolve().parent.parent
LOOP_NAME: Final = "world"
_LONGEST: Final = 60.0
_MOVES: Final = 0.03


@dataclass(frozen=True)
class Setup:
    """How a trial is set up.

    Attributes:
        relayed: a relay is between the loop and the robot.
        hold: declared timeout of the robot [s]; negative: it has none.
        naive: the loop holds its last twist where no answer comes.
        begins: how the loop goes on when the service does not know what the robot does: 0 once it
            stands, 1 it takes over what was sent last, 2 by what the relay sends.
        recorded: the service records.
        service: more arguments of the service.
        mischief: what the loop itself does wrong; see `service_loop.c`.
        lasts: how long it does that [s].
        own_limits: the loop gives the limits of the relay, and does not take those of the answers.
    """

    relayed: bool = False
    hold: float = -1.0
    naive: bool = False
    begins: int = 0
    recorded: bool = False
    service: tuple[str, ...] = ()
    mischief: int = 0
    lasts: float = 0.0
    own_limits: bool = False


@cache
def built(name: str) -> Path:
    """Return one of the programs in C: ``robot``, ``loop`` or ``relay``.

    Raises:
        CompilerError: if there is no C compiler.
    """
    here = Path(__file__).resolve().parent
    shared = {"service_robot.h": (here / "service_robot.h").read_text(encoding="utf-8")}
    if name == "relay":
        return program("relay", {"relay.c": relay_source(), "ergoqp_client.h": header()})
    text = (here / f"service_{name}.c").read_text(encoding="utf-8")
    return program(name, {f"{name}.c": text, "ergoqp_client.h": header(), **shared})


class NotMovingError(Exception):
    """The object did not begin to move: the trial says nothing."""


class Trial:
    """The processes of one trial; all end with it.

    Attributes:
        folder: all its files; loops: the loop processes so far.
        began: when the first loop was started, and when the object moved (monotonic) [s].
    """

    def __init__(self, world: World, setup: Setup, folder: Path, rng: np.random.Generator) -> None:
        """Write the files; nothing runs yet."""
        self.world, self.setup, self.folder, self.rng = world, setup, folder, rng
        self.services = folder / "s"
        self.services.mkdir(mode=0o700)
        self.problem = folder / f"{LOOP_NAME}.toml"
        self.problem.write_text(world.text, encoding="utf-8")
        self.socket = self.services / f"{LOOP_NAME}.sock"
        self.service: subprocess.Popen[Any] | None = None
        self.robot: subprocess.Popen[Any] | None = None
        self.relay: subprocess.Popen[Any] | None = None
        self.loops: list[subprocess.Popen[Any]] = []
        self.others: list[subprocess.Popen[Any]] = []
        self.limit_of_files: int | None = None
        self.environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        self.records: list[Path] = []
        self.moved, self.worker_pid = 0.0, 0
        self.notes: list[str] = []
        self.preload = ""

    # -- processes

    def start_service(self) -> None:
        """Start the service, as a service manager would, also again."""
        words = [str(self.problem), "--dir", str(self.services), *self.setup.service]
        if "--compiled" not in words:
            words.append("--interpreted")
        environment = self.environment | ({"LD_PRELOAD": self.preload} if self.preload else {})
        if self.setup.recorded:
            self.records.append(self.folder / f"record{len(self.records)}.mcap")
            words += ["--record", str(self.records[-1])]

        def limited() -> None:
            die_with_parent()
            if self.limit_of_files is not None:
                import resource

                resource.setrlimit(
                    resource.RLIMIT_FSIZE, (self.limit_of_files, self.limit_of_files)
                )

        with (self.folder / "log").open("ab") as log:
            self.service = subprocess.Popen(
                [sys.executable, "-m", "ergoqp", "serve", *words],
                stdout=log,
                stderr=log,
                env=environment,
                preexec_fn=limited,
            )

    def start_robot(self) -> None:
        """Start the robot, at rest."""
        robot, at = self.world.robot, self.folder
        numbers = [_LONGEST, robot.delay, robot.lag, robot.gain, robot.hold]
        numbers += [self.world.acceleration[0], self.world.acceleration[3]]
        numbers += list(self.world.pose.ravel())
        words = [at / "robot.sock", at / "state", at / "robot", at / "twists", *numbers]
        self.robot = subprocess.Popen(
            [str(built("robot")), *map(str, words)], preexec_fn=die_with_parent
        )
        self._await((at / "robot.sock").exists, "the robot")
        self._await(lambda: (at / "state").stat().st_size > 0, "the robot")

    def start_relay(self) -> None:
        """Start the relay beside the robot."""
        command = [str(built("relay")), "--in", str(self.folder / "relay.sock"), "--rate", "1000"]
        command += ["--to", f"unix:{self.folder / 'robot.sock'}", "--fifo", "45"]
        with (self.folder / "relay.log").open("ab") as log:
            self.relay = subprocess.Popen(command, stderr=log, preexec_fn=die_with_parent)
        self._await((self.folder / "relay.sock").exists, "the relay")

    def start_loop(self, posture: np.ndarray | None = None, mischief: float = 1e9) -> None:
        """Start the loop's program.

        Args:
            posture: where the person is. None: at the start.
            mischief: when it does something wrong, from its start on [s].
        """
        world, setup, number = self.world, self.setup, len(self.loops)
        start = self.folder / f"start{number}"
        start.write_text(
            " ".join(f"{q:.17g}" for q in (world.start if posture is None else posture))
        )
        relay = self.folder / "relay.sock" if setup.relayed else "-"
        limits = [world.speed[0], world.speed[3], world.acceleration[0], world.acceleration[3]]
        words: list[Any] = [self.socket, relay, self.folder / "robot.sock", self.folder / "state"]
        # An answer may be sent so much later than the call. The robot's timeout counts from twist
        # to twist.
        longest = setup.hold - WAIT - 2 * TICK if setup.hold >= 0 else 0.0
        words += [start, self.folder / f"loop{number}", _LONGEST, 0.01, WAIT, longest]
        words += [int(setup.naive), setup.begins, STANDING, world.robot.noise]
        words += limits if setup.own_limits else [0.0] * 4
        words += [setup.mischief, mischief, mischief + setup.lasts, setup.hold]
        self.loops.append(
            subprocess.Popen([str(built("loop")), *map(str, words)], preexec_fn=die_with_parent)
        )

    def client(self, **options: Any) -> Client:
        """Return a client in Python, once the service is there."""
        until = time.monotonic() + 60
        while True:
            with suppress(ServiceError):
                return Client(self.socket, explain=False, **options)
            if time.monotonic() > until or self.service is None or self.service.poll() is not None:
                raise ServiceError((self.folder / "log").read_text(errors="replace"))
            time.sleep(0.01)

    def worker(self) -> int:
        """Return the process that computes the steps."""
        with self.client() as client:
            return int(client.description["health"]["pid"])

    def recorder(self) -> int:
        """Return the process that writes the record.

        Raises:
            ProcessLookupError: if there is none.
        """
        assert self.service is not None
        for task in Path(f"/proc/{self.service.pid}/task").iterdir():
            for child in (task / "children").read_text().split():
                with suppress(OSError):
                    links = [os.readlink(each) for each in Path(f"/proc/{child}/fd").iterdir()]
                    if any(".mcap" in link for link in links):
                        return int(child)
        raise ProcessLookupError("recorder")

    def begin(self, mischief: float = 1e9) -> None:
        """Start everything, and wait until the object moves.

        Raises:
            NotMovingError: if it does not within some seconds.
        """
        if self.service is None:
            self.start_service()
        self.worker_pid = self.worker()
        self.start_robot()
        if self.setup.relayed:
            self.start_relay()
        self.start_loop(mischief=mischief)
        self.wait_moving()

    def wait_moving(self) -> None:
        """Wait until the object moves.

        Raises:
            NotMovingError: if it does not within some seconds.
        """
        until = time.monotonic() + 3
        while time.monotonic() < until:
            rows = read_loop(self.folder / f"loop{len(self.loops) - 1}")
            if len(rows) and np.abs(rows["twist"][-1]).max() > _MOVES:
                self.moved = time.monotonic()
                return
            time.sleep(0.005)
        raise NotMovingError

    def posture(self) -> np.ndarray:
        """Return where the person is now."""
        return read_loop(self.folder / f"loop{len(self.loops) - 1}")["posture"][-1]

    def loop_rows(self) -> np.ndarray:
        """Return the periods of all loops so far."""
        rows = [read_loop(self.folder / f"loop{number}") for number in range(len(self.loops))]
        return np.concatenate(rows)

    def pause(self, pid: int, seconds: float) -> None:
        """Stop a process for a while."""
        os.kill(pid, signal.SIGSTOP)
        try:
            time.sleep(seconds)
        finally:
            os.kill(pid, signal.SIGCONT)

    def beside(self, command: Sequence[str], before: Callable[[], None] | None = None) -> None:
        """Run another program until the trial ends."""
        quiet = subprocess.DEVNULL
        self.others.append(
            subprocess.Popen(
                command, stdout=quiet, stderr=quiet, env=self.environment, preexec_fn=before
            )
        )

    def waited(self) -> dict[int, float]:
        """Return how long supervisor and worker were ready and had no processor so far [s]."""
        assert self.service is not None
        found = {}
        for pid in (self.service.pid, self.worker()):
            words = Path(f"/proc/{pid}/schedstat").read_text(encoding="ascii").split()
            found[pid] = 1e-9 * int(words[1])
        return found

    def end(self) -> None:
        """End the robot, so that its record is whole, then everything else."""
        if self.robot is not None:
            self.robot.terminate()
            self.robot.wait(10)
        for each in (*self.loops, *self.others, *([self.relay] if self.relay else [])):
            if each.poll() is None:
                each.kill()
            each.wait(10)
        if self.service is not None and self.service.poll() is None:
            self.service.send_signal(signal.SIGCONT)
            self.service.terminate()
            try:
                self.service.wait(15)
            except subprocess.TimeoutExpired:
                self.notes.append("the service did not end by SIGTERM within 15 s")
                self.service.kill()
                self.service.wait(5)

    def _await(self, condition: Callable[[], bool], what: str) -> None:
        until = time.monotonic() + 5
        while True:
            with suppress(OSError):
                if condition():
                    return
            if time.monotonic() > until:
                raise RuntimeError(f"{what} does not start")
            time.sleep(0.002)
