"""The client in Python with a relay: the relay moves the robot, whatever becomes of the client."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from puppet import Fake, step_answer
from relay_running import DT, TOLD, A, Driver, FakeRelay, Relay, V
from service_running import Running, running

import ergoqp
from ergoqp.service.client import Client
from ergoqp.service.relay import (
    EXECUTE_HEAD,
    RELAY_HEAD,
    RELAY_VERSION,
    TOLD_HEAD,
    Base,
    RelayTell,
    Why,
    execute_frame,
)
from ergoqp.service.schema import HEAD, REQUEST_HEAD, Flag, Tell, answer_frame, note

PROBLEM = ergoqp.load_problem("screwing")
ROWS = len(PROBLEM.row_names)
START = np.array(PROBLEM.response.comfort)
START[ergoqp.JOINTS.index("right_shoulder_flexion")] = 1.3
FRAME = execute_frame()


def told(asked: bytes, limits: tuple[float, float] = (V, A), **more: Any) -> bytes:
    """An answer of the service, with the limits of the relay's tests."""
    frame = step_answer(asked, **({"rows": ROWS, "knots": 4, "dt": DT} | more))
    for name, limit in zip(("speed", "acceleration"), limits, strict=True):
        answer_frame(32, ROWS).numbers(frame, name)[:] = limit
    return bytes(frame)


@pytest.fixture
def fake_relay(tmp_path: Path) -> Iterator[FakeRelay]:
    found = FakeRelay(tmp_path / "fr")
    yield found
    found.end()


@pytest.fixture
def fake(tmp_path: Path) -> Iterator[Fake]:
    """A service that answers 0.1 and a stop of four periods; its sessions are 77, 78, ..."""
    session = [76]

    def answer(asked: bytes) -> bytes:
        session[0] += bool(REQUEST_HEAD.unpack_from(asked)[8] & (Flag.stands | Flag.takes_over))
        return told(asked, session=session[0])

    found = Fake(tmp_path / "f", answer)
    yield found
    found.end()


Make = Callable[..., Client]


@pytest.fixture
def make(service: Running, fake: Fake) -> Iterator[Make]:
    """Makes clients of that service and of a relay."""
    made = list[Client]()

    def one(relay: Relay | FakeRelay) -> Client:
        found = service.client(relay=relay.path, timeout=2.0)
        found._service.path, found.dt = str(fake.path), DT
        found._longest = 3 * DT
        found._acceleration[:] = A
        made.append(found)
        return found

    yield one
    for each in made:
        each.close()


def drive(client: Client, periods: int) -> None:
    """Step once per period."""
    for _ in range(periods):
        begun = time.monotonic()
        step = client.step(START)
        assert step.fresh, step.reason
        time.sleep(max(0.0, DT - (time.monotonic() - begun)))


def said(fake: Fake) -> tuple[int, int, int, int]:
    """Session, sequence, acted and followed of the last request."""
    head = REQUEST_HEAD.unpack_from(fake.requests[-1])
    return (*head[3:6], head[7])


def executed(relay: FakeRelay) -> bytes:
    """The last frame that the relay was to execute."""
    return next(each for each in reversed(relay.requests) if len(each) == FRAME.length)


def test_without_a_relay_nothing_is_known_of_one(service: Running) -> None:
    with service.client() as client:
        assert (client.relay_stands, client.relay_twist) == (False, None)


def test_a_pause_costs_nothing_but_the_stop(relay: Relay, fake: Fake, make: Make) -> None:
    client = make(relay)
    assert (client.relay_stands, client.relay_twist) == (False, None)
    assert not client.step(START).fresh  # nobody has reported anything, and the relay is asked
    assert client.relay_stands
    np.testing.assert_array_equal(client.relay_twist, np.zeros(6))
    client.reset()
    drive(client, 4)
    assert not client.relay_stands
    assert client.relay_twist is not None
    assert client.relay_twist[0] > 0.05
    time.sleep(0.35)
    drive(client, 1)
    # The period of the twist was over when it slept, and then the stop went on.
    assert said(fake)[:3] == (77, 5, 4)
    assert said(fake)[3] >= 2
    drive(client, 1)
    assert said(fake) == (77, 6, 5, 0)
    # Also after it has come to rest.
    time.sleep(0.9)
    drive(client, 1)
    assert said(fake)[3] >= 7
    relay.driver.check()
    assert client.late == client.lost == client.refused == 0


def test_a_client_that_comes_back_takes_over(relay: Relay, fake: Fake, make: Make) -> None:
    client = make(relay)
    client.reset()
    drive(client, 4)
    client.close()
    relay.wait_for("has ended its connection")
    second = make(relay)
    second.reset()  # that is not true
    step = second.step(START)
    assert not step.fresh
    assert not step.twist.any()
    assert step.reason == "relay: it begins at rest, and the robot is still sent a motion"
    assert not second.relay_stands
    second.reset(second.relay_twist)
    step = second.step(START)
    assert step.fresh, step.reason
    assert REQUEST_HEAD.unpack_from(fake.requests[-1])[8] & Flag.takes_over
    second.close()
    relay.driver.wait_for_rest()
    relay.driver.check()


def test_what_the_relay_refuses_is_not_acted_on(relay: Relay, fake: Fake, make: Make) -> None:
    client = make(relay)
    client.reset()
    drive(client, 2)
    usual = fake.answer
    fake.answer = lambda asked: told(asked, twist=0.6, knots=7)
    step = client.step(START)
    assert not step.fresh
    np.testing.assert_allclose(step.twist, 0.075)
    assert step.reason == "relay: twist: it is faster than the speed limits"
    assert (client.refused, client.lost) == (1, 0)
    fake.answer = usual
    time.sleep(0.1)  # a period, so that the next frame does not come too early
    assert client.step(START).fresh
    assert said(fake)[2] == 2


def test_a_second_client_learns_who_is_connected(relay: Relay, fake: Fake, make: Make) -> None:
    client, second = make(relay), make(relay)
    client.reset()
    drive(client, 1)
    for _ in range(2):
        second.reset()
        step = second.step(START)
        assert step.reason == f"relay: process {os.getpid()} is connected already"
        assert not step.fresh
        assert second.relay_twist is None
    assert len(fake.requests) == 1
    client.close()
    relay.wait_for("has ended its connection")
    relay.driver.wait_for_rest()
    time.sleep(0.05)
    second.reset()
    assert second.step(START).fresh


def test_a_relay_that_is_started_anew_knows_nothing(
    relay: Relay, fake: Fake, make: Make, tmp_path: Path
) -> None:
    client = make(relay)
    client.reset()
    drive(client, 3)
    relay.process.kill()
    relay.process.wait()
    step = client.step(START)
    np.testing.assert_allclose(step.twist, 0.075)
    assert step.reason == "relay: the connection was lost"
    assert client.step(START).reason == f"relay: nobody answers at '{relay.path}'"
    assert client.relay_twist is None
    again = Relay(tmp_path / "r", to=relay.driver)
    try:
        step = client.step(START)
        assert not step.fresh
        assert client.waits
        assert step.reason.startswith("relay: it does not execute what was sent to it: call reset")
        assert client.relay_stands
        client.reset()
        step = client.step(START)
        assert step.fresh, step.reason
        assert client.relay_stands  # when it was asked
    finally:
        again.process.kill()
        again.process.wait()
    assert not client.step(START).fresh
    assert not client.relay_stands


def test_the_frame_to_the_relay_is_that_of_the_answer(
    fake: Fake, fake_relay: FakeRelay, make: Make
) -> None:
    client = make(fake_relay)
    limits, moves = (0.3, 0.7), np.arange(6) / 60
    fake.answer = lambda asked: told(asked, limits, twist=moves, knots=5)
    client.reset()
    for base, count in ((Base.rest, 1), (Base.continues, 1), (Base.motion, 2)):
        if base == Base.motion:
            client.reset(moves * 2)
        step = client.step(START, dt=0.07)
        assert step.fresh, step.reason
        np.testing.assert_array_equal(step.twist, moves)
        frame, answer = executed(fake_relay), fake.answer(fake.requests[-1])
        assert answer is not None
        head = EXECUTE_HEAD.unpack_from(frame)
        acted = client._acted - 1 if base == Base.continues else 0
        assert head[4:] == (77, client._acted, acted, 0, base, 5, 0, 0.07), count
        layout = answer_frame(32, ROWS)
        for name in ("twist", "times", "stop", "speed", "acceleration"):
            np.testing.assert_array_equal(FRAME.numbers(frame, name), layout.numbers(answer, name))
        np.testing.assert_array_equal(
            FRAME.numbers(frame, "from"), moves * 2 * (base == Base.motion)
        )


@pytest.mark.parametrize("takes", [True, False])
def test_what_the_relay_took_without_saying_so_counts_once_it_is_asked(
    fake: Fake, fake_relay: FakeRelay, make: Make, takes: bool
) -> None:
    client = make(fake_relay)
    client.reset()
    assert client.step(START).fresh
    client.timeout = 0.15
    fake_relay.delay, fake_relay.takes = 0.5, takes
    step = client.step(START, dt=0.05)
    assert not step.fresh
    np.testing.assert_allclose(step.twist, 0.1 - 0.025 / 2)
    assert step.reason == "relay: no answer in time"
    count = len(fake.requests)
    assert not client.step(START).fresh  # one question at a time
    assert (len(fake.requests), client.late) == (count, 2)
    time.sleep(0.8)
    fake_relay.delay, fake_relay.takes, fake_relay.begun = 0.0, True, 1 if takes else 4
    client.timeout = 2.0
    assert client.step(START).fresh
    # Of the second answer one period of its stop, or four periods of the first one's stop.
    assert said(fake)[2:] == ((2, 1) if takes else (1, 4))
    # What a reset forgot does not come back.
    fake_relay.delay, client.timeout = 0.5, 0.15
    assert not client.step(START).fresh
    client.reset()
    time.sleep(0.6)
    fake_relay.delay, client.timeout = 0.0, 2.0
    assert client.step(START).fresh
    assert said(fake)[2:] == (0, 0)
    assert REQUEST_HEAD.unpack_from(fake.requests[-1])[8] & Flag.stands


def test_an_answer_that_the_relay_took_has_its_own_periods(
    fake: Fake, fake_relay: FakeRelay, make: Make
) -> None:
    client = make(fake_relay)
    client.reset()
    assert client.step(START).fresh
    client.timeout, fake_relay.delay = 0.15, 0.3
    fake.answer = lambda asked: told(asked, twist=0.2, dt=0.05)
    assert not client.step(START, dt=0.05).fresh
    time.sleep(0.4)
    fake_relay.begun, fake_relay.delay = 2, 0.0
    fake.answer = lambda asked: note(Tell.refused, HEAD.unpack_from(asked)[4], "no")
    client.timeout = 2.0
    step = client.step(START, dt=0.05)
    assert step.reason == "service: no"
    assert said(fake)[2:] == (2, 2)
    np.testing.assert_allclose(step.twist, 0.05)


def test_the_client_continues_from_where_the_relay_will_be(
    fake: Fake, fake_relay: FakeRelay, make: Make
) -> None:
    client = make(fake_relay)
    client.reset()
    assert client.step(START).fresh
    for begun, followed in ((0, 0), (1, 1), (2, 2), (9, 9)):
        fake_relay.begun = begun
        assert client.step(START).fresh
        assert said(fake)[3] == followed
        assert EXECUTE_HEAD.unpack_from(executed(fake_relay))[7:9] == (followed, Base.continues)
    for _ in range(2):
        answer, fake.answer = fake.answer, lambda asked: b""
        client.timeout = 0.05
        client.step(START)
        client.step(START)
        client.timeout, fake.answer, fake_relay.begun = 2.0, answer, 0
    fake_relay.session = 5
    step = client.step(START)
    assert not step.fresh
    assert client.waits


def test_with_a_relay_no_answer_of_the_service_is_too_old(
    fake: Fake, fake_relay: FakeRelay, make: Make
) -> None:
    client = make(fake_relay)
    client.reset()
    assert client.step(START).fresh
    usual = fake.answer

    def slow(asked: bytes) -> bytes | None:
        time.sleep(0.35)
        return usual(asked)

    fake.answer = slow
    assert client.step(START).fresh


def _refused(number: int, why: int, text: bytes = b"no") -> bytes:
    head = (TOLD.length, RELAY_VERSION, int(RelayTell.refused), number, 1, 1, 0, why, 0, 0)
    return (TOLD_HEAD.pack(*head) + bytes(48) + text).ljust(TOLD.length, b"\0")


def _number(asked: bytes) -> int:
    return RELAY_HEAD.unpack_from(asked)[3]


@pytest.mark.parametrize(
    ("lie", "words"),
    [
        (lambda a: b"HTTP/1.1 200 OK\r\n\r\n", "an answer that is none"),
        (lambda a: None, "the connection was lost"),
        (lambda a: b"", "no answer in time"),
        (lambda a: RELAY_HEAD.pack(TOLD.length, 9, 1, 1), "an answer of version 9, allowed 1"),
        (lambda a: RELAY_HEAD.pack(16, 1, 1, _number(a)), "an answer that is none"),
        (lambda a: RELAY_HEAD.pack(9999, 1, 1, _number(a)), "an answer that is too long"),
        (lambda a: _refused(_number(a) + 1, Why.frame), "an answer to another question"),
        (lambda a: _refused(0, Why.frame), "an answer that is none"),
        (lambda a: _refused(0, Why.taken), "no"),
        (lambda a: _refused(_number(a), Why.ends, b"\xff" * 256), "\ufffd" * 256),
    ],
)
def test_without_an_answer_of_the_relay_nothing_is_asked(
    fake: Fake,
    fake_relay: FakeRelay,
    make: Make,
    lie: Callable[[bytes], bytes | None],
    words: str,
) -> None:
    client = make(fake_relay)
    client.reset()
    assert client.step(START).fresh
    usual, count = fake_relay.answer, len(fake.requests)
    fake_relay.answer, client.timeout = lie, 0.3
    step = client.step(START)
    assert not step.fresh
    np.testing.assert_allclose(step.twist, 0.075)
    assert step.reason == f"relay: {words}"
    assert client.relay_twist is None
    assert len(fake.requests) == count
    # The same where it is told what to execute: whether it does is not known.
    fake_relay.answer, client.timeout = usual, 2.0
    time.sleep(0.1)
    if words != "no answer in time":
        assert client.step(START).fresh
        fake_relay.answer = lambda asked: lie(asked) if len(asked) > 100 else usual(asked)
        client.timeout = 0.3
        assert not client.step(START).fresh
        fake_relay.answer = usual


def test_a_relay_that_is_not_there_is_said(service: Running, fake: Fake) -> None:
    client = service.client(relay="/nowhere/relay.sock")
    client.reset()
    for count in (1, 2):
        step = client.step(START)
        assert step.reason == "relay: nobody answers at '/nowhere/relay.sock'"
        assert client.lost == count


def test_a_relay_has_a_name(service: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    client = service.client(relay="relay")
    assert client._relay is not None
    path = client._relay.stream.path
    assert path.endswith("/relay.sock")
    assert path.startswith("/")


# ------------------------------------------------------------------ processes that are killed

PERIOD = 0.03


class Loop:
    """A loop in a process of its own."""

    def __init__(self, service: Running, relay: Relay) -> None:
        command = [sys.executable, str(Path(__file__).with_name("relay_loop.py"))]
        words = [service.socket(), relay.path, PERIOD, json.dumps(START.tolist())]
        self.process = subprocess.Popen(
            command + [str(word) for word in words], stdout=subprocess.PIPE, text=True
        )
        self.lines = list[dict[str, Any]]()
        self._thread = threading.Thread(target=self._read)
        self._thread.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.lines.append(json.loads(line))

    def wait(self, what: Callable[[dict[str, Any]], bool]) -> None:
        """Wait for a line."""
        until, seen = time.monotonic() + 30, len(self.lines)
        while not any(what(line) for line in self.lines[seen:]):
            assert time.monotonic() < until, self.lines[-3:]
            assert self.process.poll() is None
            time.sleep(0.001)

    def wait_for_motion(self) -> None:
        self.wait(lambda line: line["fresh"] and np.abs(line["twist"][:3]).max() > 0.03)

    def last(self) -> np.ndarray:
        """The twist that the relay got last, and its stop."""
        fresh = [line for line in self.lines if line["fresh"]][-1]
        return np.vstack([fresh["twist"], fresh["stop"]])

    def end(self) -> None:
        self.process.kill()
        self.process.wait()
        self._thread.join()
        assert self.process.stdout is not None
        self.process.stdout.close()


def check_stop(driver: Driver, first: int, plan: np.ndarray) -> None:
    """Check that the datagrams from `first` on are a plan: a twist and its stop."""
    rows, times = driver.rows[first:], PERIOD * np.arange(len(plan))
    axis = int(np.abs(plan[0]).argmax())
    down = np.sign(plan[0, axis]) * plan[:, axis]
    assert (np.diff(down) < 0).all()
    values = np.sign(plan[0, axis]) * rows[:, 2 + axis]
    # One datagram in the middle of the stop says when it began.
    middle = int(np.flatnonzero(values > down[0] / 2)[-1])
    seconds = rows[:, 1] - rows[middle, 1] + np.interp(values[middle], down[::-1], times[::-1])
    counted = seconds > 0
    assert np.count_nonzero(counted) > 80
    for k in range(6):
        expected = np.interp(seconds[counted], times, plan[:, k])
        np.testing.assert_allclose(rows[counted, 2 + k], expected, atol=1e-8)
    assert not rows[-1, 2:].any()


@pytest.mark.slow
def test_a_loop_that_is_stopped_or_killed_leaves_the_certified_stop(
    tmp_path_factory: pytest.TempPathFactory, relay: Relay
) -> None:
    limit = PROBLEM.twist_limit
    arguments = ("screwing", "--interpreted", "--dt", str(PERIOD))
    with running(tmp_path_factory.mktemp("s"), *arguments) as service:
        service.client().close()
        loop = Loop(service, relay)
        try:
            for seconds in (0.4, 1.0):
                loop.wait_for_motion()
                loop.process.send_signal(signal.SIGSTOP)
                first = len(relay.driver.rows)
                time.sleep(seconds)
                check_stop(relay.driver, first, loop.last())
                # It goes on by itself, and was told once that the robot stands: at the start.
                loop.process.send_signal(signal.SIGCONT)
            loop.wait_for_motion()
            assert loop.lines[-1]["resets"] == 1
            loop.process.kill()
            first = len(relay.driver.rows)
            loop.end()
            time.sleep(0.5)
            check_stop(relay.driver, first, loop.last())
            # The next one reports that the robot stands, because the relay says so.
            loop = Loop(service, relay)
            loop.wait_for_motion()
            assert not loop.lines[0]["fresh"]
            assert loop.lines[-1]["resets"] == 1
            loop.process.kill()
            loop.end()
            relay.driver.wait_for_rest()
        finally:
            loop.end()
    relay.driver.check(limit.acceleration, limit.speed)


@pytest.mark.slow
def test_a_loop_that_comes_back_in_motion_waits_for_rest(
    tmp_path_factory: pytest.TempPathFactory, relay: Relay
) -> None:
    limit = PROBLEM.twist_limit
    arguments = ("screwing", "--interpreted", "--dt", str(PERIOD))
    with running(tmp_path_factory.mktemp("s"), *arguments) as service:
        loop = Loop(service, relay) if service.worker() else None
        assert loop is not None
        loop.wait_for_motion()
        loop.process.kill()
        with service.client(relay=relay.path, timeout=0.5) as client:
            seen = []
            while not client.step(START).fresh:
                seen.append(client.relay_stands)
                if client.waits and client.relay_stands:
                    client.reset()
                time.sleep(0.01)
                assert len(seen) < 1000
            assert False in seen
            assert True in seen
        loop.end()
        relay.driver.wait_for_rest()
    relay.driver.check(limit.acceleration, limit.speed)
