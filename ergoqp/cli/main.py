"""The command ``ergoqp``: its subcommands, and how errors are reported."""

from __future__ import annotations

import io
import os
import sys
import traceback
from collections.abc import Sequence
from importlib import import_module
from typing import Annotated, Any, Final

import typer
from typer.core import TyperGroup

from ergoqp._version import __version__
from ergoqp.errors import ErgoqpError, NothingScoredError

DONE, FAULT, MISTAKE, NOTHING, INTERRUPTED = 0, 1, 2, 3, 130
"""Exit statuses."""

COMMANDS: Final = {
    "run": "Close the loop of a problem with a simulated person.",
    "score": "Score every frame of a recording by REBA.",
    "optimise": "Look for the best place of the object, offline.",
    "group": "Look for one best place for several people.",
    "population": "Look for everybody's own best place.",
    "fit": "Learn a cost from labelled postures.",
    "compare": "Compare QP solvers on the QPs of a problem.",
    "export": "Write the control step of a problem as C99.",
    "serve": "Serve the control step to other processes.",
    "relay": "Execute twists and their stops beside the robot.",
    "replay": "Compute the steps of a service's record again.",
}
"""The commands, each a file of this folder with a function ``command``, and what each is for."""

# Lines after \b are not rewrapped, down to the next empty line.
_ABOUT = """Move the object so that the person's posture gets better.

\b
Examples:
  ergoqp run screwing
  ergoqp run screwing --from recording.bvh
  ergoqp optimise screwing
  ergoqp group desk --people 1.55,1.70,1.85
  ergoqp score recording.bvh --load-kg 4
  ergoqp fit svr
  ergoqp compare screwing

Exit status: 0 done, 2 for a mistake in what was given, 3 for a recording of which no frame could be
scored, 1 for a fault of the program.
"""


class _Commands(TyperGroup):
    """The commands, of which only the one that is asked for is imported."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self.commands = dict.fromkeys(COMMANDS)  # type: ignore[assignment]  # for suggestions

    def list_commands(self, ctx: Any) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        if cmd_name not in COMMANDS:
            return None
        # No command renders, and all begin a quarter of a second sooner without a library for
        # windows.
        os.environ.setdefault("MUJOCO_GL", "disable")
        module = import_module(f"ergoqp.cli.{cmd_name}")
        single = typer.Typer(**_SETTINGS)
        single.command(cmd_name, help=module.ABOUT)(module.command)
        return typer.main.get_command(single)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


_SETTINGS: Final[dict[str, Any]] = {
    "add_completion": False,
    "rich_markup_mode": None,
    "pretty_exceptions_enable": False,
    "context_settings": {"help_option_names": ["-h", "--help"], "max_content_width": 110},
}

app = typer.Typer(name="ergoqp", cls=_Commands, **_SETTINGS)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"ergoqp {__version__}")
        raise typer.Exit


@app.callback(invoke_without_command=True, help=_ABOUT)
def _root(
    context: typer.Context,
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version and end."
        ),
    ] = False,
) -> None:
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def execute(arguments: Sequence[str]) -> int:
    """Run a command line (without the program's name) and return the exit status.

    Error messages go to standard error.
    """
    try:
        status = app(args=list(arguments), prog_name="ergoqp", standalone_mode=False)
    except ErgoqpError as mistake:
        nothing = isinstance(mistake, NothingScoredError)
        return _complain(str(mistake), NOTHING if nothing else MISTAKE)
    except (KeyboardInterrupt, typer.Abort):
        return _complain("interrupted", INTERRUPTED)
    except BrokenPipeError:
        # The reader has closed the pipe, for example `| head`, so there is nothing to flush at
        # the end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAULT
    except Exception as error:
        # A usage error of the command-line library, whose class depends on the library's
        # version.
        if hasattr(error, "format_message"):
            message: str = error.format_message()  # type: ignore[attr-defined]
            words = _with_got(" ".join(message.split()), error, arguments)
            command = getattr(getattr(error, "ctx", None), "command_path", "ergoqp")
            return _complain(f"{words.rstrip('.')}; see `{command} --help`", MISTAKE)
        if os.environ.get("ERGOQP_DEBUG") == "1":
            traceback.print_exc()
        kind = type(error).__name__
        return _complain(
            f"internal fault, {kind}: {error}; set ERGOQP_DEBUG=1 to see where, and please"
            " report it",
            FAULT,
        )
    return status if isinstance(status, int) else DONE


def _with_got(words: str, error: Exception, arguments: Sequence[str]) -> str:
    """Return the text of a usage error with the given value, if the library does not name it."""
    options = getattr(getattr(error, "param", None), "opts", ())
    given = [*arguments, ""]
    for option in options:
        found = [given[i + 1] for i, each in enumerate(given[:-1]) if each == option]
        found += [each.partition("=")[2] for each in arguments if each.startswith(f"{option}=")]
        if found and "got" not in words and repr(found[-1]) not in words:
            said = words.partition(": ")[2].removeprefix("Input should be ")
            allowed = said.partition(",")[0].rstrip(".")
            return f"{option}: got {found[-1]!r}, allowed {allowed}"
    return words


def _complain(words: str, status: int) -> int:
    print(f"ergoqp: {words}", file=sys.stderr)
    return status


def main() -> None:
    """Run the command line of this process."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        # If a terminal or pipe cannot show a character, print its code instead of failing.
        sys.stdout.reconfigure(errors="backslashreplace")
    sys.exit(execute(sys.argv[1:]))
