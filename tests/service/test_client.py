"""The client in Python against a running service, and against servers that lie."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from puppet import Fake, step_answer
from service_running import Running, running

import ergoqp
from ergoqp.native.compiled import compiler
from ergoqp.service.client import Client, ClientStep, ServiceError
from ergoqp.service.schema import (
    ANSWER_HEAD,
    HEAD,
    REQUEST_HEAD,
    Ask,
    Flag,
    Tell,
    answer_frame,
    note,
    request_frame,
)
from ergoqp.step.stepper import Stepper

PROBLEM = ergoqp.load_problem("screwing")
START = np.array(PROBLEM.response.comfort)
START[ergoqp.JOINTS.index("right_shoulder_flexion")] = 1.3
START[ergoqp.JOINTS.index("right_elbow_flexion")] = 0.5


@pytest.fixture(params=["compiled", "python"], autouse=True)
def calls(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """A question and its answer by the compiled call, and where there is no compiler."""
    if request.param == "python":
        monkeypatch.setattr("ergoqp.service.client.asking_of", lambda *_: None)


@pytest.fixture
def client(service: Running) -> Iterator[Client]:
    with service.client() as found:
        yield found


@pytest.fixture(scope="module")
def stepper() -> Stepper:
    return Stepper(PROBLEM)


def test_it_gives_the_steps_of_a_stepper(client: Client, stepper: Stepper) -> None:
    stepper.reset()
    client.reset()
    client._longest = 60.0  # the first step of the stepper may be slow
    posture = START.copy()
    for number in range(30):
        more: dict[str, Any] = {"observed": np.arange(32) != number} if number % 3 == 1 else {}
        if number == 7:
            posture = posture.tolist()
        mine, theirs = client.step(posture, **more), stepper.step(posture, **more)
        assert mine.fresh
        for name in ("status", "drawn", "cost", "gain", "margins", "residuals", "locked", "active"):
            assert getattr(mine, name) == getattr(theirs, name), name
        assert mine.slack == theirs.slack
        for name in ("twist", "pose", "posture_rate"):
            np.testing.assert_array_equal(getattr(mine, name), getattr(theirs, name))
        posture = np.array(posture) + 0.01 * mine.posture_rate
    assert client.step(None).reason == stepper.step(None).reason == "no posture arrived"
    assert client.step(posture, enable="no").status == "braking"
    assert "asked to brake" in client.brake().reason
    stop = client.stop()
    assert len(stop) > 3
    assert not stop[-1].any()


def test_no_input_raises(client: Client) -> None:
    client.reset()
    for bad in (
        "text",
        [10**400] * 32,
        [1, 2],
        object(),
        np.full(32, np.inf),
        {"a": 1},
        np.zeros((32, 1)),
        3,
    ):
        for step in (client.step(bad), client.step(START, pose=bad), client.step(START, twist=bad)):
            assert step.fresh
            assert step.status == "invalid", bad
            assert not step.twist.any()
    for more in (
        {"dt": "x"},
        {"dt": 10**400},
        {"age": 10**400},
        {"age": None},
        {"dt": np.nan},
        {"age": -5},
        {"observed": [2] * 32},
    ):
        assert client.step(START, **more).status == "invalid", more


def test_it_does_not_move_a_robot_that_nobody_reported(client: Client) -> None:
    assert client.waits
    step = client.step(START)
    assert not step.fresh
    assert not step.twist.any()
    assert "reset()" in step.reason
    client.reset()
    assert client.step(START).fresh
    assert not client.waits


def test_it_takes_over_by_the_measured_twist(client: Client, stepper: Stepper) -> None:
    twist = np.array([0.05, 0, -0.05, 0, 0.1, 0])
    with pytest.raises(ergoqp.errors.InputError, match="twist"):
        client.reset(twist=[1, 2, np.nan, 0, 0, 0])
    client.reset(twist)
    stepper.reset(twist)
    found = client.step(START).twist
    np.testing.assert_array_equal(found, stepper.step(START, twist=twist).twist)


def test_after_a_pause_it_asks_what_the_robot_did(client: Client) -> None:
    """A robot with a timeout ramps down by itself then, and a twist of the stop would be a jump."""
    client.reset()
    for _ in range(5):
        step = client.step(START)
        assert step.send
    time.sleep(0.2)
    for _ in range(3):
        step = client.step(START)
        assert not step.fresh
        assert not step.send
        assert "passed between two twists" in step.reason
        assert client.waits
    client.reset()
    step = client.step(START)
    assert step.fresh
    assert step.send


def test_a_loop_has_one_commander(service: Running, client: Client) -> None:
    client.reset()
    assert client.step(START).fresh
    with service.client() as second:
        second.reset()
        step = second.step(START)
        assert not step.fresh
        assert not step.twist.any()
        assert f"commanded by process {os.getpid()}" in step.reason
        assert client.step(START).fresh
        client.close()
        until = time.monotonic() + 5
        while not second.step(START).fresh:
            assert time.monotonic() < until


def test_what_is_not_there_is_said(tmp_path: Path, service: Running) -> None:
    with pytest.raises(ServiceError, match=r"nobody answers at '.*/no.sock'; start `ergoqp serve`"):
        Client(tmp_path / "no.sock")
    with pytest.raises(ergoqp.errors.InputError, match="dt"):
        service.client(dt=5.0)
    with (
        service.client() as client,
        pytest.raises(ergoqp.errors.InputError, match="started without"),
    ):
        client.guide(np.eye(4))


def moving(client: Client, stepper: Stepper) -> np.ndarray:
    """Step until the object moves; return the posture."""
    client.reset()
    stepper.reset()
    posture = START.copy()
    for _ in range(25):
        step = client.step(posture)
        stepper.step(posture)
        posture = posture + 0.01 * step.posture_rate
    assert np.abs(step.twist).max() > 0.02
    return posture


@pytest.fixture
def own_service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    with running(tmp_path_factory.mktemp("s"), "screwing", "--interpreted") as found:
        yield found


@pytest.mark.slow
def test_a_worker_that_hangs_or_dies_leaves_the_certified_stop(
    own_service: Running, stepper: Stepper
) -> None:
    stepper.warm_up()
    for number in (signal.SIGSTOP, signal.SIGKILL):
        client = own_service.client(timeout=0.2)
        posture = moving(client, stepper)
        expected, pid = stepper.stop(), client.description["health"]["pid"]
        os.kill(pid, number)
        client._longest = 60.0  # the machine of a test may be slow
        client.timeout = 0.005
        for twist in expected:
            step = client.step(posture)
            assert (step.fresh, step.status) == (False, "braking")
            np.testing.assert_array_equal(step.twist, twist)
        assert not client.step(posture).twist.any()
        if number == signal.SIGSTOP:
            # It goes on from what the robot executed: the whole stop.
            os.kill(pid, signal.SIGCONT)
            until = time.monotonic() + 20
            while not (step := client.step(posture)).fresh:
                assert time.monotonic() < until
                assert not step.twist.any()
            assert step.status != "braking"
        else:
            # Another worker knows nothing of the robot.
            until = time.monotonic() + 20
            while not client.waits:
                assert time.monotonic() < until
                assert not client.step(posture).twist.any()
                time.sleep(0.01)
            client.timeout = 1.0
            client.reset()
            assert client.step(posture).fresh
        client.close()


@contextlib.contextmanager
def lying(path: Path, answer: Callable[[bytes], bytes | None], client: Client) -> Iterator[None]:
    """A server that answers as it is told; ``client`` gets it in place of its service."""
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    listener.bind(str(path))
    listener.listen(4)
    listener.settimeout(0.1)
    ended = threading.Event()

    def serve() -> None:
        while not ended.is_set():
            try:
                connection, _ = listener.accept()
            except TimeoutError:
                continue
            with connection:
                connection.settimeout(0.1)
                converse(connection)

    def converse(connection: socket.socket) -> None:
        while not ended.is_set():
            try:
                asked = connection.recv(65536)
                told = answer(asked) if asked else None
                if told is None:
                    return
                connection.sendall(told)
            except TimeoutError:
                continue
            except OSError:
                return

    thread = threading.Thread(target=serve)
    thread.start()
    client.close()
    client._service.path = str(path)
    try:
        yield
    finally:
        ended.set()
        thread.join()
        listener.close()


def truth(client: Client, asked: bytes) -> bytearray:
    """An answer that a client takes, with the twist 0.1."""
    n, rows = len(client.description["coordinates"]), len(client.description["rows"])
    layout = answer_frame(n, rows)
    frame = bytearray(layout.length)
    sequence = HEAD.unpack_from(asked)[4]
    ANSWER_HEAD.pack_into(
        frame, 0, len(frame), 1, Tell.step, 77, sequence, 0, 0, 0, 0, 0, 0, n, rows, 1, 0.0
    )
    layout.numbers(frame, "twist")[:] = 0.1
    layout.numbers(frame, "times")[0] = 0.01
    return frame


def with_twist(frame: bytearray, client: Client, value: float) -> bytes:
    n, rows = len(client.description["coordinates"]), len(client.description["rows"])
    answer_frame(n, rows).numbers(frame, "twist")[2] = value
    return bytes(frame)


@pytest.mark.parametrize(
    "lie",
    [
        lambda c, a: os.urandom(500),
        lambda c, a: b"HTTP/1.1 200 OK\r\n\r\n",
        lambda c, a: b"",
        lambda c, a: None,
        lambda c, a: bytes(truth(c, a))[:-9],
        lambda c, a: b"more" + bytes(truth(c, a)),
        lambda c, a: with_twist(truth(c, a), c, np.nan),
        lambda c, a: with_twist(truth(c, a), c, np.inf),
        lambda c, a: HEAD.pack(1 << 31, 1, 2, 77, 1),
        lambda c, a: HEAD.pack(3, 1, 2, 77, 1),
        lambda c, a: truth(c, a).replace(b"\x01\x00\x02\x00", b"\x09\x00\x02\x00", 1),
        lambda c, a: note(Tell.refused, HEAD.unpack_from(a)[4], "no"),
        lambda c, a: note(Tell.unknown, HEAD.unpack_from(a)[4], "who?"),
        lambda c, a: note(Tell.described, HEAD.unpack_from(a)[4], "{}"),
        lambda c, a: bytes(truth(c, HEAD.pack(24, 1, 2, 0, 12345))),
        lambda c, a: truth(c, a).replace(b"\x01\x00\x02\x00", b"\x01\x00\x04\x00", 1),
    ],
)
def test_an_answer_that_is_none_moves_nothing(
    service: Running, tmp_path: Path, lie: Callable[[Client, bytes], bytes | None]
) -> None:
    client = service.client()
    client.timeout = 0.1
    with lying(tmp_path / "l", lambda asked: lie(client, asked), client):
        for _ in range(3):
            client.reset()
            step: ClientStep = client.step(START)
            assert not step.fresh
            assert not step.twist.any()
            assert step.reason
    client.close()


def test_what_comes_behind_an_answer_is_never_taken_for_the_next(
    service: Running, tmp_path: Path
) -> None:
    for more in (1, 3):
        client = service.client()
        client.timeout, client._longest = 0.5, 60.0
        with lying(
            tmp_path / str(more), lambda a, c=client, k=more: bytes(truth(c, a)) * (1 + k), client
        ):
            client.reset()
            assert client.step(START).fresh
            assert not client.step(START).fresh
            assert client.refused == 1
        client.close()


def test_a_late_answer_is_never_taken_for_the_next(service: Running, tmp_path: Path) -> None:
    client, delays = service.client(), iter([0.0, 0.3, 0.0, 0.0, 0.0])

    def slow(asked: bytes) -> bytes:
        time.sleep(next(delays))
        return bytes(truth(client, asked))

    client.timeout = client._longest = 0.1
    with lying(tmp_path / "l", slow, client):
        client.reset()
        assert client.step(START).fresh
        client._longest = 60.0
        late = client.step(START)
        assert not late.fresh
        assert client.late == 1
        assert client._service.outstanding == 2
        np.testing.assert_array_equal(late.twist, 0.0)  # the only knot of its stop
        time.sleep(0.4)
        step = client.step(START)
        assert step.fresh
        assert (client._acted, client._sequence, client._followed) == (3, 3, 0)
        said = REQUEST_HEAD.unpack_from(client._request)
        assert (said[5], said[7]) == (1, 1)  # it acted on the first answer, and one period more
    client.close()


# ------------------------------------------------------------------------------ what is executed


def told(asked: bytes, **more: Any) -> bytes:
    """An answer that the client takes: a twist, and a stop of equal steps."""
    return bytes(step_answer(asked, rows=len(PROBLEM.row_names), **more))


def said(asked: bytes) -> tuple[int, int, int, int]:
    """Session, sequence, acted and followed of a request."""
    head = REQUEST_HEAD.unpack_from(asked)
    return (*head[3:6], head[7])


@pytest.fixture
def fake(tmp_path: Path) -> Iterator[Fake]:
    """A server whose stop has ten knots."""
    found = Fake(tmp_path / "f", lambda asked: told(asked, knots=10))
    yield found
    found.end()


@pytest.fixture
def faked(service: Running, fake: Fake) -> Iterator[Client]:
    """A client of it, for which no pause is long."""
    with service.client() as found:
        found._service.path, found._longest = str(fake.path), 60.0
        yield found


def test_a_faster_robot_is_led_along_straight_lines(fake: Fake, faked: Client) -> None:
    fake.answer = lambda asked: told(asked, knots=4)
    faked.reset()
    assert faked.step(START).fresh
    for seconds, share in (
        (-1.0, 0.0),
        (0.0, 0.0),
        (0.0025, 0.25),
        (0.01, 1.0),
        (0.015, 0.875),
        (0.02, 0.75),
        (0.05, 0.0),
        (9.0, 0.0),
        (0.005, 0.5),
    ):
        np.testing.assert_allclose(faked.twist_at(seconds), 0.1 * share, atol=1e-15)
    # The next line begins where the last one had come to.
    fake.answer = lambda asked: told(asked, twist=-0.1, knots=4)
    assert faked.step(START).fresh
    for seconds, twist in ((0.0, 0.05), (0.005, -0.025), (0.01, -0.1)):
        np.testing.assert_allclose(faked.twist_at(seconds), twist, atol=1e-15)
    # Without an answer it leads along the stop.
    fake.answer = lambda asked: None
    assert not faked.step(START).fresh
    for seconds, twist in ((0.0, -0.1), (0.005, -0.0875), (0.01, -0.075), (0.02, -0.05)):
        np.testing.assert_allclose(faked.twist_at(seconds), twist, atol=1e-15)
    faked.reset()
    assert not faked.twist_at(0.005).any()
    limit = np.array(faked.description["acceleration"])
    faked.reset(0.04 * limit)
    np.testing.assert_array_equal(faked.twist_at(0.0), 0.04 * limit)


def test_reset_drops_the_stop(fake: Fake, faked: Client) -> None:
    faked.reset()
    assert faked.step(START).fresh
    assert len(faked.stop()) == 10
    fake.answer = lambda asked: None
    assert faked.step(START).twist.any()
    faked.reset()  # the robot stands: no stop of before may move it
    for _ in range(2):
        assert not faked.step(START).twist.any()
        assert not faked.stop().any()


def test_a_motion_that_is_taken_over_ramps_down_until_it_is_answered(
    fake: Fake, faked: Client
) -> None:
    fake.answer = lambda asked: None
    limit = np.array(faked.description["acceleration"])
    twist = limit * 0.04 * [-1, 0.5, 0, 0, 0.25, 0]
    measured = twist.copy()
    faked.reset(measured)
    measured[:] = 9.0
    np.testing.assert_allclose(faked.stop()[:, 0], twist[0] * np.array([0.75, 0.5, 0.25, 0]))
    for share in (0.75, 0.5, 0.25, 0.0, 0.0):
        np.testing.assert_allclose(faked.step(START).twist, share * twist, atol=1e-15)
    # Every request says what the robot was sent meanwhile.
    layout = request_frame(32)
    sent = [layout.numbers(each, "twist")[0] / twist[0] for each in fake.requests]
    np.testing.assert_allclose(sent, [1.0, 0.75, 0.5, 0.25, 0.0], atol=1e-12)
    taken = Flag.takes_over | Flag.twist
    assert all(REQUEST_HEAD.unpack_from(each)[8] & taken == taken for each in fake.requests)
    # The service takes over in the middle of the ramp.
    faked.reset(twist)
    assert not faked.step(START).fresh
    fake.answer = lambda asked: told(asked, twist=0.75 * twist)
    step = faked.step(START, twist=twist)
    assert step.fresh
    np.testing.assert_allclose(layout.numbers(fake.requests[-1], "twist"), 0.75 * twist)
    # A small motion is at rest within one period, and so is an axis that has no limit.
    fake.answer = lambda asked: None
    faked._acceleration[1] = 0.0
    faked.reset([0, 0.001, 0, 0, 0, 0])
    assert not faked.step(START).twist.any()


def test_a_motion_that_was_measured_long_ago_is_not_taken_over(fake: Fake, faked: Client) -> None:
    twist = np.array(faked.description["acceleration"]) * 0.2
    faked._longest = 0.05
    faked.reset(twist)
    time.sleep(0.1)
    step = faked.step(START)
    assert "passed between two twists" in step.reason
    assert not step.fresh
    assert faked.waits
    assert not fake.requests
    assert 0 < step.twist[0] <= 0.51 * twist[0]
    # Standing has no time.
    faked.reset()
    time.sleep(0.1)
    assert faked.step(START).fresh


def test_after_a_pause_the_stop_has_gone_on(fake: Fake, faked: Client) -> None:
    fake.answer = lambda asked: told(asked, knots=50, dt=0.02)
    faked._longest = 0.2
    faked.reset()
    assert faked.step(START).fresh
    time.sleep(0.4)
    step = faked.step(START)
    passed = float(step.reason.split()[0])  # two decimals of it are said
    assert "passed between two twists" in step.reason
    np.testing.assert_allclose(step.twist, 0.1 * (1 - passed), atol=0.0006)
    following = faked.step(START)
    np.testing.assert_allclose(following.twist, step.twist - 0.001)
    assert faked.waits
    assert len(fake.requests) == 1
    # A period that was executed before counts once.
    faked.reset()
    assert faked.step(START).fresh
    fake.answer = lambda asked: None
    for _ in range(10):
        faked.step(START)
    time.sleep(0.3)
    step = faked.step(START)
    passed = float(step.reason.split()[0])
    np.testing.assert_allclose(step.twist, 0.1 * (0.9 - passed), atol=0.0006)


def test_a_program_that_stopped_while_it_waited_has_paused(fake: Fake, faked: Client) -> None:
    faked._longest, faked.timeout = 0.1, 2.0

    def slow(asked: bytes) -> bytes:
        time.sleep(0.15)
        return told(asked, knots=50, dt=0.02)

    fake.answer = slow
    faked.reset()
    assert faked.step(START).fresh  # it stood meanwhile
    faked._returned = time.perf_counter() - 0.05
    step = faked.step(START)
    assert not step.fresh
    assert "passed between two twists" in step.reason
    assert 0.06 < step.twist[0] < 0.0801
    assert faked.waits
    assert not step.send
    # It has paused as well if no answer is there then.
    fake.answer = lambda asked: told(asked, knots=50, dt=0.02)
    faked.reset()
    assert faked.step(START).send
    fake.answer, faked.timeout = lambda asked: time.sleep(0.3), 0.15
    step = faked.step(START)
    assert not step.fresh
    assert not step.send
    assert "passed between two twists" in step.reason
    assert faked.waits


def test_a_pause_is_measured_from_twist_to_twist(fake: Fake, faked: Client) -> None:
    faked._longest, faked.timeout = 0.1, 2.0
    faked.reset()
    assert faked.step(START).send
    time.sleep(0.065)

    def slow(asked: bytes) -> bytes:
        time.sleep(0.065)
        return told(asked, knots=10)

    fake.answer = slow
    step = faked.step(START)
    assert not step.fresh
    assert not step.send
    assert "passed between two twists" in step.reason


def test_without_a_session_the_stop_goes_on_in_a_pause(fake: Fake, faked: Client) -> None:
    fake.answer = lambda asked: told(asked, knots=50)
    faked._longest = 0.1
    faked.reset()
    assert faked.step(START).fresh
    fake.answer = lambda asked: note(Tell.unknown, HEAD.unpack_from(asked)[4], "who?")
    step = faked.step(START)
    assert step.send
    np.testing.assert_allclose(step.twist, 0.098)
    for number in (1, 2):
        time.sleep(0.2)
        step = faked.step(START)
        assert not step.send
        assert step.twist[0] < 0.1 - 0.04 * number + 0.0021
    time.sleep(0.3)
    assert not faked.step(START).twist.any()
    # Then it stands, and may do so for any time.
    faked.reset()
    fake.answer = lambda asked: told(asked, knots=50)
    assert faked.step(START).send


def test_who_asks_and_leaves_ends_nothing(service: Running) -> None:
    pid = service.worker()
    for _ in range(5):
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as other:
            other.connect(str(service.socket()))
            other.send(HEAD.pack(HEAD.size, 1, Ask.describe, 0, 1))
    time.sleep(0.2)
    assert service.worker() == pid


@pytest.mark.parametrize("command", ["makes no library", "is no program", "fast"])
def test_a_compiler_that_is_of_no_use_is_not_needed(
    service: Running,
    fake: Fake,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    command: str,
) -> None:
    made = tmp_path / "cc"
    made.write_text(
        {
            "makes no library": "#!/bin/sh\nfor out; do :; done\n[ $# = 1 ] || echo none > $out\n",
            "is no program": "none\n",
            "fast": '#!/bin/sh\nexec cc -ffast-math "$@"\n',
        }[command]
    )
    made.chmod(0o755)
    monkeypatch.setenv("CC", str(made))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    compiler.cache_clear()
    try:
        client = service.client()
    finally:
        compiler.cache_clear()
    with client:
        client.reset()
        assert client.step(START).fresh
        client.close()
        client._service.path = str(fake.path)
        client.reset()
        for wrong in (np.nan, np.inf):
            fake.answer = lambda asked, wrong=wrong: told(asked, stop=wrong)
            assert not client.step(START).fresh


def test_a_request_that_cannot_be_sent_is_not_waited_for(fake: Fake, faked: Client) -> None:
    faked.timeout = 1.0
    faked.reset()
    assert faked.step(START).fresh
    full, fake.answer = faked._service.socket, lambda asked: time.sleep(0.5)
    assert full is not None
    with contextlib.suppress(BlockingIOError):
        while full.send(bytes(4096)):
            pass
    step = faked.step(START)
    assert step.reason == "service: the connection was lost"
    assert step.solve_time < 0.4


def test_after_a_signal_that_ends_a_call_it_goes_on(fake: Fake, faked: Client) -> None:
    faked.timeout = 2.0
    faked.reset()
    assert faked.step(START).fresh
    slow = [0.3]

    def answer(asked: bytes) -> bytes:
        time.sleep(slow.pop() if slow else 0.0)
        return told(asked, knots=10)

    def interrupted(*_: Any) -> None:
        raise KeyboardInterrupt

    fake.answer = answer
    before = signal.signal(signal.SIGALRM, interrupted)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.1)
        with pytest.raises(KeyboardInterrupt):
            faked.step(START)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    time.sleep(0.3)
    assert any(faked.step(START).fresh for _ in range(3))


@pytest.mark.parametrize(
    ("periods", "shares", "followed"),
    [
        ((1, 1, 1), (0.9, 0.8, 0.7), (1, 2, 3)),
        ((2, 2, 1), (0.8, 0.6, 0.5), (2, 4, 5)),
        ((0.5, 0.5, 0.5), (0.95, 0.9, 0.85), (1, 1, 2)),
        ((0.25, 1.5, 1.5), (0.975, 0.825, 0.675), (0, 2, 3)),
        ((np.nan, -1, np.inf), (0.9, 0.8, 0.7), (1, 2, 3)),
    ],
)
def test_the_stop_is_followed_in_its_own_periods(
    fake: Fake,
    faked: Client,
    periods: tuple[float, ...],
    shares: tuple[float, ...],
    followed: tuple[int, ...],
) -> None:
    usual = fake.answer
    for count in range(1, len(periods) + 1):
        faked.reset()
        assert faked.step(START).fresh
        fake.answer = lambda asked: None
        for period, share in zip(periods[:count], shares, strict=False):
            step = faked.step(START, dt=0.01 * period)
            np.testing.assert_allclose(step.twist, 0.1 * share, atol=1e-15)
        fake.answer = usual
        acted = faked._acted
        assert faked.step(START).fresh
        assert said(fake.requests[-1])[2:] == (acted, followed[count - 1])


def test_a_stop_has_the_periods_of_its_own_step(fake: Fake, faked: Client) -> None:
    for dt, lasts in ((0.02, 0.02), (0.005, 0.005), (np.nan, 0.01), ("x", 0.01), (1e9, 0.01)):
        faked.reset()
        fake.answer = lambda asked, lasts=lasts: told(asked, knots=10, dt=lasts)
        step = faked.step(START, dt=dt)  # type: ignore[arg-type]
        assert step.fresh
        np.testing.assert_allclose(faked.stop()[:, 0], 0.1 * np.arange(9, -1, -1) / 10, atol=1e-15)
        fake.answer = lambda asked: None
        step = faked.step(START, dt=0.01)
        np.testing.assert_allclose(step.twist, 0.1 * (1 - 0.001 / lasts), atol=1e-15)


def test_try_again_is_said_until_it_is_answered(fake: Fake, faked: Client) -> None:
    faked.reset()
    faked.try_again()
    usual, fake.answer = fake.answer, lambda asked: None
    for answer in (usual, usual, usual):
        faked.step(START)
        fake.answer = answer
    flags = [bool(REQUEST_HEAD.unpack_from(each)[8] & Flag.try_again) for each in fake.requests]
    assert flags == [True, True, False]


def put(asked: bytes, place: int, value: bytes) -> bytes:
    """An answer with other bytes at a place of its head."""
    frame = bytearray(told(asked))
    frame[place : place + len(value)] = value
    return bytes(frame)


WRONG: list[tuple[Callable[[bytes], bytes], str]] = [
    (lambda a: put(a, 28, b"\x06"), "of status 6, which is unknown"),
    (lambda a: told(a, stop=1e200), "with twists that are no numbers"),
    (lambda a: told(a, knots=1, stop=5e-324), "with a stop that does not end at rest"),
    (lambda a: told(a, knots=65), "of 65 knots, allowed 64"),
    (lambda a: told(a, times=-0.01), "with a stop whose times do not grow"),
    (lambda a: told(a, times=0.0), "with a stop whose times do not grow"),
    (lambda a: told(a, times=0.02), "with a stop whose times do not grow"),
    (lambda a: told(a, times=np.nan), "with twists that are no numbers"),
    (lambda a: told(a, stop=np.inf), "with twists that are no numbers"),
    (lambda a: told(a, posture_rate=np.nan), "with twists that are no numbers"),
    (lambda a: told(a, knots=1, stop=0.05), "with a stop that does not end at rest"),
    (lambda a: told(a, knots=65, stop=1.0), "of 65 knots, allowed 64"),
    (lambda a: put(a, 16, bytes(8)), "to another question"),
    (lambda a: put(a, 0, b"\x18\0\0\0"), "to another question"),
    (lambda a: note(Tell.refused, HEAD.unpack_from(a)[4], "no") + b"more", "to another question"),
    (lambda a: put(a, 4, b"\x09"), "of version 9, allowed 1"),
    (lambda a: HEAD.pack(24, 1, Tell.step, 77, HEAD.unpack_from(a)[4]), "of another length"),
    (lambda a: bytes(step_answer(a, rows=3)), "of another length"),
    (lambda a: bytes(step_answer(a, rows=200)), "that is too long"),
]


@pytest.mark.parametrize(("lie", "words"), WRONG)
def test_an_answer_that_cannot_be_executed_is_refused_by_name(
    fake: Fake, faked: Client, lie: Callable[[bytes], bytes], words: str
) -> None:
    faked.reset()
    assert faked.step(START).fresh
    fake.answer = lie
    for share in (0.9, 0.8):
        step = faked.step(START)
        assert step.reason == f"service: an answer {words}"
        np.testing.assert_allclose(step.twist, 0.1 * share)
    assert faked.refused == 2
    # Shorter stops of the same times, and stops of others, are taken.
    for knots, dt in ((10, 0.01), (4, 0.01), (20, 0.01), (64, 0.01), (64, 0.007), (0, 0.01)):
        fake.answer = lambda asked, knots=knots, dt=dt: told(asked, knots=knots, dt=dt)
        step = faked.step(START)
        assert step.fresh, step.reason
    assert not faked.stop().any()


def test_times_that_grow_no_longer_behind_the_last_knots_are_seen(
    fake: Fake, faked: Client
) -> None:
    def answer(asked: bytes, knots: int) -> bytes:
        frame = step_answer(asked, rows=len(PROBLEM.row_names), knots=knots)
        answer_frame(32, len(PROBLEM.row_names)).numbers(frame, "times")[:] = [
            *(0.01, 0.02, 0.03, 0.03),
            *(60 * [0.0]),
        ]
        return bytes(frame)

    faked.reset()
    for knots, fresh in ((3, True), (2, True), (3, True), (4, False), (3, True), (5, False)):
        fake.answer = lambda asked, knots=knots: answer(asked, knots)
        assert faked.step(START).fresh == fresh, knots


def test_a_client_that_was_closed_waits(fake: Fake, faked: Client) -> None:
    faked.reset()
    assert faked.step(START).fresh
    faked.close()
    assert faked.waits
    assert not faked.step(START).fresh
    assert len(fake.requests) == 1
