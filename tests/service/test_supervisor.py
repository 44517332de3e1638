"""The processes of the service: who ends with whom, who is replaced, whose sockets these are."""

from __future__ import annotations

import contextlib
import os
import resource
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from service_running import Running, running

import ergoqp
from ergoqp.cli.main import execute
from ergoqp.errors import InputError
from ergoqp.service import supervisor as module
from ergoqp.service.client import Client
from ergoqp.service.folder import private_folder, socket_path
from ergoqp.service.schema import REQUEST_HEAD, VERSION, Ask, Flag, request_frame
from ergoqp.service.served import served
from ergoqp.service.supervisor import Job, Supervisor
from ergoqp.service.worker import Worker

START = np.array(ergoqp.load_problem("screwing").response.comfort)


@pytest.fixture
def own() -> Iterator[Running]:
    with (
        tempfile.TemporaryDirectory(prefix="eqp") as folder,
        running(Path(folder) / "s", "screwing", "--interpreted") as found,
    ):
        yield found


def lives(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def wait_for(condition, seconds: float = 20.0) -> None:
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.01)


@pytest.mark.slow
def test_a_killed_worker_is_replaced_at_the_same_socket(own: Running) -> None:
    client = own.client(timeout=2.0)
    client.reset()
    assert client.step(START).fresh
    old = client.description["health"]["pid"]
    os.kill(old, signal.SIGKILL)
    wait_for(lambda: own.worker() != old)
    assert "ended after" in own.log.read_text()
    assert "by signal 9, and is started again" in own.log.read_text()
    client.reset()
    client.step(START)  # it finds that the connection is lost
    client.reset()
    wait_for(lambda: client.step(START).fresh)
    client.close()


@pytest.mark.slow
def test_a_stopped_supervisor_does_not_touch_the_loops_and_a_killed_one_ends_them(
    own: Running,
) -> None:
    client = own.client(timeout=2.0)
    worker = client.description["health"]["pid"]
    client.reset()
    os.kill(own.process.pid, signal.SIGSTOP)
    for _ in range(50):
        assert client.step(START).fresh
    os.kill(own.process.pid, signal.SIGCONT)
    own.process.kill()
    own.process.wait(20)
    wait_for(lambda: not lives(worker))
    assert not client.step(START).fresh
    client.close()
    # Another one takes the same folder, whose sockets and locks were left behind.
    with running(own.folder, "screwing", "--interpreted") as again:
        found = again.client(timeout=2.0)
        found.reset()
        assert found.step(START).fresh
        found.close()


@pytest.mark.slow
def test_a_folder_has_each_loop_once(own: Running, capsys: pytest.CaptureFixture[str]) -> None:
    own.client().close()
    told = subprocess.run(
        [sys.executable, "-m", "ergoqp", "serve", "screwing", "--dir", str(own.folder)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert told.returncode == 2
    assert f"loop screwing: served by process {own.process.pid} in" in told.stderr
    assert own.client().description["loop"] == "screwing"


@pytest.mark.slow
def test_sockets_are_for_their_user_alone(own: Running) -> None:
    own.client().close()
    assert os.stat(own.folder).st_mode & 0o777 == 0o700
    for path in own.folder.iterdir():
        if path.name != "log":
            assert path.stat().st_mode & 0o177 == 0, path


def test_a_folder_that_others_can_enter_is_refused(tmp_path: Path) -> None:
    for mode in (0o755, 0o710, 0o701, 0o720):
        folder = tmp_path / f"{mode:o}"
        folder.mkdir()
        folder.chmod(mode)
        with pytest.raises(InputError, match="allowed a folder of this user that nobody else"):
            private_folder(folder)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="--dir"):
        private_folder(tmp_path / "file")
    real = tmp_path / "real"
    real.mkdir(mode=0o700)
    (tmp_path / "link").symlink_to(real)
    with pytest.raises(InputError, match="--dir"):
        private_folder(tmp_path / "link")
    made = private_folder(tmp_path / "new" / "s")
    assert made.stat().st_mode & 0o777 == 0o700
    with pytest.raises(InputError, match="longer than 107 bytes"):
        socket_path(tmp_path / ("x" * 100), "screwing")


@pytest.mark.skipif(os.getuid() != 0, reason="only root can give a folder away")
def test_a_folder_of_somebody_else_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "theirs"
    folder.mkdir(mode=0o700)
    os.chown(folder, 12345, 12345)
    with pytest.raises(InputError, match="allowed a folder of this user"):
        private_folder(folder)


@pytest.mark.skipif(os.getuid() != 0, reason="only root can be somebody else")
@pytest.mark.slow
def test_another_user_is_not_answered() -> None:
    """The service of a user refuses another one, even where the modes of the files let them in."""
    with (
        tempfile.TemporaryDirectory(prefix="eqp") as folder,
        running(Path(folder) / "s", "screwing", "--interpreted") as found,
    ):
        found.client().close()
        path = found.socket()
        for each in (Path(folder), found.folder, path):
            each.chmod(0o777)
        script = (
            "import os, socket, sys; os.setuid(12345); s = socket.socket(socket.AF_UNIX);"
            "s.settimeout(20); s.connect(sys.argv[1])\n"
            "try: s.send(bytes.fromhex(sys.argv[2])); told = s.recv(100)\n"
            "except (ConnectionResetError, BrokenPipeError): told = b''\n"
            "sys.exit(10 + (told == b''))"
        )
        asked = (24).to_bytes(4, "little") + b"\1\0\1\0" + bytes(16)
        done = subprocess.run([sys.executable, "-c", script, str(path), asked.hex()], check=False)
        assert done.returncode == 11


@pytest.mark.slow
def test_a_log_that_nobody_reads_ends_nothing() -> None:
    with tempfile.TemporaryDirectory(prefix="eqp") as folder:
        command = [sys.executable, "-m", "ergoqp", "serve", "screwing", "--interpreted"]
        process = subprocess.Popen([*command, "--dir", f"{folder}/s"], stderr=subprocess.PIPE)
        assert process.stderr is not None
        try:
            assert b"loop screwing at" in process.stderr.readline()
            process.stderr.close()
            path = Path(folder) / "s" / "screwing.sock"

            def worker() -> int:
                with Client(path) as client:
                    return client.description["health"]["pid"]

            old = worker()
            os.kill(old, signal.SIGKILL)
            wait_for(lambda: worker() != old)
            assert process.poll() is None
        finally:
            process.terminate()
            assert process.wait(20) == 0
        assert sorted(each.name for each in (Path(folder) / "s").iterdir()) == []


def test_a_lock_that_cannot_be_made_has_a_sentence(tmp_path: Path) -> None:
    folder = private_folder(tmp_path / "s")
    (folder / "screwing.lock").symlink_to(tmp_path)
    with pytest.raises(InputError, match=r"loop screwing: cannot make '.*screwing.lock'"):
        Supervisor([served("screwing")], folder, 1)


def test_without_a_descriptor_left_a_connection_is_turned_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Otherwise it would wake the worker for ever."""
    with tempfile.TemporaryDirectory(prefix="eqp") as folder:
        listener = socket.socket(socket.AF_UNIX)
        listener.bind(f"{folder}/x")
        listener.listen(4)
        problem = served("screwing")
        worker = Worker(problem.loops(), {"screwing": listener}, {"screwing": "{}"})
        client = socket.socket(socket.AF_UNIX)
        client.connect(f"{folder}/x")
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        used = max(int(name) for name in os.listdir("/proc/self/fd")) + 1
        free = [os.open(os.devnull, os.O_RDONLY) for _ in range(3)]
        try:
            resource.setrlimit(resource.RLIMIT_NOFILE, (max([used, *free]) + 1, hard))
            more = []
            with contextlib.suppress(OSError):
                while True:
                    more.append(os.open(os.devnull, os.O_RDONLY))
            worker._accept(listener, worker._loops["screwing"])
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
            for each in (*free, *more):
                os.close(each)
        client.settimeout(5)
        assert client.recv(10) == b""
        client.close()
        listener.close()
        worker._poll.close()


def test_a_loop_that_was_left_moves_until_its_stop_is_over(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    problem = served("screwing")
    worker = Worker(problem.loops(), {}, {})
    loop = worker._loops["screwing"]
    now = [1000.0]
    monkeypatch.setattr("ergoqp.service.worker.time.monotonic", lambda: now[0])
    assert worker.idle
    loop.moved = True
    worker._left["screwing"] = now[0]
    assert not worker.idle
    now[0] += problem.problem.stop.duration + 1.0
    assert not worker.idle
    now[0] += 1.5
    assert worker.idle
    worker._commanders["screwing"] = object()  # type: ignore[assignment]
    assert not worker.idle
    worker._poll.close()


def test_a_worker_that_hangs_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "HANGS", 0.2)
    killed = []
    monkeypatch.setattr(module.os, "kill", lambda pid, number: killed.append((pid, number)))
    found = Supervisor([served("screwing")], private_folder(tmp_path / "s"), 1)
    try:
        [job] = [each for each in found.jobs if each.worker is not None]
        job.pid, job.began = 4242, time.monotonic()
        found._replace_what_hangs()
        assert not killed
        for beat in range(1, 8):  # it goes round its loop
            time.sleep(0.05)
            found._beats[0] = beat
            found._replace_what_hangs()
        for _ in range(2):
            time.sleep(0.05)
            found._replace_what_hangs()
        assert not killed
        time.sleep(0.05)
        found._replace_what_hangs()
        time.sleep(0.05)
        found._replace_what_hangs()
        time.sleep(0.05)
        found._replace_what_hangs()
        assert killed == [(4242, signal.SIGKILL)]
        # The supervisor was stopped too, as by Ctrl-Z: nobody hung.
        time.sleep(0.5)
        found._replace_what_hangs()
        assert len(killed) == 1
        job.pid = 0
    finally:
        found._end_all()


def test_a_process_that_dies_at_once_is_started_again_ever_more_slowly() -> None:
    waits = module._PATIENCE
    assert waits[0] == 0.0
    assert list(waits) == sorted(waits)
    assert waits[-1] >= 1.0
    assert Job("x", lambda: None).young == 0


@pytest.mark.slow
def test_the_compiled_step_is_taken_when_nobody_uses_the_loop() -> None:
    with (
        tempfile.TemporaryDirectory(prefix="eqp") as folder,
        running(Path(folder) / "s", "screwing") as found,
    ):
        client = found.client(timeout=5.0)
        assert client.description["engine"] == "interpreted"
        client.reset()
        until = time.monotonic() + 3
        while time.monotonic() < until:
            # While somebody commands the loop, its worker stays.
            step = client.step(START)
            if not step.fresh:
                client.reset()
        first = client.description["health"]["pid"]
        assert found.worker() == first
        client.hold()
        for _ in range(100):
            client.step(START)
        client.close()

        def is_compiled() -> bool:
            with found.client() as other:
                return other.description["engine"] == "compiled"

        wait_for(is_compiled, 90)
        with found.client(timeout=5.0) as other:
            other.reset()
            assert other.step(START).fresh


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "PROBLEM: got none, allowed one or more"),
        (["nothing"], "problem: got 'nothing', allowed"),
        (["screwing", "screwing"], "PROBLEM: got screwing twice"),
        (["screwing", "--loops", "0"], "--loops: got 0, allowed 1 to 256"),
        (["screwing", "--workers", "65"], "--workers: got 65, allowed 1 to 64"),
        (["screwing", "--fifo", "100"], "--fifo: got 100, allowed 1 to 99"),
        (["screwing", "--dt", "7"], "dt"),
    ],
)
def test_mistakes_have_one_sentence(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert execute(["serve", *arguments]) == 2
    told = capsys.readouterr().err
    assert words in told
    assert told.count("\n") == 1


def test_who_is_not_answered_does_not_command(service: Running) -> None:
    """A request of an unknown session moves nothing, and keeps nobody from the loop."""
    frame = bytearray(request_frame(len(START)).length)
    flags, n = int(Flag.frame | Flag.enable), len(START)
    REQUEST_HEAD.pack_into(
        frame, 0, len(frame), VERSION, Ask.step, 99, 1, 1, 0, 0, flags, n, 0, 0.0, 0.01
    )
    with socket.socket(socket.AF_UNIX) as stranger:
        stranger.settimeout(5)
        stranger.connect(str(service.socket()))
        stranger.sendall(frame)
        assert b"does not know what the robot does" in stranger.recv(1000)
        with service.client() as client:
            client.reset()
            assert client.step(START).fresh


def test_garbage_ends_its_connection_and_nothing_else(service: Running) -> None:
    with service.client() as client:
        client.reset()
        assert client.step(START).fresh
        rng = np.random.default_rng(0)
        for number in range(60):
            with socket.socket(socket.AF_UNIX) as other:
                other.settimeout(5)
                other.connect(str(service.socket()))
                kind = number % 4
                if kind == 0:
                    other.sendall(rng.bytes(int(rng.integers(1, 3000))))
                elif kind == 1:
                    other.sendall((1 << 30).to_bytes(4, "little") + b"\1\0\2\0" + bytes(16))
                    assert b"frame: got 1073741824 bytes" in other.recv(1000)
                elif kind == 2:
                    other.sendall((896).to_bytes(4, "little") + b"\7\0\2\0" + bytes(16))
                    assert b"version: got 7, allowed 1" in other.recv(1000)
                else:
                    other.sendall(bytes(10))  # and goes
            step = client.step(START)
            if not step.fresh:  # the machine was busy for longer than the robot may hold
                assert client.waits
                client.reset()
        client.hold()
        client.step(START)
