"""``ergoqp replay``: compute the steps of a record again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from ergoqp.cli.common import counted, working
from ergoqp.cli.options import argument
from ergoqp.service.replayed import TOLERANCE, Difference, Replayed, ReplayedLoop, replay_record

ABOUT = """Compute every step of a record again, and compare the answers.

On the machine and with the versions of the record they have to be the same, bit for bit; elsewhere
within 1e-9. The exit status is 0 if they are, and 1 if one differs.

\b
Examples:
  ergoqp serve screwing --record loop.mcap
  ergoqp replay loop.mcap
"""


def command(path: Annotated[Path, argument("FILE", "A record of ergoqp serve --record.")]) -> None:
    """Replay a record, and print what differs.

    Raises:
        Exit: with status 1 if an answer differs.
        ErgoqpError: if it is no record, or no step can be computed.
    """
    with working(f"computing {path.name} again"):
        replayed = replay_record(path)
    for sentence in replayed.notes:
        typer.echo(sentence)
    for name, loop in replayed.loops.items():
        typer.echo(_in_words(name, loop, replayed))
    if replayed.first is not None:
        typer.echo(_difference(replayed.first))
    if replayed.wrong:
        raise typer.Exit(1)


def _in_words(name: str, loop: ReplayedLoop, replayed: Replayed) -> str:
    """Return the outcome for a loop in one line."""
    how = "bit for bit" if replayed.exact else f"within {TOLERANCE:g}"
    said = [f"loop {name}: {counted(loop.steps, 'step', 'steps')}, {loop.equal} equal {how}"]
    if loop.wrong:
        said.append(f"{loop.wrong} different")
    if loop.missing:
        said.append(f"{loop.missing} missing in the record, which counts {loop.counted}")
    if loop.not_computed:
        said.append(f"{loop.not_computed} not computed because steps before them are missing")
    return ", ".join(said)


def _difference(first: Difference) -> str:
    """Return the first difference, with both twists."""
    return (
        f"first different: step {first.number} of loop {first.loop}, in {', '.join(first.fields)}\n"
        f"  recorded twist {_numbers(first.recorded)}\n"
        f"  computed twist {_numbers(first.computed)}"
    )


def _numbers(twist: np.ndarray | None) -> str:
    return "none" if twist is None else " ".join(f"{each:.17g}" for each in twist)
