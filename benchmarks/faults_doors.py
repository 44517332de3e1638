"""Faults that come by the doors: other clients, garbage, lines of JSON, a page that posts."""

from __future__ import annotations

import json
import os
import re
import socket
import time
from contextlib import suppress

import numpy as np

from benchmarks.faults_judge import read_loop
from benchmarks.faults_trial import LOOP_NAME, Trial
from ergoqp.service.schema import HEAD, VERSION, Ask


def _connection(trial: Trial) -> socket.socket:
    found = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    found.settimeout(1.0)
    found.connect(str(trial.socket))
    return found


def _throw(trial: Trial, data: bytes) -> None:
    """Send bytes by a connection of its own, and read what comes."""
    with _connection(trial) as connection, suppress(OSError):
        connection.sendall(data)
        connection.settimeout(0.05)
        connection.recv(65536)


def garbage(trial: Trial) -> float:
    """Send random bytes, cut-off, too long and foreign frames by other connections."""
    for _ in range(10):
        _throw(trial, trial.rng.bytes(int(trial.rng.integers(1, 2000))))
        _throw(trial, HEAD.pack(1 << 30, VERSION, Ask.step, 1, 1) + bytes(4000))
        _throw(trial, HEAD.pack(800, VERSION, Ask.step, 1, 1) + bytes(100))
        _throw(trial, HEAD.pack(HEAD.size, VERSION + 7, Ask.describe, 0, 1))
        _throw(trial, HEAD.pack(3, VERSION, 77, 0, 1))
    return time.monotonic()


def second_client(trial: Trial) -> float:
    """Have a second client report that the robot stands, and step, while the first commands."""
    with trial.client(timeout=0.05) as client:
        client.reset()
        for _ in range(20):
            step = client.step(trial.world.start, trial.world.pose)
            if step.fresh:
                trial.notes.append("a second client was given a step")
                break
            if "commanded by process" not in step.reason and client.waits:
                client.reset()
            time.sleep(0.01)
    return time.monotonic()


def second_loop(trial: Trial) -> float:
    """Start the whole loop a second time; without a relay it is refused by the service alone."""
    trial.start_loop(trial.posture())
    time.sleep(0.5)
    second = trial.loops.pop()  # only the first one is asked for what it sent
    second.kill()
    second.wait()
    rows = read_loop(trial.folder / f"loop{len(trial.loops)}")
    if (rows["fresh"] > 0).any():
        trial.notes.append("a second loop was given a step")
    return time.monotonic()


def deaf_client(trial: Trial) -> float:
    """Ask for descriptions, and never read."""
    ask = HEAD.pack(HEAD.size, VERSION, Ask.describe, 0, 1)
    with _connection(trial) as connection, suppress(OSError):
        connection.setblocking(False)
        for _ in range(5000):
            connection.send(ask)
    return time.monotonic()


def _line(trial: Trial, said: object, seconds: float = 20.0) -> dict[str, object]:
    """Return the answer of the JSON door to one line."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
        connection.settimeout(seconds)
        connection.connect(str(trial.services / "json.sock"))
        connection.sendall(json.dumps(said).encode() + b"\n")
        data = b""
        while not data.endswith(b"\n"):
            if not (more := connection.recv(65536)):
                break
            data += more
    return json.loads(data or b"{}")


def load_in_motion(trial: Trial) -> float:
    """Replace the problem while the loop runs: it has to be refused."""
    answer = _line(trial, {"load": {"name": LOOP_NAME, "problem": trial.world.text}})
    if "error" not in answer:
        trial.notes.append(f"a problem was replaced in motion: {answer}")
    return time.monotonic()


def load_at_rest(trial: Trial) -> None:
    """Serve a problem without walls, and replace it by the trial's before the loop begins."""
    text = trial.world.text
    free = re.sub(r"\[limits.workspace\].*?\n\n", "", text, flags=re.S)
    free = re.sub(r"\[\[limits.keep_out\]\].*?\n\n", "", free, flags=re.S)
    trial.problem.write_text(free, encoding="utf-8")
    trial.start_service()
    trial.client().close()
    answer = _line(trial, {"load": {"name": LOOP_NAME, "problem": text}})
    if "error" in answer:
        trial.notes.append(f"a problem could not be replaced at rest: {answer}")


def web_page(trial: Trial) -> float:
    """Post a step to the TCP door, as a page of any origin can."""
    log = (trial.folder / "log").read_text(errors="replace")
    found = re.search(r"at port (\d+)", log)
    assert found is not None, log
    step = {"step": {"loop": LOOP_NAME, "standing": True, "posture": [0.0] * 32}}
    body = "\n" + json.dumps(step) + "\n"
    words = "POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nOrigin: http://evil.example\r\n"
    words += f"Content-Type: text/plain\r\nContent-Length: {len(body)}\r\n\r\n{body}"
    for _ in range(3):
        with socket.create_connection(("127.0.0.1", int(found[1])), 2.0) as connection:
            connection.sendall(words.encode())
            told = b""
            with suppress(OSError):
                while more := connection.recv(65536):
                    told += more
            if b"twist" in told:
                trial.notes.append("a page's post was answered by a twist")
    return time.monotonic()


def optimise_beside(trial: Trial) -> float:
    """Search for a place at idle priority."""
    import sys

    def idle() -> None:
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))

    command = [sys.executable, "-m", "ergoqp", "optimise", "screwing"]
    trial.beside(command, idle)
    trial.beside(command, idle)
    time.sleep(1.0)
    return time.monotonic()


def json_steps(trial: Trial) -> float:
    """Send steps by the JSON door while the loop commands."""
    posture = np.round(trial.world.start, 6).tolist()
    for _ in range(10):
        said = {"step": {"loop": LOOP_NAME, "standing": True, "posture": posture}}
        answer = _line(trial, said)
        if "twist" in answer:
            trial.notes.append("a second commander by JSON was given a twist")
    return time.monotonic()
