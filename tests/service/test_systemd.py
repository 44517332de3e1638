"""The service under a service manager, which these tests play."""

from __future__ import annotations

import os
import shlex
import shutil
import socket
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest

import ergoqp
from ergoqp.cli.main import execute
from ergoqp.registry import data_folder
from ergoqp.service.client import Client


@pytest.mark.slow
def test_it_takes_the_manager_s_sockets_and_tells_it_that_it_lives() -> None:
    with tempfile.TemporaryDirectory(prefix="eqp") as place:
        folder = Path(place)
        notices = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        notices.bind(str(folder / "notify"))
        notices.settimeout(60)
        held = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        held.bind(str(folder / "held.sock"))
        held.listen(4)
        # What systemd does: the socket is descriptor 3 of the process, whose number is told.
        script = (
            "import os, sys;"
            f"os.dup2({held.fileno()}, 3); os.environ['LISTEN_PID'] = str(os.getpid());"
            "os.execv(sys.executable, [sys.executable, '-m', 'ergoqp', *sys.argv[1:]])"
        )
        settings = {
            "LISTEN_FDS": "1",
            "LISTEN_FDNAMES": "screwing",
            "NOTIFY_SOCKET": str(folder / "notify"),
            "WATCHDOG_USEC": "400000",
        }
        command = [sys.executable, "-c", script, "serve", "screwing", "--interpreted"]
        process = subprocess.Popen(
            [*command, "--dir", str(folder / "s")],
            env=os.environ | settings,
            pass_fds=[held.fileno()],
            stderr=subprocess.DEVNULL,
        )
        try:
            # It is asked before it is there, and answers when it is.
            client = Client(folder / "held.sock", timeout=5.0)
            assert not (folder / "s" / "screwing.sock").exists()
            client.reset()
            posture = np.array(ergoqp.load_problem("screwing").response.comfort)
            assert client.step(posture).fresh
            client.close()
            for _ in range(3):
                assert notices.recv(100) == b"READY=1\nWATCHDOG=1"
        finally:
            process.terminate()
            assert process.wait(20) == 0
            held.close()
            notices.close()


def test_the_units_are_those_of_the_arguments(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    mine = tmp_path / "my place" / "mine.toml"
    mine.parent.mkdir()
    mine.write_text((data_folder("problems") / "desk.toml").read_text())
    arguments = ["serve", "desk", "my place/mine.toml", "--loops", "2", "--systemd", "u"]
    assert execute([*arguments, "--dt=0.02", "--interpreted", "--guide", "place.json"]) == 0
    assert "systemctl --user enable --now ergoqp-desk.0.socket" in capsys.readouterr().out
    files = sorted(path.name for path in (tmp_path / "u").iterdir())
    names = ("desk.0", "desk.1", "mine.0", "mine.1")
    assert files == [*(f"ergoqp-{name}.socket" for name in names), "ergoqp.service"]
    service = (tmp_path / "u" / "ergoqp.service").read_text()
    told = next(line for line in service.splitlines() if line.startswith("ExecStart="))
    # systemd quotes as a shell does.
    words = shlex.split(told.removeprefix("ExecStart="))
    assert words[1:] == [
        *("-m", "ergoqp", "serve", "desk", str(mine), "--dt", "0.02", "--loops", "2"),
        *("--interpreted", "--guide", str(tmp_path / "place.json")),
    ]
    assert "Type=notify" in service
    if shutil.which("systemd-analyze"):
        paths = [str(tmp_path / "u" / name) for name in files]
        found = subprocess.run(
            ["systemd-analyze", "verify", "--user", *paths],
            capture_output=True,
            text=True,
            check=False,
        )
        ours = [line for line in found.stderr.splitlines() if "/u/ergoqp" in line]
        assert not ours, found.stderr
