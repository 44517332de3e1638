"""The doors on loopback TCP: who may enter, and what a stranger's bytes do (nothing)."""

from __future__ import annotations

import http.client
import json
import socket
import stat
import struct
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import numpy as np
import pytest
from service_lines import COMFORT, Lines
from service_running import Running, running

from ergoqp.errors import InputError
from ergoqp.service import json_door
from ergoqp.service.json_door import MOST_CONNECTIONS, MOST_STRANGERS, STUCK, lines_from
from ergoqp.service.lines import LONGEST_LINE
from ergoqp.service.schema import HEAD, VERSION, Ask, Tell
from ergoqp.service.tcp import TOKEN_FILE, listen_tcp, read_port

CHROMIUM = Path("/usr/bin/chromium")
STEP = {"loop": "screwing", "posture": COMFORT, "standing": True}


class Door(Running):
    """A service with TCP."""

    port: int
    token: bytes


@pytest.fixture(scope="module")
def door() -> Iterator[Door]:
    """A service with the loops ``screwing`` and ``overhead``, and TCP at a free port."""
    arguments = ("screwing", "overhead", "--interpreted", "--tcp", "0")
    with (
        tempfile.TemporaryDirectory(prefix="eqp") as folder,
        running(Path(folder) / "s", *arguments) as found,
    ):
        found.client().close()
        Lines.by_unix(found.folder).close()
        found.port = int(found.log.read_text().partition("at port ")[2].partition(",")[0])
        found.token = (found.folder / TOKEN_FILE).read_bytes().strip()
        found.__class__ = Door
        yield found  # type: ignore[misc]
        log = found.log.read_text(errors="replace")
        assert "Traceback" not in log, log


def steps_of(door: Door) -> int:
    with Lines.by_unix(door.folder) as lines:
        return sum(each["steps"] for each in lines.ask(health={})["health"].values())


def enter(door: Door, words: bytes = b"json") -> Lines:
    lines = Lines.by_tcp(door.port)
    lines.send(door.token + b" " + words + b"\n")
    return lines


def ended(lines: Lines, parts: Iterable[bytes], pause: float = 0.0) -> bool:
    """Send parts; return whether the connection ended before all were sent."""
    try:
        for part in parts:
            lines.send(part)
            time.sleep(pause)
    except OSError:
        return True
    return False


def post(port: int, body: str, kind: str) -> bytes:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
    try:
        connection.request("POST", "/", body, {"Content-Type": kind})
        return connection.getresponse().read()
    finally:
        connection.close()


class TestToken:
    def test_the_file_is_private_and_new_at_every_start(self, door, tmp_path):
        path = door.folder / TOKEN_FILE
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        assert len(door.token) >= 43
        assert str(path) in door.log.read_text()
        assert door.token.decode() not in door.log.read_text()

    def test_json(self, door):
        with enter(door) as lines:
            answer = lines.ask(step=STEP, id=1)
            assert answer["id"] == 1
            assert len(answer["twist"]) == 6
            assert lines.ask(step={"posture": COMFORT, "followed": 1000})["sequence"] == 2

    def test_both_addresses(self, door):
        if not socket.has_ipv6 or "::1" not in Path("/proc/net/if_inet6").read_text():
            try:
                socket.create_connection(("::1", door.port), timeout=1).close()
            except OSError:
                pytest.skip("this machine has no IPv6")
        with Lines.by_tcp(door.port, "::1") as lines:
            lines.send(door.token + b" json\r\n")
            assert "health" in lines.ask(health={})

    def test_no_other_address(self, door):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.connect(("192.0.2.1", 9))
            except OSError:
                pytest.skip("this machine has no other address")
            address = probe.getsockname()[0]
        with pytest.raises(OSError):  # noqa: PT011
            socket.create_connection((address, door.port), timeout=2)

    @pytest.mark.parametrize(
        "first",
        [
            b"0" * 43 + b" json\n",
            b" json\n",
            b"json\n",
            b"\n",
            b'{"health": {}}\n',
            b"\xff\xfe\n",
            b"TOKEN",
        ],
    )
    def test_a_wrong_token_is_delayed_and_closed(self, door, first):
        if first == b"TOKEN":
            first = door.token[:-1] + b" json\n"
        before = steps_of(door)
        with Lines.by_tcp(door.port) as lines:
            begun = time.monotonic()
            lines.send(first + json.dumps({"step": STEP}).encode() + b"\n")
            answer = lines.read()
            assert time.monotonic() - begun > 0.9
            # The words may be lost, because the rest was not read; the connection has ended.
            assert answer is None or "not the token" in answer["error"]
            assert lines.read() is None
        assert steps_of(door) == before

    @pytest.mark.parametrize("words", [b"", b"JSON", b"door", b"door nothing", b"json json"])
    def test_a_wrong_door_is_named(self, door, words):
        with enter(door, words) as lines:
            answer = lines.read()
            assert answer is not None
            assert "door with screwing, overhead" in answer["error"]
            assert lines.read() is None

    @pytest.mark.parametrize("sent", [b"", b"x", b"TOKEN json"])
    def test_no_first_line_is_closed_soon(self, door, sent):
        with Lines.by_tcp(door.port) as lines:
            begun = time.monotonic()
            lines.send(sent.replace(b"TOKEN", door.token))
            assert lines.read() is None
            assert 1.5 < time.monotonic() - begun < 15

    def test_a_slow_first_line_is_closed_soon(self, door):
        with Lines.by_tcp(door.port) as lines:
            begun = time.monotonic()
            assert ended(lines, [bytes([byte]) for byte in door.token + b" json\n"], pause=0.2)
            assert time.monotonic() - begun < 15

    def test_a_long_first_line_is_closed_at_once(self, door):
        with Lines.by_tcp(door.port) as lines:
            begun = time.monotonic()
            lines.send(b"x" * 1000)
            assert lines.read() is None
            assert time.monotonic() - begun < 1.5


class TestBadLines:
    @pytest.mark.parametrize(
        "bad",
        [b"GET / HTTP/1.1\n", b"{}\n", b'{"step": {"posture": [1]}}\n', b'{"x": {}}\n', b"\n"],
    )
    def test_the_first_one_ends_the_connection(self, door, bad):
        before = steps_of(door)
        with enter(door) as lines:
            assert "health" in lines.ask(health={})
            lines.send(bad + json.dumps({"step": STEP}).encode() + b"\n")
            answer = lines.read()
            assert answer is not None
            assert set(answer) == {"error"}
            assert lines.read() is None
        assert steps_of(door) == before

    def test_a_long_one_too(self, door):
        with enter(door) as lines:
            assert ended(lines, [b"x" * 65536] * 200)
            answer = lines.read()
            assert answer is None or "bytes, allowed" in answer["error"]

    def test_what_a_loop_refuses_does_not(self, door):
        with enter(door) as lines:
            words = lines.ask(step={"loop": "screwing", "posture": COMFORT})["error"]
            assert "the first step needs a report" in words
            assert "twist" in lines.ask(step=STEP)


class TestFrames:
    def test_they_are_forwarded_unchanged(self, door):
        frame = HEAD.pack(HEAD.size, VERSION, Ask.describe, 0, 7)
        direct = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        direct.connect(str(door.socket("overhead")))
        with enter(door, b"door overhead") as lines, direct:
            lines.send(frame)
            direct.sendall(frame)
            by_tcp, by_unix = b"", b""
            while len(by_unix) < HEAD.size or len(by_unix) < HEAD.unpack_from(by_unix)[0]:
                by_unix += direct.recv(65536)
            while len(by_tcp) < len(by_unix):
                by_tcp += lines.socket.recv(65536)
            assert by_tcp == by_unix
            assert HEAD.unpack_from(by_tcp)[2:] == (Tell.described, 0, 7)

    def test_with_the_first_line_in_one_packet(self, door):
        frame = HEAD.pack(HEAD.size, VERSION, Ask.describe, 0, 7)
        with Lines.by_tcp(door.port) as lines:
            lines.send(door.token + b" door screwing\n" + frame)
            assert HEAD.unpack_from(lines.socket.recv(65536))[2] == Tell.described

    def test_a_frame_that_is_none_ends_the_connection(self, door):
        with enter(door, b"door screwing") as lines:
            lines.send(b"\xff" * 64)
            got = b""
            while more := lines.socket.recv(65536):
                got += more
            assert HEAD.unpack_from(got)[2] == Tell.refused

    def test_the_commander_is_named(self, door):
        with enter(door) as lines, Lines.by_unix(door.folder) as other:
            assert "twist" in lines.ask(step=STEP)
            port = lines.socket.getsockname()[1]
            words = other.ask(step=STEP)["error"]
            assert words == f"loop screwing: commanded by 127.0.0.1 port {port} (TCP) already"


class TestHttp:
    @pytest.mark.parametrize("kind", ["text/plain", "application/json"])
    def test_a_post_executes_nothing(self, door, kind):
        before = steps_of(door)
        line = json.dumps({"step": STEP})
        for body in (line, f"\n{line}\n", f"{'0' * 43} json\n{line}\n"):
            with pytest.raises((http.client.HTTPException, OSError)):
                post(door.port, body, kind)
        assert steps_of(door) == before

    @pytest.mark.slow
    @pytest.mark.skipif(not CHROMIUM.exists(), reason="Chromium is not installed")
    def test_a_page_of_another_origin_executes_nothing(self, door, tmp_path):
        other = HTTPServer(("127.0.0.1", 0), BaseHTTPRequestHandler)
        script = f"""<script>
        const line = {json.dumps(json.dumps({"step": STEP}))} + "\\n";
        const to = ["127.0.0.1:{door.port}", "localhost:{door.port}", "[::1]:{door.port}"];
        const send = (at, body) =>
            fetch(`http://${{at}}/`, {{method: "POST", mode: "no-cors", body}});
        Promise.allSettled([...to.flatMap(at => [send(at, line), send(at, "\\n" + line)]),
            send("127.0.0.1:{other.server_port}", line),
        ]).then(() => fetch("/done", {{method: "POST"}}));
        </script>"""
        done, arrived = threading.Event(), list[bytes]()

        class Page(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                self.send_response(200)
                self.send_header("Content-Type", "text/html")
                self.end_headers()
                self.wfile.write(script.encode())

            def do_POST(self) -> None:
                self.send_response(204)
                self.end_headers()
                done.set()

            def log_message(self, *_: object) -> None:
                pass

        class Other(Page):
            """A server that is not careful gets the line: the browser does send it."""

            def do_POST(self) -> None:
                arrived.append(self.rfile.read(int(self.headers["Content-Length"])))
                self.send_response(204)
                self.end_headers()

        other.RequestHandlerClass = Other
        before, log = steps_of(door), door.log.read_text()
        with HTTPServer(("127.0.0.1", 0), Page) as server, other:
            for each in (server, other):
                threading.Thread(target=each.serve_forever, daemon=True).start()
            browser = subprocess.Popen(
                [
                    str(CHROMIUM),
                    "--headless",
                    "--no-sandbox",
                    "--disable-gpu",
                    f"--user-data-dir={tmp_path}",
                    f"http://127.0.0.1:{server.server_port}/",
                ],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            try:
                if not done.wait(90):
                    pytest.skip("Chromium did not run the page within 90 s")
            finally:
                browser.terminate()
                browser.wait(20)
                server.shutdown()
                other.shutdown()
        assert arrived
        assert json.loads(arrived[0]) == {"step": STEP}
        assert steps_of(door) == before
        assert door.log.read_text() == log


class TestLimits:
    def test_connections(self, door):
        crowd = [Lines.by_unix(door.folder) for _ in range(MOST_CONNECTIONS)]
        try:
            for lines in crowd:
                assert "health" in lines.ask(health={"loop": "screwing"})
            with Lines.by_unix(door.folder) as late:
                answer = late.read()
                assert answer is not None
                assert f"allowed {MOST_CONNECTIONS}" not in crowd[0].ask(health={})
                assert str(MOST_CONNECTIONS) in answer["error"]
                assert late.read() is None
            # TCP has room of its own.
            with enter(door) as lines:
                assert "health" in lines.ask(health={})
        finally:
            for lines in crowd:
                lines.close()
        until = time.monotonic() + 20
        while True:
            with Lines.by_unix(door.folder) as lines:
                try:
                    lines.send(b'{"health": {}}\n')
                    if "health" in (lines.read() or {}):
                        break
                except OSError:
                    pass
            assert time.monotonic() < until

    def test_silent_ones_take_no_place(self, door):
        silent = [Lines.by_tcp(door.port) for _ in range(40)]
        entered = list[Lines]()
        try:
            for _ in range(20):
                silent += [Lines.by_tcp(door.port) for _ in range(3)]
                entered.append(enter(door))
                assert "health" in entered[-1].ask(health={"loop": "screwing"})
            # Those that have entered stay, and of the silent ones the last.
            assert all("health" in each.ask(health={"loop": "screwing"}) for each in entered)
            begun = time.monotonic()
            assert all(lines.read() is None for lines in silent[: -MOST_STRANGERS - 1])
            assert time.monotonic() - begun < 1
        finally:
            for lines in silent + entered:
                lines.close()

    def test_wrong_tokens_take_no_place(self, door):
        wrong = [Lines.by_tcp(door.port) for _ in range(40)]
        try:
            for lines in wrong:
                with suppress(OSError):
                    lines.send(b"0" * 43 + b" json\n")
            with enter(door) as lines:
                assert "health" in lines.ask(health={"loop": "screwing"})
        finally:
            for lines in wrong:
                lines.close()

    def test_connections_that_have_entered(self, door):
        crowd = list[Lines]()
        try:
            for _ in range(MOST_CONNECTIONS):
                crowd.append(enter(door))
                assert "health" in crowd[-1].ask(health={"loop": "screwing"})
            with enter(door) as late:
                answer = late.read()
                assert answer is not None
                assert f"more than {MOST_CONNECTIONS} connections" in answer["error"]
                assert late.read() is None
            assert "health" in crowd[0].ask(health={"loop": "screwing"})
        finally:
            for lines in crowd:
                lines.close()

    def test_a_long_line_is_skipped(self, door):
        with Lines.by_unix(door.folder) as lines:
            lines.send(b"[" + b" " * (3 * LONGEST_LINE) + b"]\n" + b'{"id": 5, "health": {}}\n')
            first, second = lines.read(), lines.read()
            assert first is not None
            assert "bytes, allowed" in first["error"]
            assert second is not None
            assert second["id"] == 5

    @pytest.mark.slow
    def test_a_client_that_does_not_read_ends_alone(self, door):
        with Lines.by_unix(door.folder) as deaf, Lines.by_unix(door.folder) as lines:
            deaf.socket.settimeout(1)
            assert ended(deaf, [b'{"describe": {"loop": "screwing"}}\n' * 20] * 100_000)
            assert "health" in lines.ask(health={})
            # The door gives it up, and does not wait for ever with a thread and a place.
            time.sleep(STUCK + 2)
            deaf.socket.settimeout(20)
            try:
                while deaf.socket.recv(65536):
                    pass
            except ConnectionResetError:
                pass

    def test_a_client_that_ends_its_sending_is_answered(self, door):
        with Lines.by_unix(door.folder) as lines:
            lines.send(b'{"id": 1, "health": {}}\n{"id": 2, "health": {}}')
            lines.socket.shutdown(socket.SHUT_WR)
            assert [(lines.read() or {}).get("id") for _ in range(2)] == [1, 2]
            assert lines.read() is None

    def test_a_client_that_vanishes_gives_the_loop_free(self, door):
        lines = enter(door)
        lines.ask(step=STEP)
        reset = struct.pack("ii", 1, 0)
        lines.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, reset)
        lines.close()
        until = time.monotonic() + 10
        with Lines.by_unix(door.folder) as other:
            while "twist" not in (answer := other.ask(step=STEP)):
                assert time.monotonic() < until, answer

    def test_a_line_without_end_is_given_up(self, monkeypatch):
        monkeypatch.setattr(json_door, "LONGEST_WAIT", 0.3)
        near, far = socket.socketpair()
        with near, far:
            far.sendall(b'{"health": {}}\n{"hea')
            lines = lines_from(near)
            assert next(lines) == b'{"health": {}}'
            with pytest.raises(TimeoutError):
                next(lines)

    def test_bytes_one_by_one_are_given_up(self, monkeypatch):
        monkeypatch.setattr(json_door, "LONGEST_WAIT", 0.3)
        near, far = socket.socketpair()
        stop = threading.Event()

        def drip() -> None:
            while not stop.wait(0.02):
                try:
                    far.sendall(b" ")
                except OSError:
                    return

        with near, far:
            thread = threading.Thread(target=drip)
            thread.start()
            begun = time.monotonic()
            with pytest.raises(TimeoutError):
                next(lines_from(near))
            assert time.monotonic() - begun < 5
            stop.set()
            thread.join()

    def test_an_idle_client_is_not_given_up(self, monkeypatch):
        monkeypatch.setattr(json_door, "LONGEST_WAIT", 0.1)
        near, far = socket.socketpair()
        with near, far:
            timer = threading.Timer(0.5, lambda: far.sendall(b"{}\n"))
            timer.start()
            assert next(lines_from(near)) == b"{}"
            timer.join()


class TestPort:
    def test_a_port_alone(self):
        assert read_port("5555") == 5555
        assert read_port("0") == 0

    @pytest.mark.parametrize("text", ["0.0.0.0:5555", "192.168.0.2:5555", "[::]:80", "host:80"])
    def test_an_address_is_refused(self, text):
        with pytest.raises(InputError, match=r"ssh -L .* ROS 2"):
            read_port(text)

    @pytest.mark.parametrize("text", ["", "-1", "65536", "x", "99999999999999", "٣"])
    def test_no_port(self, text):
        with pytest.raises(InputError, match="allowed a port, 0"):
            read_port(text)

    def test_a_port_that_is_taken(self):
        first = listen_tcp(0)
        port = first[0].getsockname()[1]
        try:
            with pytest.raises(InputError, match=f"port {port}"):
                listen_tcp(port)
        finally:
            for each in first:
                each.close()


def test_a_second_service_of_the_folder_has_no_lines(door, tmp_path):
    with running(door.folder, "desk", "--interpreted") as second:
        log = door.folder / "log"
        second.client("desk").close()
        assert "no lines of JSON: JSON door: served by process" in log.read_text()
        with Lines.by_unix(door.folder) as lines:
            assert set(lines.ask(health={})["health"]) == {"screwing", "overhead"}


def test_the_door_comes_back(door):
    with Lines.by_unix(door.folder) as lines:
        lines.ask(step=STEP)
        with Lines.by_unix(door.folder) as other:
            words = other.ask(step=STEP)["error"]
        assert "(JSON)" in words
        with door.client() as client:
            pid = client.description["health"]["commander"]
        subprocess.run(["kill", "-9", str(pid)], check=True)
        assert lines.read() is None
    with enter(door) as lines:
        assert "twist" in lines.ask(step=STEP)
        assert np.isfinite(lines.ask(step={"posture": COMFORT, "followed": 1000})["twist"]).all()
