"""The kinds of faults of `benchmarks.faults`: how each is set up, injected, and what is expected."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

from benchmarks.faults_trial import Setup, Trial

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
    """

    setup: Setup
    inject: Injection
    expected: str
    group: str = ""
    control: bool = False
    after: float = 1.6
    weight: float = 1.0
    before: Callable[[Trial], None] = field(default=lambda trial: None)


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


RELAYED: Final = Setup(relayed=True, begins=2)
HELD: Final = Setup(hold=0.1)

KINDS: Final[dict[str, Kind]] = {
    "none": Kind(Setup(), nothing, "the object goes on"),
    "none_relay": Kind(RELAYED, nothing, "the object goes on"),
    "worker_kill": Kind(Setup(), kill_worker, "stop; a new worker; goes on", "worker", weight=3),
    "naive_kill": Kind(
        Setup(naive=True), kill_worker, "CONTROL: it holds its last twist", control=True
    ),
    "loop_kill_relay": Kind(
        RELAYED, kill_loop(None), "the relay stops the robot", weight=2, after=1.0
    ),
}
