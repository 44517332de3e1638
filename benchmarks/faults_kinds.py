"""The kinds of faults of `benchmarks.faults`: set-up, injection, and the stated answer."""

from __future__ import annotations

import os
import signal
import struct
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from benchmarks import faults_doors as doors
from benchmarks.faults_trial import Setup, Trial
from ergoqp.native.compiled import shared_library

Injection = Callable[[Trial], float]
"""Injects a fault; returns when it was over (monotonic) [s]."""


@dataclass(frozen=True)
class Kind:
    """A kind of fault.

    Attributes:
        setup: how its trials are set up.
        inject: injects the fault while the object moves.
        expected: the stated answer.
        group: ``worker`` or ``supervisor``: whose way back is timed. Empty: nobody's.
        control: it must fail.
        after: how long the trial goes on after the fault [s].
        weight: share of the trials.
        before: what is done to the trial before anything runs.
        exempt: what is measured, and not promised: the jerk where a motion is taken over by a
            twist alone, and the acceleration too where a client without a relay lies about what
            the robot executed.
    """

    setup: Setup
    inject: Injection
    expected: str
    group: str = ""
    control: bool = False
    after: float = 1.6
    weight: float = 1.0
    before: Callable[[Trial], None] = field(default=lambda trial: None)
    exempt: tuple[str, ...] = ()


def nothing(trial: Trial) -> float:
    """Inject nothing."""
    return time.monotonic()


def kill_worker(trial: Trial) -> float:
    """Kill the worker."""
    os.kill(trial.worker_pid, signal.SIGKILL)
    return time.monotonic()


def kill_worker_twice(trial: Trial) -> float:
    """Kill the worker, and the next one as soon as it is there."""
    os.kill(trial.worker_pid, signal.SIGKILL)
    time.sleep(float(trial.rng.uniform(0.05, 0.4)))
    os.kill(trial.worker(), signal.SIGKILL)
    return time.monotonic()


def stop_worker(seconds: float) -> Injection:
    """Return the injection that stops the worker for a while."""

    def inject(trial: Trial) -> float:
        trial.pause(trial.worker_pid, seconds)
        return time.monotonic()

    return inject


def kill_supervisor(trial: Trial) -> float:
    """Kill the supervisor, and start it again at once, as a service manager does."""
    assert trial.service is not None
    trial.service.kill()
    trial.service.wait()
    trial.start_service()
    return time.monotonic()


def stop_supervisor(seconds: float, kills: bool = False) -> Injection:
    """Return the injection that stops the supervisor, and kills the worker meanwhile."""

    def inject(trial: Trial) -> float:
        assert trial.service is not None
        os.kill(trial.service.pid, signal.SIGSTOP)
        if kills:
            os.kill(trial.worker_pid, signal.SIGKILL)
        time.sleep(seconds)
        os.kill(trial.service.pid, signal.SIGCONT)
        return time.monotonic()

    return inject


def stop_loop(seconds: float) -> Injection:
    """Return the injection that stops the loop for a while."""

    def inject(trial: Trial) -> float:
        trial.pause(trial.loops[-1].pid, seconds)
        return time.monotonic()

    return inject


def kill_loop(again: float | None) -> Injection:
    """Return the injection that kills the loop, and starts it again after some seconds."""

    def inject(trial: Trial) -> float:
        loop = trial.loops[-1]
        loop.kill()
        loop.wait()
        if again is not None:
            time.sleep(again)
            trial.start_loop(trial.posture())
        return time.monotonic()

    return inject


def kill_relay(trial: Trial) -> float:
    """Kill the relay."""
    assert trial.relay is not None
    trial.relay.kill()
    return time.monotonic()


def kill_recorder(trial: Trial) -> float:
    """Kill the recorder."""
    os.kill(trial.recorder(), signal.SIGKILL)
    return time.monotonic()


def stop_recorder(trial: Trial) -> float:
    """Stop the recorder for a second."""
    trial.pause(trial.recorder(), 1.0)
    return time.monotonic()


def fill_disk(trial: Trial) -> None:
    """Let no file grow beyond 300 kB."""
    trial.limit_of_files = 300_000


def clock_jumps(trial: Trial) -> None:
    """Let the wall clock of the service be one of its own."""
    trial.preload = str(clock_library())
    (trial.folder / "jump").write_bytes(bytes(8))
    trial.environment["FAULTS_CLOCK"] = str(trial.folder / "jump")


def jump(trial: Trial) -> float:
    """Set the wall clock back by a day, and forward by a week."""
    for seconds in (-86400.0, 604800.0):
        (trial.folder / "jump").write_bytes(struct.pack("<d", seconds))
        time.sleep(0.3)
    return time.monotonic()


def clock_library() -> Path:
    """Return a library that moves the wall clock by the number in a file."""
    text = (Path(__file__).resolve().parent / "faults_clock.c").read_text(encoding="utf-8")
    return shared_library("clock", {"clock.c": text}, (), ())


JERK: Final = ("jerk",)
LIES: Final = ("acceleration", "jerk")
PLAIN: Final = Setup()
RELAYED: Final = Setup(relayed=True)
TAKES: Final = Setup(relayed=True, begins=2)
HELD: Final = Setup(hold=0.1)
RECORDED: Final = Setup(recorded=True)
TCP: Final = Setup(service=("--tcp", "0"))
_STOP: Final = "the stop; from where it is, the object goes on"
_MISCHIEF: Final = {
    "nan": (1, 0.3, "brakes by name; goes on"),
    "own_garbage": (2, 0.0, "the connection ends; the stop; connects again"),
    "own_half": (3, 0.0, "the answer is refused; the stop; connects again"),
    "own_too_long": (4, 0.0, "refused; the stop; connects again"),
    "own_version": (5, 0.0, "refused; the stop; connects again"),
    "replayed": (6, 0.0, "the copy is refused; the stop; connects again"),
    "deaf": (7, 0.0, "the connection ends; the stop; connects again"),
    "skipped": (8, 0.0, "goes on"),
    "sequence_again": (9, 0.0, "refused; the stop; goes on"),
    "acted_off": (10, 0.0, "continues from the lie; a relay refuses it"),
    "followed_off": (11, 0.0, "continues from the lie; a relay refuses it"),
    "session_off": (12, 0.0, "no motion until the report"),
}

KINDS: Final[dict[str, Kind]] = {
    "none": Kind(PLAIN, nothing, "goes on"),
    "none_relay": Kind(RELAYED, nothing, "goes on"),
    "worker_kill": Kind(PLAIN, kill_worker, "the stop; a new worker; goes on", "worker", weight=3),
    "worker_kill_fifo": Kind(Setup(service=("--fifo", "20")), kill_worker, "the same", "worker"),
    "worker_kill_relay": Kind(RELAYED, kill_worker, "the same", "worker", weight=2),
    "worker_kill_takes": Kind(
        Setup(begins=1), kill_worker, "goes on from what was sent", exempt=JERK
    ),
    "worker_kill_twice": Kind(PLAIN, kill_worker_twice, "the stop; goes on", "worker"),
    **{
        f"worker_stop_{seconds:g}": Kind(PLAIN, stop_worker(seconds), _STOP, "worker")
        for seconds in (0.05, 0.2, 0.6, 2.0, 5.0)
    },
    **{
        f"worker_stop_{seconds:g}_relay": Kind(RELAYED, stop_worker(seconds), _STOP, "worker")
        for seconds in (0.05, 0.2, 0.6)
    },
    "supervisor_kill": Kind(
        PLAIN, kill_supervisor, "the stop; started again; goes on", "supervisor", after=3.5
    ),
    "supervisor_kill_relay": Kind(
        RELAYED, kill_supervisor, "the stop; started again; goes on", "supervisor", after=3.5
    ),
    **{
        f"supervisor_stop_{seconds:g}": Kind(PLAIN, stop_supervisor(seconds), "nothing changes")
        for seconds in (0.2, 2.0)
    },
    "supervisor_stop_kill": Kind(
        PLAIN, stop_supervisor(0.5, kills=True), "the stop; a new worker afterwards", "worker"
    ),
    "client_kill_relay": Kind(RELAYED, kill_loop(None), "the stop, by the relay", after=1.0),
    **{
        f"client_kill_{again:g}_relay": Kind(
            RELAYED, kill_loop(again), "the stop, by the relay; goes on once it stands"
        )
        for again in (0.0, 0.1)
    },
    "client_kill_takes": Kind(
        TAKES, kill_loop(0.05), "the relay's motion is taken over", weight=2, exempt=JERK
    ),
    **{
        f"client_stop_{seconds:g}_relay": Kind(RELAYED, stop_loop(seconds), _STOP)
        for seconds in (0.05, 0.2, 0.6, 2.0, 5.0)
    },
    "relay_kill_hold": Kind(
        Setup(relayed=True, hold=0.1), kill_relay, "the robot ramps down", after=1.0
    ),
    "client_kill_hold": Kind(HELD, kill_loop(None), "the robot ramps down", after=1.0),
    "client_kill_again_hold": Kind(HELD, kill_loop(0.05), "it ramps down; goes on once it stands"),
    **{
        f"client_stop_{seconds:g}_hold": Kind(HELD, stop_loop(seconds), "within what is declared")
        for seconds in (0.05, 0.09, 0.12, 0.2, 0.6, 2.0)
    },
    "recorder_kill": Kind(RECORDED, kill_recorder, "nothing changes; another file"),
    "recorder_stop": Kind(RECORDED, stop_recorder, "nothing changes; what is missing is counted"),
    "disk_full": Kind(RECORDED, nothing, "nothing changes", before=fill_disk),
    "worker_kill_recorded": Kind(RECORDED, kill_worker, "as without a record", "worker"),
    "worker_stop_recorded": Kind(RECORDED, stop_worker(0.2), _STOP, "worker"),
    "two_clients": Kind(PLAIN, doors.second_client, "the second is refused by name"),
    "two_loops": Kind(RELAYED, doors.second_loop, "the second is refused by name"),
    "garbage": Kind(PLAIN, doors.garbage, "those connections end; the loop goes on"),
    "deaf_other": Kind(PLAIN, doors.deaf_client, "that connection ends; the loop goes on"),
    **{
        name: Kind(
            Setup(mischief=number, lasts=lasts, recorded=True),
            nothing,
            expected,
            exempt=LIES if name in ("acted_off", "followed_off") else (),
        )
        for name, (number, lasts, expected) in _MISCHIEF.items()
    },
    **{
        f"{name}_relay": Kind(
            Setup(relayed=True, mischief=_MISCHIEF[name][0]), nothing, "the relay refuses the lie"
        )
        for name in ("acted_off", "followed_off", "session_off")
    },
    "busy": Kind(PLAIN, doors.optimise_beside, "nothing changes", after=1.0),
    "clock": Kind(RECORDED, jump, "nothing changes: all times are durations", before=clock_jumps),
    "load_in_motion": Kind(PLAIN, doors.load_in_motion, "refused"),
    "load_at_rest": Kind(PLAIN, nothing, "replaced", before=doors.load_at_rest),
    "json_steps": Kind(PLAIN, doors.json_steps, "refused by name"),
    "web_page": Kind(TCP, doors.web_page, "nothing is done; the connection ends"),
    "control_naive": Kind(
        Setup(naive=True), kill_worker, "CONTROL: holds the last twist", control=True, weight=2
    ),
    "control_naive_stop": Kind(
        Setup(naive=True), stop_worker(0.6), "CONTROL: holds the last twist", control=True
    ),
    "control_client_kill": Kind(
        PLAIN, kill_loop(None), "CONTROL: nobody stops the robot", control=True, after=1.0
    ),
}
"""All kinds by name."""
