"""``ergoqp serve``: the control step for other processes."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Annotated, Any

import typer

from ergoqp.cli.options import Guide, folder_of, option
from ergoqp.errors import InputError
from ergoqp.problem.load import find_problem, problem_names
from ergoqp.service.c_header import header
from ergoqp.service.folder import private_folder
from ergoqp.service.schema import schema
from ergoqp.service.served import Served, served
from ergoqp.service.stdio import serve_stdio
from ergoqp.service.supervisor import MOST_WORKERS, Supervisor, say
from ergoqp.service.systemd import units
from ergoqp.service.tcp import read_port
from ergoqp.step.engine import may_compile_beside

ABOUT = """Serve the control step of problems to other processes.

Each problem is a loop with a socket, for the clients in Python and C, and one socket, json.sock,
takes lines of JSON for all loops. The service ends by Ctrl-C.

\b
Examples:
  ergoqp serve screwing
  ergoqp serve screwing overhead --loops 4 --fifo 20
  ergoqp serve screwing --record loop.mcap
  ergoqp serve screwing --tcp 5555
  ergoqp serve --schema
  ergoqp serve --header > ergoqp_client.h

\b
The first twist in a shell, by two commands:
  pip install ergoqp
  echo '{"step": {"standing": true, "posture": {"trunk_flexion_deg": 20}}}' |
    ergoqp serve screwing --stdio
"""


def command(
    problems: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[PROBLEM]...", help="Names, or paths of TOML files.", show_default=False
        ),
    ] = None,
    dt: Annotated[float | None, option("S", "Control period [the problem's].")] = None,
    loops: Annotated[int, option("N", "Loops of each problem.")] = 1,
    workers: Annotated[
        int | None, option("N", "Processes that compute steps [one per problem].")
    ] = None,
    fifo: Annotated[
        int | None, option("PRIORITY", "Run them by SCHED_FIFO, 1 to 99 [usual scheduling].")
    ] = None,
    compiled: Annotated[
        bool | None,
        option(
            None,
            "Compile the step before serving, or never [beside serving, at idle priority].",
            "--compiled/--interpreted",
        ),
    ] = None,
    guide: Guide = None,
    folder: Annotated[
        Path | None,
        option(
            "DIR", "Private folder of the sockets [runtime directory].", "--dir", parser=folder_of
        ),
    ] = None,
    record: Annotated[
        Path | None, option("FILE", "Record all steps in a new file, such as loop.mcap [none].")
    ] = None,
    tcp: Annotated[
        str | None,
        option(
            "PORT",
            "Serve lines of JSON and frames by TCP too, to programs of this machine that send the"
            " token of the file tcp.token [no TCP].",
        ),
    ] = None,
    stdio: Annotated[
        bool,
        option(
            None,
            "Read requests from standard input and write answers to standard output, a line of JSON"
            " each, in one process without sockets.",
            "--stdio",
        ),
    ] = False,
    systemd: Annotated[
        Path | None,
        option("DIR", "Write units for systemd that serve like this, and end.", parser=folder_of),
    ] = None,
    print_schema: Annotated[
        bool, option(None, "Print the frames of the protocol as JSON.", "--schema")
    ] = False,
    print_header: Annotated[
        bool, option(None, "Print the client for C and C++, one header.", "--header")
    ] = False,
) -> None:
    """Serve until interrupted.

    Raises:
        ErgoqpError: if an argument cannot be used, or a loop is served already.
    """
    if print_schema:
        typer.echo(json.dumps(schema(), indent=2))
        return
    if print_header:
        typer.echo(header(), nl=False)
        return
    _check("--loops", loops, 1, 256)
    _check("--workers", workers, 1, MOST_WORKERS)
    _check("--fifo", fifo, 1, 99)
    port = None if tcp is None else read_port(tcp)
    if not problems:
        raise InputError("PROBLEM: got none, allowed one or more, such as screwing")
    if record is not None:
        from ergoqp.service.recorder import check_record

        # A service that systemd starts again goes on in another file.
        check_record(record, again="LISTEN_FDS" in os.environ)
    served_problems = [served(name, dt, loops) for name in problems]
    _check_names(served_problems)
    if systemd is not None:
        options = {
            "--dt": dt,
            "--loops": loops if loops > 1 else None,
            "--workers": workers,
            "--fifo": fifo,
            "--compiled" if compiled else "--interpreted": compiled is not None,
            "--guide": guide,
            "--record": record,
            "--tcp": tcp,
        }
        names = [loop for each in served_problems for loop in each.loop_names]
        paths = [each if each in problem_names() else str(find_problem(each)) for each in problems]
        _write_units(systemd, names, paths, options)
        return
    if guide is not None:
        from ergoqp.cli.run import guide_named  # slow to import, and rarely needed

        for each in served_problems:
            each.guide = guide_named(each.problem, guide)
    for each in served_problems:
        each.prepare(bool(compiled))
    if stdio:
        _check_alone(tcp=tcp, workers=workers, fifo=fifo, dir=folder)
        serve_stdio(served_problems)
        return
    where = private_folder(folder)
    supervisor = Supervisor(served_problems, where, workers or len(served_problems), fifo, record)
    for name in supervisor.listeners:
        say(f"loop {name} at {where / name}.sock")
    try:
        for said in supervisor.open_json_door(port):
            say(said)
    except InputError as error:
        if port is not None:
            raise
        # Another service of this folder has it; the loops have their own sockets.
        say(f"no lines of JSON: {error}")
    if compiled is None and may_compile_beside():
        supervisor.compile_beside()
    supervisor.run()


def _write_units(folder: Path, loops: list[str], problems: list[str], options: Any) -> None:
    """Write units of a service with these problems and options; paths become absolute."""
    arguments = [os.path.abspath(each) if each.endswith(".toml") else each for each in problems]
    for name, value in options.items():
        if value is None or value is False:
            continue
        is_path = isinstance(value, Path) or (name == "--guide" and value != "best")
        arguments.append(name)
        if value is not True:
            arguments.append(os.path.abspath(value) if is_path else str(value))
    from ergoqp.cli.common import writing  # imports what draws progress

    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in units(loops, arguments).items():
            (folder / name).write_text(text, encoding="utf-8")
            typer.echo(str(folder / name))
    names = " ".join(f"ergoqp-{loop}.socket" for loop in loops)
    typer.echo(f"systemctl --user daemon-reload && systemctl --user enable --now {names}")


def _check(name: str, value: int | None, least: int, most: int) -> None:
    if value is not None and not least <= value <= most:
        raise InputError(f"{name}: got {value}, allowed {least} to {most}")


def _check_alone(**others: object) -> None:
    """Refuse options of sockets beside ``--stdio``."""
    for name, value in others.items():
        if value is not None:
            raise InputError(f"--{name}: got {str(value)!r}, allowed only without --stdio")


def _check_names(problems: list[Served]) -> None:
    names = [each.name for each in problems]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice:
        raise InputError(f"PROBLEM: got {twice} twice, allowed different names; use --loops")
