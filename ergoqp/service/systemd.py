"""The service under systemd: sockets that it holds, notices that it waits for, and the units."""

from __future__ import annotations

import os
import socket
import sys
from pathlib import Path
from typing import Final

_FIRST: Final = 3
"""First descriptor that systemd hands over."""


def notify(words: str) -> None:
    """Tell the service manager something, such as ``READY=1``; do nothing if there is none."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address:
        return
    if address[0] == "@":  # an abstract name
        address = "\0" + address[1:]
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as there:
        try:
            there.sendto(words.encode(), address)
        except OSError:  # a manager that is gone is no reason to end
            return


def watchdog_seconds() -> float | None:
    """Return how often the manager wants to hear from the service [s]; None: it does not."""
    if os.environ.get("WATCHDOG_PID", str(os.getpid())) != str(os.getpid()):
        return None
    try:
        return int(os.environ["WATCHDOG_USEC"]) / 2e6
    except (KeyError, ValueError):
        return None


def inherited_sockets() -> dict[str, socket.socket]:
    """Return the listening sockets that the manager holds, by the name that the unit gives them."""
    if os.environ.get("LISTEN_PID") != str(os.getpid()):
        return {}
    count = int(os.environ.get("LISTEN_FDS", "0"))
    names = os.environ.get("LISTEN_FDNAMES", "").split(":")
    found = {}
    for number in range(count):
        os.set_inheritable(_FIRST + number, False)
        name = names[number] if number < len(names) else ""
        found[name.removesuffix(".socket")] = socket.socket(fileno=_FIRST + number)
    return found


def _quoted(word: str) -> str:
    """Return a word of a command as systemd reads it."""
    word = word.replace("%", "%%").replace("$", "$$")
    if any(letter in word for letter in " \t\"'\\;"):
        word = '"' + word.replace("\\", "\\\\").replace('"', '\\"') + '"'
    return word


def units(loops: list[str], arguments: list[str]) -> dict[str, str]:
    """Return the units of a service by file name: one socket for each loop, and the service.

    They are those of a user's manager (``~/.config/systemd/user``). The sockets stay with systemd,
    so a client that connects while the service is started again waits for it.

    Args:
        loops: names of the loops.
        arguments: of the command ``ergoqp serve``.
    """
    sockets = {
        f"ergoqp-{loop}.socket": f"""[Unit]
Description=Loop {loop} of ergoqp

[Socket]
ListenStream=%t/ergoqp/{loop}.sock
FileDescriptorName={loop}
Service=ergoqp.service
SocketMode=0600
DirectoryMode=0700

[Install]
WantedBy=sockets.target
"""
        for loop in loops
    }
    words = [str(Path(sys.executable)), "-m", "ergoqp", "serve", *arguments]
    command = " ".join(map(_quoted, words))
    service = f"""[Unit]
Description=Control steps of ergoqp
Requires={" ".join(sockets)}

[Service]
Type=notify
ExecStart={command}
WatchdogSec=10
Restart=always
RestartSec=0
# SCHED_FIFO for --fifo; the manager itself must be allowed to give it.
LimitRTPRIO=99
LimitMEMLOCK=infinity
NoNewPrivileges=true

[Install]
WantedBy=default.target
"""
    return {**sockets, "ergoqp.service": service}
