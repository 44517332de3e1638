"""The relay: it executes twists and their stops, whatever happens to who sends them."""

from __future__ import annotations

import os
import signal
import socket
import stat
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from puppet import Fake, N, Puppet, step_answer
from relay_running import DT, TOLD, A, Driver, FakeRelay, Relay, V, relay_program
from service_running import Running, running

import ergoqp
from ergoqp.cli.main import execute
from ergoqp.service.c_header import header, relay_source
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
)
from ergoqp.service.schema import KNOTS, REQUEST_HEAD, Flag, answer_frame

FRAME = execute_frame()


class Told:
    """An answer of the relay."""

    def __init__(self, frame: bytes) -> None:
        head = TOLD_HEAD.unpack_from(frame)
        self.kind, self.number, self.session, self.sequence, self.begun = head[2:7]
        self.why, self.stands = Why(head[7]), bool(head[8])
        self.twist = TOLD.numbers(frame, "twist").copy()
        self.text = frame[TOLD.at["text"]].rstrip(b"\0").decode()

    @property
    def accepted(self) -> bool:
        return self.kind == RelayTell.accepted


class Sender:
    """A client of the relay that sends what it is told."""

    def __init__(self, relay: Relay) -> None:
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self.socket.settimeout(5)
        self.socket.connect(os.fspath(relay.path))
        self.number = 0

    def receive(self) -> Told:
        frame = b""
        while len(frame) < TOLD.length:
            more = self.socket.recv(TOLD.length - len(frame))
            assert more, "the relay has ended the connection"
            frame += more
        return Told(frame)

    def send(self, frame: bytes) -> Told:
        self.socket.sendall(frame)
        return self.receive()

    def status(self) -> Told:
        self.number += 1
        head = (RELAY_HEAD.size, RELAY_VERSION, RelayAsk.status, self.number)
        told = self.send(RELAY_HEAD.pack(*head))
        assert (told.kind, told.number) == (RelayTell.status, self.number)
        return told

    def execute(self, *values: Any, **named: Any) -> Told:
        self.number += 1
        return self.send(frame_of(*values, number=self.number, **named))

    def end(self) -> None:
        self.socket.close()


def frame_of(
    sequence: int,
    twist: Any,
    acted: int = 0,
    followed: int = 0,
    base: int = Base.rest,
    session: int = 7,
    knots: int = 4,
    number: int = 1,
    start: Any = 0.0,
    **changed: Any,
) -> bytes:
    """Return a frame: a twist, and a stop of equal steps."""
    frame = bytearray(FRAME.length)
    head = (len(frame), RELAY_VERSION, RelayAsk.execute, number)
    EXECUTE_HEAD.pack_into(
        frame, 0, *head, session, sequence, acted, followed, base, knots, 0, changed.pop("dt", DT)
    )
    shares = 1 - np.arange(1, knots + 1) / max(knots, 1)
    values: dict[str, Any] = {"acceleration": A, "speed": V, "from": start, "twist": twist}
    for name, value in values.items():
        FRAME.numbers(frame, name)[:] = value
    FRAME.numbers(frame, "times")[: min(knots, KNOTS)] = DT * np.arange(1, knots + 1)[:KNOTS]
    stop = np.outer(shares, np.broadcast_to(np.nan_to_num(twist), 6))[:KNOTS]
    FRAME.numbers(frame, "stop").reshape(KNOTS, 6)[: len(stop)] = stop
    for name, (place, value) in changed.items():
        FRAME.numbers(frame, name)[place] = value
    return bytes(frame)


@pytest.fixture
def sender(relay: Relay) -> Iterator[Sender]:
    found = Sender(relay)
    yield found
    found.end()


def test_it_sends_zero_until_it_is_told(relay: Relay, sender: Sender) -> None:
    told = sender.status()
    assert (told.stands, told.session, told.sequence, told.begun) == (True, 0, 0, 0)
    time.sleep(1.0)
    rows = relay.driver.rows
    assert not rows[:, 2:].any()
    np.testing.assert_array_equal(np.diff(rows[:, 0]), 1)
    assert 0.8 * 500 < (len(rows) - 1) / (rows[-1, 1] - rows[0, 1]) <= 500.5
    assert stat.S_IMODE(relay.path.stat().st_mode) == 0o600


def expected_output(times: np.ndarray, reach: float, twist: float) -> np.ndarray:
    """The output of `frame_of` from rest: up within `reach`, down within four periods."""
    return np.interp(times, [0, reach, reach + 4 * DT], [0, twist, 0])


@pytest.mark.parametrize(("twist", "reach"), [(0.08, 1.75 * DT), (0.2, 0.2), (-0.3, 0.3)])
def test_the_output_goes_to_the_twist_and_along_its_stop(
    relay: Relay, sender: Sender, twist: float, reach: float
) -> None:
    told = sender.execute(1, [0, 0, twist, 0, 0, twist / 2])
    assert told.accepted
    assert (told.session, told.sequence, told.begun, told.stands) == (7, 1, 0, False)
    relay.driver.wait(lambda now: now.any())
    relay.driver.wait_for_rest()
    time.sleep(0.1)
    rows = relay.driver.rows
    moves = np.flatnonzero(rows[:, 4])
    # The start is that of the line through the first two points.
    (t0, y0), (t1, y1) = rows[moves[:2]][:, [1, 4]]
    times = rows[:, 1] - (t0 - y0 * (t1 - t0) / (y1 - y0))
    np.testing.assert_allclose(rows[:, 4], expected_output(times, reach, twist), atol=1e-9)
    np.testing.assert_allclose(rows[:, 7], rows[:, 4] / 2, atol=1e-12)
    assert not rows[:, [2, 3, 5, 6]].any()
    relay.driver.check()
    told = sender.status()
    assert told.stands
    assert told.begun >= 5


def test_periods_of_the_stop_are_counted(relay: Relay, sender: Sender) -> None:
    begun = time.monotonic()
    assert sender.execute(1, 0.08).accepted
    seen = []
    while time.monotonic() - begun < 0.75:
        told = sender.status()
        # The first 1.75 periods lead to the twist; every further one is one of the stop. What is
        # told is what will have begun half a period later, when an answer may arrive.
        seen.append((time.monotonic() - begun, told.begun))
        time.sleep(0.01)
    for seconds, count in seen:
        assert count in {max(0, int((seconds + e) / DT - 0.25)) for e in (0.0, -0.02, -0.05)}, (
            seconds
        )
    assert seen[-1][1] >= 6


def test_a_loop_goes_on_and_what_is_old_does_not(relay: Relay, sender: Sender) -> None:
    assert sender.execute(1, 0.08).accepted
    for sequence in range(2, 6):
        time.sleep(DT)
        told = sender.execute(sequence, 0.08, acted=sequence - 1, base=Base.continues)
        assert told.accepted, told.text
    time.sleep(0.5)
    # As after a pause of the client: it does not know how far the stop has gone.
    told = sender.execute(6, 0.08, acted=5, base=Base.continues)
    assert (told.kind, told.why) == (RelayTell.refused, Why.base)
    assert told.text.startswith("followed: got 0 periods of the stop, and")
    assert told.sequence == 5
    relay.driver.wait_for_rest()
    time.sleep(0.1)
    assert not relay.driver.twist.any()
    # It may go on from there once it knows.
    begun = sender.status().begun
    for wrong in (begun + 4, begun - 3):
        assert not sender.execute(6, 0.08, 5, wrong, Base.continues).accepted
    assert sender.execute(6, 0.08, 5, begun, Base.continues).accepted
    relay.driver.wait(lambda now: now.any())
    relay.driver.check()


def test_a_frame_continues_from_a_knot_that_lies_ahead(relay: Relay, sender: Sender) -> None:
    for followed, allowed in ((0, False), (1, True), (2, True), (3, False), (4, False)):
        relay.driver.wait_for_rest()
        before = sender.status().sequence
        assert sender.execute(before + 1, 0.08).accepted
        # In half a period the second one of the stop begins; now the first one has.
        while sender.status().begun < 2:
            time.sleep(0.002)
        told = sender.execute(before + 2, 0.0, before + 1, followed, Base.continues)
        assert told.accepted == allowed, (followed, told.text)
    relay.driver.check()


def test_early_and_late_frames_leave_no_trace(relay: Relay, sender: Sender) -> None:
    rise, rng = 0.03, np.random.default_rng(4)
    begun = time.monotonic()
    assert sender.execute(1, rise).accepted
    for sequence in range(2, 12):
        due = begun + (sequence - 1 + rng.uniform(-0.2, 0.3)) * DT
        time.sleep(max(0.0, due - time.monotonic()))
        told = sender.execute(sequence, rise * sequence, sequence - 1, 0, Base.continues)
        assert told.accepted, told.text
    rows = relay.driver.rows
    rows = rows[(rows[:, 2] > rise) & (rows[:, 2] < 11 * rise)]
    slopes = np.diff(rows[:, 2]) / np.diff(rows[:, 1])
    np.testing.assert_allclose(slopes, rise / DT, rtol=1e-6)


def test_a_frame_that_comes_much_too_early_is_refused(relay: Relay, sender: Sender) -> None:
    assert sender.execute(1, 0.08).accepted
    told = sender.execute(2, 0.08, 1, 0, Base.continues)  # the first twist is 1.75 periods ahead
    assert (told.kind, told.why, told.sequence) == (RelayTell.refused, Why.base, 1)
    said, _, rest = told.text.partition(" lies ")
    assert said == "it comes too early: what it continues from"
    assert 0.1 < float(rest.partition(" ")[0]) <= 0.175
    time.sleep(0.5 * DT)
    for sequence in (2, 3):
        told = sender.execute(sequence, 0.08, sequence - 1, 0, Base.continues)
        assert told.accepted == (sequence == 2), told.text
        time.sleep(0.1 * DT)
    relay.driver.wait_for_rest()
    relay.driver.check()


def test_lines_wait_for_their_time(relay: Relay, sender: Sender) -> None:
    # The third frame comes before the line to the second twist has begun.
    rise, begun = 0.05, time.monotonic()
    for sequence, due in ((1, 0.0), (2, 0.6), (3, 1.5)):
        time.sleep(max(0.0, begun + due * DT - time.monotonic()))
        told = sender.execute(sequence, rise * sequence, sequence - 1, 0, 2 - (sequence > 1))
        assert told.accepted, told.text
    relay.driver.wait_for_rest()
    rows = relay.driver.rows
    top = np.argmax(rows[:, 2])
    rows = rows[:top]
    rows = rows[rows[:, 2] > rise]
    np.testing.assert_allclose(np.diff(rows[:, 2]) / np.diff(rows[:, 1]), rise / DT, rtol=1e-6)


def test_an_axis_that_does_not_move_has_the_speed_zero(relay: Relay, sender: Sender) -> None:
    told = sender.execute(1, [0.08, 0, 0, 0, 0, 0], speed=(3, 0.0))
    assert told.accepted, told.text
    assert sender.execute(2, 0.08, 1, 0, Base.continues, speed=(3, 0.0)).why == Why.limits
    relay.driver.wait_for_rest()
    relay.driver.check()


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"acted": 4}, "acted: got answer 4, and answer 5 of this session is executed"),
        ({"session": 8}, "acted: got answer 5, and answer 5 of another session is executed"),
        ({"sequence": 5}, "sequence: got 5 again, allowed a number above 5"),
        ({"sequence": 1}, "sequence: got 1 again"),
    ],
)
def test_what_continues_from_another_answer_is_refused(
    sender: Sender, changed: dict[str, int], words: str
) -> None:
    assert sender.execute(5, 0.08).accepted
    usual = {"sequence": 6, "acted": 5, "base": Base.continues, "session": 7}
    told = sender.execute(twist=0.08, **(usual | changed))
    assert (told.why, told.sequence) == (Why.base, 5)
    assert told.text.startswith(words)


def test_it_stands_as_soon_as_nothing_moves_any_more(relay: Relay, sender: Sender) -> None:
    assert sender.execute(1, 0.0).accepted  # zero, and a stop of zeros
    assert sender.status().stands
    assert sender.execute(2, 0.1).accepted
    time.sleep(DT)
    assert sender.execute(3, 0.0, 2, 0, Base.continues).accepted
    assert not sender.status().stands
    relay.driver.wait_for_rest()
    time.sleep(0.02)
    assert sender.status().stands
    relay.driver.check()
    assert sender.execute(4, 0.1).accepted
    time.sleep(0.45)  # its last knot but one, 0.025, is due
    told = sender.status()
    assert (told.stands, told.twist[0] > 0) == (False, True)


def test_a_beginning_needs_rest(relay: Relay, sender: Sender) -> None:
    assert sender.execute(1, 0.08).accepted
    told = sender.execute(1, 0.08, session=8)
    assert (told.why, told.session) == (Why.moves, 7)
    relay.driver.wait(lambda now: now.any())
    relay.driver.wait_for_rest()
    assert not sender.execute(1, 0.08).accepted  # the frame of before, sent again
    assert sender.execute(1, 0.08, session=8).accepted


def test_who_takes_over_must_know_the_motion(relay: Relay, sender: Sender) -> None:
    slow = {"acceleration": (slice(None), 0.2)}
    assert sender.execute(1, 0.07, **slow).accepted
    time.sleep(0.1)
    for off, accepted in ((0.06, False), (-0.06, False), (0.02, True)):
        now = sender.status().twist
        told = sender.execute(1, 0.05, base=Base.motion, session=8, start=now + off, **slow)
        assert told.accepted == accepted, told.text
        if not accepted:
            assert told.why == Why.motion
    relay.driver.wait_for_rest()
    relay.driver.check(0.2)
    # At rest it is the motion zero.
    assert sender.execute(1, 0.05, base=Base.motion, session=9, **slow).accepted


EACH = slice(None)


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        *(
            ({name: (0, bad)}, Why.numbers)
            for name in ("twist", "from")
            for bad in (np.nan, np.inf)
        ),
        *(({"stop": (0, bad)}, Why.numbers) for bad in (np.nan, -np.inf)),
        *(({"times": (1, bad)}, Why.numbers) for bad in (np.nan, 0.1, 0.0, -1.0)),
        *(
            ({name: (3, bad)}, Why.numbers)
            for name in ("acceleration", "speed")
            for bad in (np.nan, np.inf, -1.0)
        ),
        ({"acceleration": (3, 0.0)}, Why.numbers),
        *(({"dt": bad}, Why.numbers) for bad in (np.nan, 0.0, -0.1, 1e9)),
        *(({"knots": bad}, Why.numbers) for bad in (0, 65, 1 << 31)),
        *(({"base": bad}, Why.numbers) for bad in (0, 4)),
        ({"session": 0}, Why.numbers),
        ({"sequence": 0}, Why.numbers),
        ({"stop": (23, 0.001)}, Why.numbers),  # it does not end at rest
        ({"twist": (5, 0.51)}, Why.limits),
        ({"twist": (5, -0.51)}, Why.limits),
        ({"stop": (0, 0.6)}, Why.limits),
        ({"stop": (0, 0.25)}, Why.limits),
        ({"stop": (0, -0.05)}, Why.limits),
        ({"times": (EACH, np.arange(1, 65) * 0.01)}, Why.limits),
        ({"acceleration": (2, 0.1)}, Why.limits),
    ],
)
def test_a_frame_that_nobody_may_execute_is_refused(
    relay: Relay, sender: Sender, changed: dict[str, Any], why: Why
) -> None:
    usual: dict[str, Any] = {"sequence": 1, "twist": 0.1}
    if changed.get("knots", 0) > KNOTS:
        frame = bytearray(frame_of(**usual))
        EXECUTE_HEAD.pack_into(
            frame, 0, *EXECUTE_HEAD.unpack_from(frame)[:9], changed["knots"], 0, DT
        )
    else:
        extra = {} if "twist" not in changed else {"twist": changed["twist"]}
        frame = bytearray(frame_of(**(usual | {k: v for k, v in changed.items() if k != "twist"})))
        for name, (place, value) in extra.items():
            FRAME.numbers(frame, name)[place] = value
    told = sender.send(bytes(frame))
    assert (told.kind, told.why) == (RelayTell.refused, why)
    assert told.text
    assert told.stands
    assert sender.execute(1, 0.1).accepted


def test_rounding_is_cut_off(relay: Relay, sender: Sender) -> None:
    # The twist and the first knot are too fast by a little: for a while the output is the limit.
    over = {"stop": (0, V + 5e-7), "times": (EACH, 2 * DT * np.arange(1.0, 65.0))}
    told = sender.execute(1, [V + 5e-7, 0, 0, 0, 0, 0], knots=7, **over)
    assert told.accepted, told.text
    relay.driver.wait(lambda now: now[0] > 0.98 * V)
    relay.driver.wait_for_rest()
    relay.driver.check()
    assert relay.driver.rows[:, 2].max() == V
    # The first part of the stop is too short by a little: it lasts longer.
    told = sender.execute(2, [0, 0, 0, 0, 0, V], knots=5, times=(0, DT * (1 - 5e-4)))
    assert told.accepted, told.text
    relay.driver.wait(lambda now: now[5] > 0.98 * V)
    relay.driver.wait_for_rest()
    relay.driver.check()


def test_garbage_ends_the_connection_and_the_stop_goes_on(relay: Relay, sender: Sender) -> None:
    assert sender.execute(1, 0.1).accepted
    relay.driver.wait(lambda now: now.any())
    for text in (
        RELAY_HEAD.pack(16, 9, 1, 5),
        RELAY_HEAD.pack(16, 1, 9, 5),
        RELAY_HEAD.pack(17, 1, 1, 5),
        RELAY_HEAD.pack(16, 1, 1, 5) * 2,
        RELAY_HEAD.pack(1 << 31, 1, 2, 5),
        b"GET / HTTP/1.1\r\n\r\n",
    ):
        told = sender.send(text)
        assert (told.kind, told.why) == (RelayTell.refused, Why.frame)
        assert sender.socket.recv(100) == b""
        sender.end()
        sender.__init__(relay)
    # Half a frame moves nothing.
    sender.socket.sendall(frame_of(2, 0.1, 1, 0, Base.continues)[:-8])
    relay.driver.wait_for_rest()
    relay.driver.check()
    assert "sent what is no frame" in relay.log.read_text()


def test_another_client_may_come_but_only_one(relay: Relay, sender: Sender) -> None:
    assert sender.execute(1, 0.1).accepted
    second = Sender(relay)
    told = second.receive()
    assert (told.kind, told.why) == (RelayTell.refused, Why.taken)
    assert told.text == f"process {os.getpid()} is connected already"
    assert second.socket.recv(10) == b""
    second.end()
    sender.end()
    relay.wait_for("has ended its connection; the stop goes on")
    sender.__init__(relay)
    told = sender.status()
    assert (told.session, told.sequence) == (7, 1)
    relay.driver.wait_for_rest()
    relay.driver.check()


def test_it_ends_at_rest(relay: Relay, sender: Sender) -> None:
    assert sender.execute(1, 0.1).accepted
    relay.driver.wait(lambda now: now[0] > 0.02)
    relay.process.send_signal(signal.SIGTERM)
    time.sleep(0.05)
    told = sender.execute(2, 0.1, 1, 0, Base.continues)
    assert (told.why, told.text) == (Why.ends, "the relay ends")
    assert relay.process.poll() is None
    assert relay.process.wait(10) == 0
    relay.driver.check()
    assert not relay.driver.twist.any()
    assert np.abs(relay.driver.rows[:, 2]).max() > 0.09
    assert not relay.path.exists()
    assert "ends at rest" in relay.log.read_text()


def test_a_relay_that_was_killed_makes_room(relay: Relay, tmp_path: Path) -> None:
    other = subprocess.run(
        [relay_program(), "--in", relay.path], capture_output=True, text=True, check=False
    )
    assert other.returncode == 2
    assert "another relay listens at" in other.stderr
    relay.process.kill()
    relay.process.wait()
    assert relay.path.exists()
    again = Relay(tmp_path / "r", to=relay.driver)
    again.process.kill()
    again.process.wait()


def test_its_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["relay", "--source"]) == 0
    assert capsys.readouterr().out == relay_source()
    (tmp_path / "relay.c").write_text(relay_source())
    (tmp_path / "ergoqp_client.h").write_text(header())
    strict = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wconversion"]
    subprocess.run(["gcc", *strict, "relay.c", "-o", "relay", "-lm"], cwd=tmp_path, check=True)
    (tmp_path / "file").touch()
    for words, said in (
        ([], "got no --in"),
        (["--in"], "usage:"),
        (["--out", "x"], "got --out"),
        (["--in", "file"], "there is something else at file"),
        (["--in", "/nowhere/x"], "cannot listen there: No such file"),
        (["--in", "x" * 200], "a socket's path has 1 to 107 bytes"),
        (["--in", "x", "--rate", "0"], "--rate: got 0, allowed 1 to 10000"),
        (["--in", "x", "--rate", "fast"], "--rate: got fast"),
        (["--in", "x", "--fifo", "100"], "--fifo: got 100, allowed 1 to 99"),
        (["--in", "x", "--to", "tcp:1"], "allowed unix:PATH or udp:HOST:PORT, got tcp:1"),
        (["--in", "x", "--to", "udp:localhost"], "allowed unix:PATH or udp:HOST:PORT"),
    ):
        done = subprocess.run(
            ["./relay", *words], cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert done.returncode == 2
        assert said in done.stderr
        assert done.stderr.startswith("ergoqp relay: ")


@pytest.mark.slow
def test_the_command_becomes_the_relay_and_writes_lines(tmp_path: Path) -> None:
    words = ["-m", "ergoqp", "relay", "--in", tmp_path / "in", "--rate", "50"]
    process = subprocess.Popen([sys.executable, *words], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    lines = [process.stdout.readline().split() for _ in range(10)]
    assert [int(line[0]) for line in lines] == list(range(10))
    assert all(line[2:] == ["0"] * 6 for line in lines)
    assert 0.15 < float(lines[-1][1]) - float(lines[0][1]) < 2.0
    process.terminate()
    process.communicate()
    assert process.returncode == 0


def test_it_sends_by_udp_and_says_what_it_may(tmp_path: Path) -> None:
    driver = Driver(None)
    relay = Relay(tmp_path / "r", "--fifo", "20", to=driver)
    driver.wait(lambda now: True)
    sender = Sender(relay)
    assert sender.execute(1, 0.05).accepted
    driver.wait(lambda now: now.any())
    driver.wait_for_rest()
    driver.check()
    assert "SCHED_FIFO 20" in relay.log.read_text()
    sender.end()
    relay.end()


def test_a_driver_that_is_not_there_is_said_once(tmp_path: Path) -> None:
    driver = Driver(tmp_path / "out")
    relay = Relay(tmp_path / "r", to=driver)
    driver.wait(lambda now: True)
    driver.end()
    relay.wait_for("the robot's driver does not take the twists: Connection refused")
    time.sleep(0.1)
    assert relay.log.read_text().count("does not take") == 1
    relay.process.kill()
    relay.process.wait()


def test_whatever_comes_the_limits_hold(relay: Relay, sender: Sender) -> None:
    rng = np.random.default_rng(5)
    accepted, refused = 0, set[Why]()
    for sequence in range(1, 121):
        told = sender.status()
        base = Base(int(rng.choice([1, 1, 1, 2, 3])))
        size = float(rng.choice([0.0, 0.1, 0.3, 0.49]))
        twist = size * rng.uniform(-1, 1, 6)
        knots = max(1, int(np.ceil(np.abs(twist).max() / (A * DT)))) + int(rng.integers(0, 3))
        followed = max(0, told.begun + int(rng.integers(-2, 3)))
        start = told.twist + rng.choice([0.0, 0.1, 0.3])
        told = sender.execute(sequence, twist, told.sequence, followed, base, 7, knots, start=start)
        accepted += told.accepted
        refused.add(told.why)
        time.sleep(float(rng.choice([0.0, 0.01, 0.05, 0.1])))
    assert accepted > 20
    assert refused == {Why.none, Why.base, Why.moves, Why.motion}
    relay.driver.wait_for_rest()
    relay.driver.check()


# ------------------------------------------------------------------------------- with the C client


@pytest.fixture
def puppet() -> Iterator[Puppet]:
    found = Puppet()
    yield found
    found.end()


@pytest.fixture
def fake(tmp_path: Path) -> Iterator[Fake]:
    """A service that answers 0.1 and a stop of four periods; its sessions are 77, 78, ..."""
    session = [76]

    def answer(asked: bytes) -> bytes:
        session[0] += bool(REQUEST_HEAD.unpack_from(asked)[8] & (Flag.stands | Flag.takes_over))
        return bytes(step_answer(asked, knots=4, dt=DT, session=session[0]))

    found = Fake(tmp_path / "f", answer)
    yield found
    found.end()


def ready(puppet: Puppet, service: Path, relay: Relay | Fake, **more: Any) -> None:
    puppet.init(service, relay.path, dt=DT, **more)
    puppet.give("limits", [V] * 6 + [A] * 6)


def drive(puppet: Puppet, periods: int) -> None:
    """Step once per period."""
    for _ in range(periods):
        begun = time.monotonic()
        step = puppet.step()
        assert step.fresh, puppet.reason
        time.sleep(max(0.0, DT - (time.monotonic() - begun)))


def test_a_client_that_is_killed_in_motion_leaves_the_stop(
    relay: Relay, fake: Fake, puppet: Puppet
) -> None:
    ready(puppet, fake.path, relay)
    puppet.ask("reset")
    drive(puppet, 4)
    assert relay.driver.twist[0] > 0.05
    puppet.process.kill()
    puppet.process.wait()
    relay.driver.wait_for_rest()
    time.sleep(0.1)
    assert not relay.driver.twist.any()
    relay.driver.check()
    rows = relay.driver.rows
    # It lasted as long as the stop: the period to the twist, and four.
    fast = rows[rows[:, 2] > 0.0999, 1].max()
    slow = rows[rows[:, 2] > 0, 1].max()
    assert 0.35 < slow - fast < 0.45
    # Another client begins when its program says so.
    second = Puppet()
    ready(second, fake.path, relay)
    assert not second.step().fresh
    assert second.waits
    assert second.numbers("relay")[:2].tolist() == [1, 1]
    second.ask("reset")
    drive(second, 2)
    relay.driver.check()
    second.end()


def test_the_limits_come_with_the_first_answer(relay: Relay, fake: Fake, puppet: Puppet) -> None:
    usual = fake.answer

    def answer(asked: bytes) -> bytes:
        frame = bytearray(usual(asked))
        layout = answer_frame(N, 3)
        layout.numbers(frame, "speed")[:] = V
        layout.numbers(frame, "acceleration")[:] = A
        return bytes(frame)

    fake.answer = answer
    puppet.init(fake.path, relay.path, dt=DT)
    puppet.ask("reset")
    drive(puppet, 3)
    relay.driver.check()


def test_a_client_that_comes_back_in_motion_takes_over(
    relay: Relay, fake: Fake, puppet: Puppet
) -> None:
    ready(puppet, fake.path, relay)
    puppet.ask("reset")
    drive(puppet, 4)
    puppet.end()
    relay.wait_for("has ended its connection")
    second = Puppet()
    ready(second, fake.path, relay)
    second.ask("reset")  # that is not true
    assert not second.step().fresh
    assert second.reason == "relay: it begins at rest, and the robot is still sent a motion"
    moves = second.numbers("relay")
    assert moves[1] == 0
    second.ask("take_over", *moves[2:].tolist())
    assert second.step().fresh, second.reason
    relay.driver.check()
    second.end()


def test_a_client_that_slept_goes_on_where_the_robot_is(
    relay: Relay, fake: Fake, puppet: Puppet
) -> None:
    ready(puppet, fake.path, relay, longest=0.3)
    puppet.ask("reset")
    drive(puppet, 4)
    puppet.process.send_signal(signal.SIGSTOP)
    time.sleep(0.3)
    puppet.process.send_signal(signal.SIGCONT)
    before = len(fake.requests)
    drive(puppet, 2)
    # The period of the twist was over when it slept, and then the stop went on.
    said = [REQUEST_HEAD.unpack_from(asked) for asked in fake.requests[before:]]
    assert said[0][3:6] == (77, 5, 4)
    assert said[0][7] >= 2
    assert said[1][3:6] == (77, 6, 5)
    assert said[1][7] == 0
    relay.driver.check()
    # Also after it has come to rest.
    time.sleep(0.8)
    drive(puppet, 1)
    assert REQUEST_HEAD.unpack_from(fake.requests[-1])[7] >= 7
    relay.driver.check()


def test_what_the_relay_refuses_is_not_acted_on(relay: Relay, fake: Fake, puppet: Puppet) -> None:
    ready(puppet, fake.path, relay)
    puppet.ask("reset")
    drive(puppet, 2)
    usual = fake.answer
    fake.answer = lambda asked: bytes(step_answer(asked, twist=0.6, knots=7, dt=DT))
    step = puppet.step()
    assert not step.fresh
    np.testing.assert_allclose(step.twist, 0.075)
    assert puppet.reason == "relay: twist: it is faster than the speed limits"
    fake.answer = usual
    assert puppet.step().fresh
    assert REQUEST_HEAD.unpack_from(fake.requests[-1])[5] == 2
    puppet.init(fake.path, relay.path, dt=DT)
    puppet.ask("reset")
    relay.driver.wait_for_rest()
    assert not puppet.step().fresh
    assert puppet.reason.startswith("relay: acceleration, speed: axis 0 is 0, 0, allowed")


def test_a_second_client_learns_who_is_connected(relay: Relay, fake: Fake, puppet: Puppet) -> None:
    ready(puppet, fake.path, relay)
    puppet.ask("reset")
    drive(puppet, 1)
    second = Puppet()
    ready(second, fake.path, relay)
    second.ask("reset")
    assert not second.step().fresh
    assert second.reason == f"relay: process {puppet.process.pid} is connected already"
    second.end()


def test_a_relay_that_is_started_anew_knows_nothing(
    relay: Relay, fake: Fake, puppet: Puppet, tmp_path: Path
) -> None:
    ready(puppet, fake.path, relay)
    puppet.ask("reset")
    drive(puppet, 3)
    relay.process.kill()
    relay.process.wait()
    step = puppet.step()
    np.testing.assert_allclose(step.twist, 0.075)
    assert "relay: " in puppet.reason
    again = Relay(tmp_path / "r", to=relay.driver)
    assert not puppet.step().fresh
    assert not puppet.step().fresh
    assert puppet.waits
    assert puppet.reason.startswith("relay: it does not execute what was sent to it")
    puppet.ask("reset")
    assert puppet.step().fresh, puppet.reason
    again.process.kill()
    again.process.wait()


@pytest.mark.parametrize("takes", [True, False])
def test_what_the_relay_took_without_saying_so_counts_once_it_is_asked(
    fake: Fake, puppet: Puppet, tmp_path: Path, takes: bool
) -> None:
    relay = FakeRelay(tmp_path / "fr")
    ready(puppet, fake.path, relay)
    puppet.ask("reset")
    assert puppet.step().fresh
    puppet.ask("timeout", 0.15)
    relay.delay, relay.takes = 0.5, takes
    step = puppet.step()
    assert not step.fresh
    np.testing.assert_allclose(step.twist, 0.075)
    assert puppet.reason == "relay: no answer in time"
    count = len(fake.requests)
    assert not puppet.step().fresh  # one question at a time
    assert len(fake.requests) == count
    time.sleep(0.8)
    relay.delay, relay.takes, relay.begun = 0.0, True, 1 if takes else 2
    puppet.ask("timeout", 2.0)
    assert puppet.step().fresh, puppet.reason
    said = REQUEST_HEAD.unpack_from(fake.requests[-1])
    # Of the second answer and the first period of its stop, or two of the first one's.
    assert (said[5], said[7]) == ((2, 1) if takes else (1, 2))
    relay.end()


def test_the_client_continues_from_where_the_relay_will_be(
    fake: Fake, puppet: Puppet, tmp_path: Path
) -> None:
    relay = FakeRelay(tmp_path / "fr")
    ready(puppet, fake.path, relay)
    puppet.ask("reset")
    assert puppet.step().fresh
    for begun, followed in ((0, 0), (1, 1), (2, 2), (9, 9)):
        relay.begun = begun
        assert puppet.step().fresh
        assert REQUEST_HEAD.unpack_from(fake.requests[-1])[7] == followed
        frame = next(each for each in reversed(relay.requests) if len(each) == FRAME.length)
        assert EXECUTE_HEAD.unpack_from(frame)[7:9] == (followed, Base.continues)
    relay.session = 5
    assert not puppet.step().fresh
    assert puppet.waits
    relay.end()


@pytest.mark.slow
def test_a_loop_with_service_and_relay(
    tmp_path_factory: pytest.TempPathFactory, relay: Relay, puppet: Puppet
) -> None:
    problem = ergoqp.load_problem("screwing")
    posture = np.array(problem.response.comfort)
    posture[ergoqp.JOINTS.index("right_shoulder_flexion")] = 1.3
    speed, acceleration = problem.twist_limit.speed, problem.twist_limit.acceleration
    folder = tmp_path_factory.mktemp("s")
    arguments = ("screwing", "--interpreted", "--dt", str(DT))
    service: Running
    with running(folder, *arguments) as service:
        service.client().close()
        puppet.init(service.socket(), relay.path, dt=DT, timeout=0.09)
        puppet.give("limits", [*speed, *acceleration])
        puppet.give("posture", posture)
        puppet.ask("reset")
        worker, fresh = service.worker(), 0
        for number in range(30):
            begun = time.monotonic()
            if number == 10:
                os.kill(worker, signal.SIGSTOP)
            if number == 13:
                os.kill(worker, signal.SIGCONT)
            if number == 20:
                puppet.process.send_signal(signal.SIGSTOP)
                time.sleep(0.4)
                puppet.process.send_signal(signal.SIGCONT)
            fresh += puppet.step().fresh
            assert not puppet.waits, puppet.reason
            time.sleep(max(0.0, DT - (time.monotonic() - begun)))
        assert fresh > 15
        assert np.abs(relay.driver.rows[:, 2:5]).max() > 0.02
        puppet.process.kill()
        relay.driver.wait_for_rest()
        relay.driver.check(acceleration, speed)
