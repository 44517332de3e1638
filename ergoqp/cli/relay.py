"""``ergoqp relay``: executes twists and their stops beside the robot."""

from __future__ import annotations

import os
import sys
from typing import Annotated

import typer

from ergoqp.cli.options import option
from ergoqp.native.compiled import program
from ergoqp.service.c_header import header, relay_source
from ergoqp.service.folder import private_folder, socket_path

ABOUT = """Execute twists and their stops beside the robot, whatever happens to who sends them.

It is a small program in C, which is compiled once. A client that is given the relay's path sends
each twist with its stop. If the client is late, hangs or dies, the relay goes on along the stop.
The robot's driver gets the twists as datagrams (number as u64, seconds and twist as 7 f64, little
endian), or as lines of text. The relay ends by Ctrl-C, once the robot is at rest.

\b
Examples:
  ergoqp relay --to unix:/run/robot/twists
  ergoqp relay --to udp:192.168.1.10:5005 --rate 500 --fifo 80
  ergoqp serve --header > ergoqp_client.h && ergoqp relay --source > relay.c
"""


def command(
    path: Annotated[
        str | None,
        option("PATH", "Socket of the client [relay.sock in the service's folder].", "--in"),
    ] = None,
    to: Annotated[
        str | None, option("ADDRESS", "unix:PATH or udp:HOST:PORT [lines on standard output].")
    ] = None,
    rate: Annotated[float, option("HZ", "Twists per second, 1 to 10000.")] = 1000.0,
    fifo: Annotated[
        int | None, option("PRIORITY", "Run by SCHED_FIFO, 1 to 99 [usual scheduling].")
    ] = None,
    source: Annotated[
        bool, option(None, "Print the C source, to build it by hand.", "--source")
    ] = False,
) -> None:
    """Become the relay.

    Raises:
        ErgoqpError: if it cannot be compiled, or there is no private folder for its socket.
    """
    if source:
        typer.echo(relay_source(), nl=False)
        return
    built = program("relay", {"relay.c": relay_source(), "ergoqp_client.h": header()})
    words = ["--in", path or os.fspath(socket_path(private_folder(), "relay"))]
    words += ["--rate", repr(rate)]
    words += [] if to is None else ["--to", to]
    words += [] if fifo is None else ["--fifo", str(fifo)]
    sys.stdout.flush()
    os.execv(built, ["relay", *words])
