"""Output of the commands: tables of suitable width, and progress."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.text import Text

PLAIN_WIDTH = 120
"""Number of columns of tables if the width of the output is unknown."""

PAUSE = 5.0
"""Time between two lines of progress, if there is no terminal for a bar [s]."""


def console() -> Console:
    """Return the console for results: standard output, as wide as the terminal or a log needs.

    ``COLUMNS`` sets the width if it is given.
    """
    out = Console()
    return out if out.is_terminal or _width_is_given() else Console(width=PLAIN_WIDTH)


def _width_is_given() -> bool:
    return os.environ.get("COLUMNS", "").isdecimal()


@contextmanager
def working(words: str) -> Iterator[Callable[[float], None]]:
    """Report on standard error what is being done: a bar on a terminal, plain lines otherwise.

    Long work prints another line with its progress every few seconds.

    Yields:
        A function to call with the share that is done, 0 to 1.
    """
    error = Console(stderr=True)
    if not error.is_terminal:
        yield _lines(words, error)
        return
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TaskProgressColumn(),
        TimeElapsedColumn(),
    )
    # No refresh thread, because it would disturb the measured durations.
    with Progress(*columns, console=error, transient=True, auto_refresh=False) as bar:
        task = bar.add_task(words, total=None)
        bar.refresh()

        def done(share: float) -> None:
            bar.update(task, total=1.0, completed=share)
            bar.refresh()

        yield done


def _lines(words: str, error: Console) -> Callable[[float], None]:
    """Return a function that prints the share that is done, in lines that are `PAUSE` apart."""
    began = last = time.monotonic()
    error.print(Text(f"{words} ..."), soft_wrap=True)

    def done(share: float) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last >= PAUSE and share < 1:
            last = now
            line = f"{words}: {100 * share:.0f} % after {now - began:.0f} s ..."
            error.print(Text(line), soft_wrap=True)

    return done


def print_assumptions(out: Console, sentences: Sequence[str], title: str = "assumed") -> None:
    """Print sentences as a list below a title, each on its own line."""
    whole = not (out.is_terminal or _width_is_given())
    if sentences:
        out.print(Text(title), soft_wrap=whole)
    for sentence in sentences:
        out.print(Text(f"- {sentence}"), soft_wrap=whole)
