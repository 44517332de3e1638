"""The doors on loopback TCP, for programs that know no Unix sockets: who may enter, and by what.

A page in a browser can send bytes to a loopback port. So nothing is done for a connection before it
has sent a token that only this user can read, and the first line that is wrong ends it.
"""

from __future__ import annotations

import errno
import hmac
import os
import secrets
import select
import socket
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from ergoqp.errors import InputError

TOKEN_FILE: Final = "tcp.token"
"""File of the token in the folder of the sockets."""

_LOOPBACK: Final = ((socket.AF_INET, "127.0.0.1"), (socket.AF_INET6, "::1"))
_BACKLOG: Final = 16
_FIRST_LINE: Final = 256
"""Longest first line [bytes]."""
_GREETING: Final = 2.0
"""How long a connection may take to send its first line [s]."""
_DELAY: Final = 1.0
"""How long a connection with a wrong token waits for its answer [s]."""
_STUCK: Final = 5.0
"""How long a connection may refuse to take what is sent [s]."""


@dataclass(frozen=True)
class Entry:
    """What a connection asked for by its first line.

    Attributes:
        loop: loop whose binary frames are forwarded. None: lines of JSON.
        rest: what came after the first line.
    """

    loop: str | None
    rest: bytes


def read_port(text: str) -> int:
    """Return the port of ``--tcp``.

    Raises:
        InputError: if it is none, or an address was given.
    """
    if text.isascii() and text.isdigit() and len(text) < 6 and int(text) < 65536:
        return int(text)
    if ":" in text or "." in text:
        raise InputError(
            f"--tcp: got {text[:60]!r}, allowed a port alone: the service listens on this machine"
            " only; reach it from another one by ssh (ssh -L PORT:127.0.0.1:PORT HOST), or by ROS 2"
        )
    raise InputError(f"--tcp: got {text[:60]!r}, allowed a port, 0 (any free one) to 65535")


def listen_tcp(port: int) -> list[socket.socket]:
    """Return sockets that listen on both loopback addresses, or on the one that there is.

    Args:
        port: the port; 0: a free one.

    Raises:
        InputError: if the port is taken, or may not be used.
    """
    found: list[socket.socket] = []
    for family, address in _LOOPBACK:
        try:
            listener = socket.socket(family, socket.SOCK_STREAM)
        except OSError:  # this machine has no IPv6
            continue
        try:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            if family == socket.AF_INET6:
                listener.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
            listener.bind((address, port))
            listener.listen(_BACKLOG)
        except OSError as error:
            listener.close()
            if family == socket.AF_INET6 and error.errno not in (errno.EACCES, errno.EADDRINUSE):
                continue
            for each in found:
                each.close()
            raise InputError(
                f"--tcp: cannot listen at {address}, port {port}: {error.strerror}; give another"
                " port"
            ) from None
        listener.setblocking(False)
        found.append(listener)
        port = listener.getsockname()[1]
    return found


def new_token(folder: Path) -> bytes:
    """Return a new token, and write it to its file, which only this user can read.

    Raises:
        InputError: if the file cannot be written.
    """
    path, token = folder / TOKEN_FILE, secrets.token_urlsafe(32).encode()
    try:
        path.unlink(missing_ok=True)
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
        with os.fdopen(os.open(path, flags, 0o600), "wb") as file:
            file.write(token + b"\n")
    except OSError as error:
        raise InputError(f"--tcp: cannot write {str(path)!r}: {error.strerror}") from None
    return token


def admit(connection: socket.socket, token: bytes, loops: Sequence[str]) -> Entry | str:
    """Return what a new connection asks for, or why it may not enter.

    The reason is empty if the connection sent no line.
    """
    begun, line = time.monotonic(), b""
    try:
        while b"\n" not in line:
            left = begun + _GREETING - time.monotonic()
            if left <= 0 or len(line) > _FIRST_LINE:
                return ""
            connection.settimeout(left)
            if not (more := connection.recv(4096)):
                return ""
            line += more
    except OSError:
        return ""
    first, _, rest = line.partition(b"\n")
    words = first.rstrip(b"\r").split(b" ")
    if not hmac.compare_digest(words[0], token):
        # The wait is that of every wrong token, so that trying many takes long.
        _wait(connection, _DELAY)
        return f"tcp: the first line was not the token of the file {TOKEN_FILE} and a door"
    if words[1:] == [b"json"]:
        return Entry(None, rest)
    names = {name.encode(): name for name in loops}
    if len(words) == 3 and words[1] == b"door" and words[2] in names:
        return Entry(names[words[2]], rest)
    return f"tcp: the first line asked for no door; allowed json, or door with {', '.join(loops)}"


def _wait(connection: socket.socket, seconds: float) -> None:
    """Wait, but no longer than until the connection is ended from both sides."""
    ends = select.poll()
    try:
        ends.register(connection, 0)
    except (OSError, ValueError):  # it is closed
        return
    ends.poll(1e3 * seconds)


def forward(connection: socket.socket, path: Path, rest: bytes) -> None:
    """Carry bytes between a connection and a loop's socket until one of them ends."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as loop:
        for each in (connection, loop):
            each.settimeout(_STUCK)
        try:
            loop.connect(os.fspath(path))
            loop.sendall(rest)
            other = {connection: loop, loop: connection}
            while True:
                for source in select.select([connection, loop], [], [])[0]:
                    if not (data := source.recv(65536)):
                        return
                    other[source].sendall(data)
        except OSError:
            return
